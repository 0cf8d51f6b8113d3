"""Keys of a sequence, from the poses that an edit has changed."""

from collections.abc import Callable, Collection, Set
from dataclasses import replace

from poseviewer.app.state.document import Document, with_camera
from poseviewer.scene.sequence import change_poses, store_key
from poseviewer.scene.types import Frame, FramePose, Scene


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
