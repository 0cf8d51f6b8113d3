"""Edits of a sequence: the frame that is shown, keys, and propagated poses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

from msgspec import Meta

from poseviewer.app.state.document import UNLOCK, label_of
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.results import PropagationProgress, PropagationRequest
from poseviewer.app.state.search_edits import stop_search
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.fit.propagation import FrameStep
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import (
    key_indices,
    neighbouring_keys,
    remove_key,
    remove_propagated,
    show_frame,
    store_poses,
)
from poseviewer.scene.types import Scene

FrameCommand = Literal[
    "to start", "to next key", "to end", "between keys",
    "clear between", "keep keys", "remove key", "stop", "graph",
]  # fmt: skip
"""Command of a button of the time line."""
Share = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""Place along the time line, in shares of its width."""


@edit
def go_to_frame(session: Session, u: Share) -> Session:
    """Show the frame at a place of the time line."""
    return _go_to(session, int(u * len(session.document.scene.frames)))


@edit
def step_frame(session: Session, by: int, between_keys: bool = False) -> Session:
    """Show the frame, or the key of the active object, that is ``by`` further on."""
    document = session.document
    now = document.scene.frame_index if session.wanted_frame is None else session.wanted_frame
    if not between_keys:
        return _go_to(session, now + by)
    keys = key_indices(document.scene, document.object.id)
    ahead = [k for k in keys if k > now] if by > 0 else [k for k in reversed(keys) if k < now]
    return _go_to(session, ahead[: abs(by)][-1]) if ahead else session


def _go_to(session: Session, index: int) -> Session:
    count, progress = len(session.document.scene.frames), session.propagation
    if not count:
        return session
    progress = progress and replace(progress, follows=False)
    return replace(session, wanted_frame=min(max(index, 0), count - 1), propagation=progress)


@drag_edit
def frame_read(session: Session, index: int, file: PhotoFile | None) -> Session:
    """Show a frame whose photo has been read; None: it cannot be. It is no undo step.

    A search ends, and its best pose so far is kept.
    """
    frames = session.document.scene.frames
    is_known = session.wanted_frame is not None and index < len(frames)
    if session.drag is not None or not is_known:
        return session
    wanted = None if session.wanted_frame == index else session.wanted_frame
    if file is None or frames[index].file != file:
        return replace(session, wanted_frame=wanted)
    session = stop_search()(session)
    document = session.document.at_frame(index, file)
    session = session.without_search(document.scene)
    # What was drawn stays until it is drawn anew: nothing flickers while frames go by.
    results = replace(session.results, landscapes=(), maps_note="")
    shown = {"document": document, "wanted_frame": wanted, "results": results}
    return replace(session, **shown, comparison=None)


@edit
def edit_frames(session: Session, what: FrameCommand) -> Session:
    """Propagate the active object's poses, clear them, or remove its key.

    ``to`` goes out from the frame that is shown; ``between`` is between the keys beside it.
    """
    if what == "stop":
        return session.stop_propagating()
    if what == "graph":
        display = replace(session.display, motion_graph=not session.display.motion_graph)
        return replace(session, display=display)
    document, scene = session.document, session.document.scene
    if not scene.frames:
        return session
    object_id, shown = document.object.id, scene.frame_index
    end = len(scene.frames) - 1
    before, after = neighbouring_keys(scene, object_id, shown)
    match what:
        case "clear between":
            return _with_frames(session, remove_propagated(scene, object_id, before, after))
        case "keep keys":
            return _with_frames(session, remove_propagated(scene, object_id, 0, end))
        case "remove key":
            scene = remove_key(scene, document.active)
            return _with_frames(session, show_frame(scene, shown))
        case "to start":
            return _propagate(session, 0, shown - 1)
        case "to end":
            return _propagate(session, shown + 1, end)
        case "to next key":
            return _propagate(session, shown + 1, after - 1)
    return _propagate(session, before + 1, after - 1)


def _with_frames(session: Session, scene: Scene) -> Session:
    """Take an undo step to changed frames."""
    return session.with_document(session.document.with_frames_of(scene))


def _propagate(session: Session, first: int, last: int) -> Session:
    """Begin to propagate, as one undo step."""
    session = stop_search()(session).stop_proposing()
    document, scene = session.document, session.document.scene
    label = label_of(document.object)
    if session.preparation is not None and session.preparation.trouble:
        raise SettingsError(session.preparation.trouble)
    if document.object.locked:
        raise SettingsError(f"{label} is locked: {UNLOCK} to propagate its poses")
    if not key_indices(scene, document.object.id):
        raise SettingsError(f"{label} has no key: place it in a frame first")
    if first > last:
        raise SettingsError("there is no frame between: keys stay as they are")
    request = PropagationRequest(document, first, last)
    history = session.history.with_step(document)
    session = session.without_search(scene)
    return replace(session, history=history, propagation=PropagationProgress(request))


@drag_edit
def propagation_advanced(
    session: Session,
    request: PropagationRequest,
    steps: Sequence[FrameStep],
    is_over: bool = False,
) -> Session:
    """Store the steps of a propagation, and show the last one's frame unless the user is elsewhere.

    Args:
        session: before the edit.
        request: of the propagation; nothing changes if it is not the running one.
        steps: all that it has made, of which the session has the first ones.
        is_over: whether there are no more.
    """
    progress = session.propagation
    if progress is None or progress.request is not request or progress.is_over:
        return session
    scene, object_id = session.document.scene, request.start.object.id
    new, notes = steps[progress.steps :], progress.notes
    for step in new:
        index = step.frame_index
        notes += (f"frame {index + 1}: {step.note}",) if step.note else ()
        if object_id not in step.poses:
            scene = remove_propagated(scene, object_id, index, index)
        scene = store_poses(scene, {index: step.poses})
    count = progress.steps + len(new)
    at = new[-1].frame_index if new else progress.frame_index
    progress = replace(progress, steps=count, frame_index=at, notes=notes, is_over=is_over)
    document = session.document.with_frames_of(scene)
    wanted = at if new and progress.follows else session.wanted_frame
    return replace(session, document=document, propagation=progress, wanted_frame=wanted)
