"""Cameras by an object that stands still, which was followed through the frames."""

from dataclasses import replace
from pathlib import Path

from poseviewer.errors import PoseFileError, list_names
from poseviewer.files.scene_json import load_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import Scene
from poseviewer.still.still_cameras import StillCameras


def cameras_of_object(sequence: Path | Scene, object_id: str | None = None) -> StillCameras:
    """Take an object's poses in the frames of a sequence for the cameras' in its frame, the world.

    Args:
        sequence: scene of frames, or its file.
        object_id: of the object; None: the only one.

    Raises:
        PoseFileError: it is no sequence, or its camera is not perspective; the object is not there,
            has no poses in two frames, or is lost in others.
    """
    scene = sequence if isinstance(sequence, Scene) else load_scene(sequence)
    ids = [item.id for item in scene.objects]
    if not scene.frames:
        wanted = "wanted a sequence with the poses of an object"
        raise PoseFileError(f"{scene.name}: it has no frames; {wanted}.")
    if object_id is None and len(ids) != 1:
        found = f"{len(ids)} objects, {list_names(ids)}"
        raise PoseFileError(f"{scene.name}: {found}; name the one that stands still.")
    chosen = ids[0] if object_id is None else object_id
    item = scene.objects[scene.index(chosen)]
    view, views, left_out = scene.views[0], [], dict[str, str]()
    if not isinstance(view.camera, Perspective):
        raise PoseFileError(f"{scene.name}: its camera is parallel; wanted a perspective one.")
    for frame in scene.frames:
        own = frame.poses.get(chosen)
        verdict = None if own is None or own.result is None else own.result.verdict
        if own is None:
            left_out[frame.file.name] = f"no pose of {item.label}"
        elif verdict is not None and verdict.label == "lost":
            left_out[frame.file.name] = f"{item.label} is lost"
        else:
            place = view.camera_from_world @ own.world_from_model.rigid
            moved = place.translation / own.world_from_model.scale
            place = RigidTransform(place.rotation, moved)
            mask = view.mask if frame.mask is None else frame.mask
            views.append(replace(view, file=frame.file, camera_from_world=place, mask=mask))
    if len(views) < 2:
        found = f"{len(views)} of {len(scene.frames)} frames have poses of {item.label}"
        raise PoseFileError(f"{scene.name}: {found}; wanted two or more, track it first.")
    return StillCameras(
        scene.name, "object", tuple(views), item.model.unit, True, None, left_out
    )  # fmt: skip
