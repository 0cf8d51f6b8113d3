"""Edit that makes the frames of a sequence views of a scene that stands still."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from poseviewer.app.state.document import Document, label_of, with_camera
from poseviewer.app.state.edits import edit, open_document
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError, list_names
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.opening.photo_sets import LoadedViews
from poseviewer.opening.scenes import known_scale, scale_of_views
from poseviewer.scene.types import InView, Scene, SceneObject, View

if TYPE_CHECKING:
    from poseviewer.still.still_cameras import StillCameras


@edit
def stand_still(
    session: Session, before: Document, found: StillCameras, still: Document
) -> Session:
    """Make a sequence the scene of views whose cameras were found, unless other frames are open.

    Args:
        session: before the edit.
        before: document whose frames' cameras were found.
        found: the cameras, of the frames' files; their photos may be at rest.
        still: what ``still_document`` makes of both, unless the document was edited meanwhile.
    """
    now, frames = session.document, before.scene.frames
    if [frame.file.location for frame in now.scene.frames] != [f.file.location for f in frames]:
        return session
    document = still if now is before else still_document(now, found)
    return open_document(document, unsaved=True, looks=False)(session)


def still_document(now: Document, found: StillCameras) -> Document:
    """The document of a sequence whose scene stands still. Objects stay where the shown frame shows
    them; one without a pose there where the nearest frame does that has one.

    Where nothing tells the scale, the active object alone stays: a search for it tells the scale.
    """
    scene, frames, mesh = now.scene, now.scene.frames, now.mesh
    index_of = {frame.file.location: index for index, frame in enumerate(frames)}
    at = [index_of[view.file.location] for view in found.views]
    shown = min(range(len(at)), key=lambda view: abs(at[view] - scene.frame_index))
    notes, known = [*scene.notes, *found.lines], None
    if found.is_scale_known:
        of_model = 1.0 if found.unit is None else None
        views, unit = LoadedViews(scene.name, found.views, found.unit, of_model), now.model.unit
        known = known_scale(views, unit)
        if found.unit is not None and unit is None:
            wanted = "if it is another, undo, say the Model's unit in Save, and find them again"
            notes.append(f"{now.model.name} says no unit: {found.unit} is taken; {wanted}.")
    chosen = range(len(scene.objects)) if known else (now.active,)
    if len(chosen) < len(scene.objects):
        others = [label_of(item) for i, item in enumerate(scene.objects) if i != now.active]
        wanted = f"search for {label_of(now.object)}, which tells it, and add them again"
        notes.append(f"Nothing tells the scale yet: {list_names(others)} left out; {wanted}.")
    scale = 1.0 / known if known else 1.0
    if known is None:
        view, pose, _ = _place_of(now, now.active, found.views, at, shown)
        with suppress(SettingsError):  # else a press in the photo triangulates it
            scale = 1.0 / scale_of_views(found.views, view, mesh, pose, scene.name)
    masks = [Mask.product([*filter(None, (scene.views[0].mask, frames[i].mask))]) for i in at]
    pairs = zip(found.views, masks, strict=True)
    still = Scene(
        views=tuple(replace(view, mask=mask) for view, mask in pairs),
        objects=tuple(_still_object(now, i, found.views, at, shown, scale) for i in chosen),
        unit=found.unit, free_scale=known is None, name=scene.name,
        notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip
    states = tuple(replace(now.states[i], marks={}) for i in chosen)
    document = replace(Document.of(still), states=states, active=now.active if known else 0)
    return document.with_view(shown)


def _place_of(
    now: Document, index: int, views: tuple[View, ...], at: list[int], shown: int
) -> tuple[int, Pose, bool]:
    """The view whose frame shows an object, its pose there, and whether it was placed."""
    item, frames, old = now.scene.objects[index], now.scene.frames, now.scene.views[0]
    posed = [view for view, frame in enumerate(at) if item.id in frames[frame].poses]
    view = min(posed, key=lambda view: abs(at[view] - now.scene.frame_index), default=shown)
    place = frames[at[view]].poses[item.id].world_from_model if posed else item.world_from_model
    pose = with_camera(old.pose(place), views[view].camera, item.mesh.centre)
    return view, pose, bool(posed)


def _still_object(
    now: Document, index: int, views: tuple[View, ...], at: list[int], shown: int, scale: float
) -> SceneObject:
    """An object of the sequence where one frame shows it, with its masks in all."""
    item, own = now.scene.objects[index], now.scene.in_view(index)
    view, pose, is_placed = _place_of(now, index, views, at, shown)
    in_views = []
    for frame in (now.scene.frames[i] for i in at):
        mask = Mask.product([*filter(None, (own.mask, frame.masks.get(item.id)))])
        in_views.append(InView(mask=mask, occluders=frame.occluders.get(item.id)))
    as_new = {"start": None, "start_cameras": (), "result": None}
    place = views[view].world_from_model(pose, scale)
    item = replace(item, world_from_model=place, is_placed=is_placed, **as_new)
    return replace(item, in_views=tuple(in_views))
