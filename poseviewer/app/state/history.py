"""Steps from a document to the next: undo and redo, and the keys that a step sets in a sequence."""

from __future__ import annotations

from collections.abc import Callable, Collection, Set
from dataclasses import dataclass, replace

from poseviewer.app.state.document import Document, with_camera, with_files
from poseviewer.scene.sequence import change_poses, store_key
from poseviewer.scene.types import Frame, FramePose, Scene

MAX_STEPS = 200
MAX_OPENED = 4
"""Number of photos (or sets), and of models beside the open ones, that undo keeps in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """The documents before and after the current one."""

    past: tuple[Document, ...] = ()
    future: tuple[Document, ...] = ()
    last_step: tuple[object, Document | None] = (None, None)
    """Key of the last step, and the document that it led to."""

    def with_step(
        self, before: Document, after: Document | None = None, key: object = None
    ) -> History:
        """Add a step and drop undone ones; consecutive steps with the same ``key`` are one."""
        is_same = key is not None and self.last_step == (key, before) and not self.future
        past = self.past if is_same else _drop_oldest((*self.past, _without_photo(before)))
        return History(past, last_step=(key, after))

    def undo(self, now: Document) -> tuple[History, Document]:
        """Undo a step, if there is one."""
        if not self.past:
            return self, now
        return History(self.past[:-1], (_without_photo(now), *self.future)), self.past[-1]

    def redo(self, now: Document) -> tuple[History, Document]:
        """Redo a step, if there is one."""
        if not self.future:
            return self, now
        past = _drop_oldest((*self.past, _without_photo(now)))
        return History(past, self.future[1:]), self.future[0]


def _without_photo(document: Document) -> Document:
    """The document that reads the photo of a frame, or of one of many views, again: hundreds would
    fill the memory.
    """
    scene = document.scene
    if not document.stepped:
        return document
    # A frame's handle may hold what it has read.
    files = [replace(v.file) if scene.frames else v.file.at_rest for v in scene.views]
    return replace(document, scene=with_files(scene, files))


def _drop_oldest(past: tuple[Document, ...]) -> tuple[Document, ...]:
    """The newest steps within the limits."""
    past = past[-MAX_STEPS:]
    photos, meshes = set(), set()
    max_meshes = MAX_OPENED + len(past[-1].scene.objects) - 1
    for index in reversed(range(len(past))):
        scene = past[index].scene
        if not past[index].stepped:
            photos.add(tuple(id(view.photo) for view in scene.views))
        meshes |= {id(item.model.mesh.whole) for item in scene.objects}
        meshes |= {id(item.painting) for item in scene.objects if item.painting}
        if len(photos) > MAX_OPENED or len(meshes) > max_meshes:
            return past[index + 1 :]
    return past


def store_changed_poses(before: Document, now: Document) -> Document:
    """Store placed objects' poses that differ from those ``before`` as keys of the shown frame.

    What was propagated from there is stale. Poses of an object that is gone or has another model
    are dropped, with what was found in front of it; by another camera, all poses stay where the
    photos show them.
    """
    old, scene = before.scene, now.scene
    if not scene.frames or scene.frames is not old.frames:
        return now
    was = {item.id: item for item in old.objects}
    # The unit is what is said of a model, not another model.
    models = {item.id: replace(item.model, unit=None) for item in scene.objects}
    gone = {name for name, own in was.items() if models.get(name) != replace(own.model, unit=None)}
    if gone:
        scene = change_poses(scene, lambda name, pose: None if name in gone else pose)
        scene = replace(
            scene, frames=tuple(_without(frame, gone, models) for frame in scene.frames)
        )
    has_new_camera = old.views[0].camera != scene.views[0].camera
    if has_new_camera:
        scene = change_poses(scene, _by_camera(old, scene))
    for index, item in enumerate(scene.objects):
        known, has_pose = was.get(item.id), item.id in scene.frames[scene.frame_index].poses
        old_place = known.world_from_model if known and known.is_placed else None
        is_chosen = has_pose or item.result is not None or not has_new_camera
        if item.is_placed and is_chosen and item.world_from_model is not old_place:
            scene = store_key(scene, index)
    return now if scene is now.scene else replace(now, scene=scene)


def _without(frame: Frame, gone: Set[str], kept: Collection[str]) -> Frame:
    """A frame without the masks of objects that are not ``kept``, and what was found in front of
    those that are ``gone`` or have another model.
    """
    if gone.isdisjoint((*frame.masks, *frame.occluders)):
        return frame
    masks = {name: mask for name, mask in frame.masks.items() if name in kept}
    occluders = {name: mask for name, mask in frame.occluders.items() if name not in gone}
    return replace(frame, masks=masks, occluders=occluders)


def _by_camera(old: Scene, now: Scene) -> Callable[[str, FramePose], FramePose]:
    meshes = {item.id: item.mesh for item in now.objects}
    was, view = old.views[0], now.views[0]

    def change(name: str, pose: FramePose) -> FramePose:
        moved = with_camera(was.pose(pose.world_from_model), view.camera, meshes[name].centre)
        place = view.world_from_model(moved, pose.world_from_model.scale)
        is_stale = pose.source == "propagated"
        return replace(pose, world_from_model=place, result=None, is_stale=is_stale)

    return change
