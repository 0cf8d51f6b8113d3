"""Sequences: a scene whose one view shows its frames in turn.

The scene's photo and its objects' poses are those of the frame that is shown. ``Scene.frames``
keeps the poses of all frames: *keys*, which the user has placed, and propagated ones.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from poseviewer.errors import SettingsError
from poseviewer.geometry.mask import Mask
from poseviewer.scene.types import Frame, FramePose, InView, Scene


@dataclass(frozen=True, slots=True, eq=False)
class FrameStep:
    """Poses that a propagation has found in a frame."""

    frame_index: int
    poses: Mapping[str, FramePose]
    """Propagated poses, by the objects' ids."""
    note: str = ""
    """Why a track ends here, or how far both ways are apart; "": it goes on."""
    lost: tuple[str, ...] = ()
    """Ids of the objects that were searched for here and not found."""


def with_frames(scene: Scene, frames: Sequence[Frame]) -> Scene:
    """Make a sequence of a scene of one view, which shows the first frame.

    Raises:
        SettingsError: the scene has several views, there are no frames, or their sizes differ.
    """
    if len(scene.views) != 1 or not frames:
        found = f"{len(frames)} frames for {len(scene.views)} views"
        raise SettingsError(f"{found}; wanted frames of one camera.")
    camera = scene.views[0].camera
    for frame in frames:
        if (frame.file.width, frame.file.height) != (camera.width, camera.height):
            found = f"{frame.file.name}: {frame.file.width}x{frame.file.height} px"
            wanted = f"the camera is for {camera.width}x{camera.height} px"
            raise SettingsError(f"{found}, and {wanted}; give frames of one size.")
    return show_frame(replace(scene, frames=tuple(frames)), 0)


def show_frame(scene: Scene, frame_index: int) -> Scene:
    """Show another frame. An object without a pose there stays where it is, without a result."""
    frame = scene.frames[frame_index]
    objects = []
    for item in scene.objects:
        known = frame.poses.get(item.id)
        place = item.world_from_model if known is None else known.world_from_model
        result = None if known is None else known.result
        objects.append(replace(item, world_from_model=place, start=None, result=result))
    # A new handle: photos of frames that were shown do not stay in memory.
    view, file = scene.views[0], frame.file
    view = view if view.file == file else replace(view, file=replace(file))
    return replace(scene, views=(view,), objects=tuple(objects), frame_index=frame_index)


def as_still(scene: Scene) -> Scene:
    """Return the shown frame as a scene of its own, with the masks and occluders of that frame."""
    if scene.frame is None:
        return scene
    objects = []
    for index, item in enumerate(scene.objects):
        own = scene.in_view(index)
        mask = Mask.product(tuple(filter(None, (own.mask, scene.frame.masks.get(item.id)))))
        occluders = Mask.product(scene.earlier_occluders(index))
        own = replace(own, mask=mask, occluders=occluders)
        objects.append(replace(item, in_views=() if own == InView() else (own,)))
    view = scene.views[0]
    mask = Mask.product(tuple(filter(None, (view.mask, scene.frame.mask))))
    views, objects = (replace(view, mask=mask),), tuple(objects)
    return replace(scene, views=views, objects=objects, frames=(), frame_index=0)


def key_indices(scene: Scene, object_id: str) -> list[int]:
    """Return the indices of the frames in which an object has a key."""
    poses = (frame.poses.get(object_id) for frame in scene.frames)
    return [index for index, pose in enumerate(poses) if pose and pose.source == "key"]


def store_poses(scene: Scene, poses: Mapping[int, Mapping[str, FramePose]]) -> Scene:
    """Store propagated poses, by frame and by object's id; keys and locked objects stay.

    The frame that is shown shows its new poses.
    """
    locked = {item.id for item in scene.objects if item.locked}
    frames = list(scene.frames)
    for index, by_object in poses.items():
        kept = frames[index].poses
        keys = {name for name, pose in kept.items() if pose.source == "key"}
        new = {name: by_object[name] for name in by_object if name not in keys | locked}
        frames[index] = replace(frames[index], poses={**kept, **new})
    scene = replace(scene, frames=tuple(frames))
    return show_frame(scene, scene.frame_index) if scene.frame_index in poses else scene


def store_key(scene: Scene, object_index: int) -> Scene:
    """Make a key of an object's pose in the frame that is shown.

    The object's propagated poses in the frames beside it become stale.
    """
    item, shown = scene.objects[object_index], scene.frame_index
    key = FramePose(world_from_model=item.world_from_model, result=item.result)
    scene = mark_stale(scene, item.id, shown - 1, shown + 1)
    return _with_pose(scene, item.id, key)


def remove_key(scene: Scene, object_index: int) -> Scene:
    """Remove an object's pose in the frame that is shown; all that was propagated up to the keys
    beside it becomes stale.
    """
    object_id = scene.objects[object_index].id
    before, after = neighbouring_keys(scene, object_id, scene.frame_index)
    return _with_pose(mark_stale(scene, object_id, before + 1, after - 1), object_id, None)


def mark_stale(scene: Scene, object_id: str, first: int, last: int) -> Scene:
    """Mark an object's propagated poses in some frames as stale; keys stay.

    Args:
        scene: sequence.
        object_id: of the object.
        first: index of the first frame.
        last: index of the last frame.
    """

    def make_stale(name: str, pose: FramePose) -> FramePose:
        is_kept = pose.source == "key" or name != object_id
        return pose if is_kept else replace(pose, is_stale=True)

    return change_poses(scene, make_stale, first, last)


def remove_propagated(scene: Scene, object_id: str, first: int, last: int) -> Scene:
    """Remove an object's propagated poses in some frames; keys stay.

    Args:
        scene: sequence.
        object_id: of the object.
        first: index of the first frame.
        last: index of the last frame.
    """

    def keep_key(name: str, pose: FramePose) -> FramePose | None:
        return pose if pose.source == "key" or name != object_id else None

    return show_frame(change_poses(scene, keep_key, first, last), scene.frame_index)


def neighbouring_keys(scene: Scene, object_id: str, frame_index: int) -> tuple[int, int]:
    """Return the frames of the keys before and after a frame; -1 and the number of frames where
    there is none.
    """
    keys = key_indices(scene, object_id)
    before = max((key for key in keys if key < frame_index), default=-1)
    return before, min((key for key in keys if key > frame_index), default=len(scene.frames))


def _with_pose(scene: Scene, object_id: str, pose: FramePose | None) -> Scene:
    """The sequence with an object's pose in the frame that is shown, or without one."""
    shown = scene.frame_index
    frame = scene.frames[shown]
    poses = {name: own for name, own in frame.poses.items() if name != object_id}
    poses |= {} if pose is None else {object_id: pose}
    frames = (*scene.frames[:shown], replace(frame, poses=poses), *scene.frames[shown + 1 :])
    return replace(scene, frames=frames)


def stale_notes(scene: Scene, indices: Collection[int] | None = None) -> list[str]:
    """Say how many poses of each object are stale in some frames; None: in all."""
    frames, notes = scene.frames, list[str]()
    chosen = range(len(frames)) if indices is None else indices
    for item in scene.objects:
        poses = [frames[index].poses[item.id] for index in chosen if item.id in frames[index].poses]
        if stale := sum(pose.is_stale for pose in poses):
            found = f"{item.label}: {stale} of {len(poses)} poses"
            are = "is" if stale == 1 else "are"
            notes.append(f"{found} {are} stale, as others have changed since: propagate them anew.")
    return notes


def change_poses(
    scene: Scene,
    change: Callable[[str, FramePose], FramePose | None],
    first: int = 0,
    last: int | None = None,
) -> Scene:
    """Change or remove poses in some frames.

    Args:
        scene: sequence.
        change: gives the new pose of an object's id and pose; None: without a pose.
        first: index of the first frame.
        last: index of the last frame; None: that of the sequence.
    """
    frames = list(scene.frames)
    end = len(frames) if last is None else min(last + 1, len(frames))
    for index in range(max(first, 0), end):
        old = frames[index].poses
        new = {name: pose for name, own in old.items() if (pose := change(name, own)) is not None}
        if any(new.get(name) is not pose for name, pose in old.items()):
            frames[index] = replace(frames[index], poses=new)
    return replace(scene, frames=tuple(frames))


def require_keys(scene: Scene, object_ids: Collection[str]) -> None:
    """Require a key of one of some objects.

    Raises:
        SettingsError: the scene is no sequence, or none of the objects has a key.
    """
    if not any(key_indices(scene, object_id) for object_id in object_ids):
        found = f"{scene.name or 'the scene'}: {len(scene.frames)} frames, and no pose is a key"
        raise SettingsError(f"{found}; place the model in a frame of a sequence.")
