"""Edits of a sequence: the frame that is shown, keys, and propagated poses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

from msgspec import Meta

from poseviewer.app.state.document import UNLOCK, label_of
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.objects import show_view
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.results import Pace, PropagationProgress, PropagationRequest
from poseviewer.app.state.search_edits import stop_search
from poseviewer.app.state.session import Session
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import SettingsError
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.sequence import (
    FrameStep,
    key_indices,
    mark_stale,
    neighbouring_keys,
    remove_key,
    remove_propagated,
    show_frame,
    store_poses,
)
from poseviewer.scene.types import FramePose, Scene, SceneObject

FrameCommand = Literal[
    "to start", "to next key", "to end", "between keys",
    "clear between", "keep keys", "remove key", "stop", "graph", "alone",
]  # fmt: skip
"""Command of a button of the time line."""
Share = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""Place along the time line, in shares of its width."""

MANY_FRAMES = 10
"""Frames that a key steps by together with shift."""


@edit
def go_to_frame(session: Session, u: Share) -> Session:
    """Show the frame, or the view, at a place of the time line."""
    return _go_to(session, int(u * len(session.document.stepped)))


@edit
def step_frame(session: Session, by: int, between_keys: bool = False) -> Session:
    """Show the frame, or the key of the active object, that is ``by`` further on; of many views the
    next one, or the next one on which a search said something.
    """
    document = session.document
    now = document.step_index if session.wanted_frame is None else session.wanted_frame
    if not between_keys:
        return _go_to(session, now + by)
    if document.scene.frames:
        keys = key_indices(document.scene, document.object.id)
    else:
        keys = sorted(view_verdicts(document.object))
    ahead = [k for k in keys if k > now] if by > 0 else [k for k in reversed(keys) if k < now]
    return _go_to(session, ahead[: abs(by)][-1]) if ahead else session


@edit
def press_arrow(session: Session, x: float, y: float, factor: float = 1.0) -> Session:
    """Step through a sequence, by frames left and right and by keys up and down; in a still scene,
    move the model.

    Args:
        session: before the edit.
        x: steps to the right.
        y: steps down.
        factor: of the steps; frames are stepped by ten where it is not 1.
    """
    if not session.document.scene.frames:
        return nudge("move", factor * x, factor * y)(session)
    by = round(x + y) * (1 if factor == 1.0 else MANY_FRAMES)
    return step_frame(by, between_keys=not x)(session)


def _go_to(session: Session, index: int) -> Session:
    count, progress = len(session.document.stepped), session.propagation
    if not count:
        return session
    progress = progress and replace(progress, follows=False)
    return replace(session, wanted_frame=min(max(index, 0), count - 1), propagation=progress)


@drag_edit
def frame_read(session: Session, index: int, file: PhotoFile | None) -> Session:
    """Show a frame whose photo has been read, or one of many views; None: it cannot be. It is no
    undo step.

    In a sequence, a search ends, and its best pose so far is kept.
    """
    files = session.document.stepped
    is_known = session.wanted_frame is not None and index < len(files)
    if session.drag is not None or not is_known:
        return session
    wanted = None if session.wanted_frame == index else session.wanted_frame
    if file is None or files[index] != file:
        return replace(session, wanted_frame=wanted)
    if not session.document.scene.frames:
        return show_view(index, file)(replace(session, wanted_frame=wanted))
    session = stop_search()(session)
    document = session.document.at_frame(index, file)
    session = session.without_search(document.scene)
    # What was drawn stays until it is drawn anew: nothing flickers while frames go by.
    results = replace(session.results, landscapes=(), maps_note="")
    shown = {"document": document, "wanted_frame": wanted, "results": results}
    return replace(session, **shown, comparison=None)


def view_verdicts(item: SceneObject) -> dict[int, Verdict]:
    """The verdict by each view alone on an object's pose, by the views' indices."""
    result = item.result
    if result is None or result.verdict is None:
        return {}
    compared = {i for i, share in enumerate(result.seen) if share is not None} - {result.view}
    return dict(zip((result.view, *sorted(compared)), result.verdict.views, strict=False))


@edit
def edit_frames(session: Session, what: FrameCommand) -> Session:
    """Propagate poses, clear them, or remove the active object's key.

    ``to`` goes out from the frame that is shown; ``between`` is between the keys beside it.
    ``to start`` and ``to end`` are for all objects, unless the active one is chosen ``alone``.
    """
    if what == "stop":
        return session.stop_propagating()
    if what == "graph":
        display = replace(session.display, motion_graph=not session.display.motion_graph)
        return replace(session, display=display)
    if what == "alone":
        display = replace(session.display, propagates_alone=not session.display.propagates_alone)
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
            return _propagate(session, 0, shown - 1, of_all=True)
        case "to end":
            return _propagate(session, shown + 1, end, of_all=True)
        case "to next key":
            return _propagate(session, shown + 1, after - 1)
    return _propagate(session, before + 1, after - 1)


def _with_frames(session: Session, scene: Scene) -> Session:
    """Take an undo step to changed frames."""
    return session.with_document(session.document.with_frames_of(scene))


def _propagate(session: Session, first: int, last: int, of_all: bool = False) -> Session:
    """Begin to propagate, as one undo step."""
    session = stop_search()(session).stop_proposing()
    document, scene = session.document, session.document.scene
    label, chosen = label_of(document.object), (document.active,)
    if of_all and not session.display.propagates_alone:
        objects = enumerate(scene.objects)
        free = (i for i, item in objects if not item.locked and key_indices(scene, item.id))
        chosen = tuple(free) or chosen
    if session.preparation is not None and session.preparation.trouble:
        raise SettingsError(session.preparation.trouble)
    if document.object.locked and document.active in chosen:
        raise SettingsError(f"{label} is locked: {UNLOCK} to propagate its poses")
    if not any(key_indices(scene, scene.objects[index].id) for index in chosen):
        raise SettingsError(f"{label} has no key: place it in a frame first")
    if first > last:
        raise SettingsError("there is no frame between: keys stay as they are")
    request = PropagationRequest(document, chosen, first, last)
    history = session.history.with_step(document)
    session = session.without_search(scene)
    return replace(session, history=history, propagation=PropagationProgress(request))


@drag_edit
def propagation_advanced(
    session: Session,
    request: PropagationRequest,
    steps: Sequence[FrameStep],
    is_over: bool = False,
    pace: Pace | None = None,
) -> Session:
    """Store the steps of a propagation, and show the last one's frame unless the user is elsewhere.
    Beside a frame that is mended, poses are stale until they are mended, too.

    Args:
        session: before the edit.
        request: of the propagation; nothing changes if it is not the running one.
        steps: all that it has made, of which the session has the first ones.
        is_over: whether there are no more.
        pace: how far it is; None: as it was.
    """
    progress = session.propagation
    if progress is None or progress.request is not request or progress.is_over:
        return session
    scene = session.document.scene
    new, notes, frames = steps[progress.steps :], progress.notes, set(progress.frames)
    for step in new:
        index = step.frame_index
        notes += (step.note,) if step.note else ()
        for object_id in step.lost:
            scene = remove_propagated(scene, object_id, index, index)
        old, changed = scene.frames[index].poses, [*step.poses]
        if request.key is not None:
            changed = [name for name in changed if not _is_same(old.get(name), step.poses[name])]
            ahead = index + (1 if index > request.key else -1)
            for object_id in changed:
                scene = mark_stale(scene, object_id, ahead, ahead)
        frames |= {index} if changed else set()
        scene = store_poses(scene, {index: step.poses})
    progress = replace(
        progress,
        steps=progress.steps + len(new),
        frames=frozenset(frames),
        notes=notes,
        is_over=is_over,
        pace=pace or progress.pace,
    )
    document = session.document.with_frames_of(scene)
    wanted = new[-1].frame_index if new and progress.follows else session.wanted_frame
    return replace(session, document=document, propagation=progress, wanted_frame=wanted)


def _is_same(old: FramePose | None, new: FramePose) -> bool:
    return old is not None and old.world_from_model is new.world_from_model
