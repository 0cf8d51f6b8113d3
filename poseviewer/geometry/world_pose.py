"""Poses of a model in the world and in the cameras that stand there."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.transform import RigidTransform, Similarity

WORLD = RigidTransform.identity()
"""``camera_from_world`` of a camera whose frame is the world."""
MIN_PARALLAX = 1e-3
"""Sine of the angle between viewing rays from which their intersection is accurate."""
POSES_KEPT = 4096
"""Poses that are cached by identity: more than undo steps, objects and views."""


@lru_cache(maxsize=POSES_KEPT)
def pose_in_view(
    camera: Camera, camera_from_world: RigidTransform, world_from_model: Similarity
) -> Pose:
    """Return the pose in a camera, in the model's unit, of a model in the world; cached."""
    camera_from_model, size = camera_from_world @ world_from_model.rigid, world_from_model.scale
    if size == 1.0:
        return Pose(camera, camera_from_model)
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=camera.scale * size)
    rotation, translation = camera_from_model.rotation, camera_from_model.translation
    return Pose(camera, RigidTransform(rotation, translation / size))


@lru_cache(maxsize=POSES_KEPT)
def world_from_pose(
    camera: Camera, camera_from_world: RigidTransform, pose: Pose, scale: float = 1.0
) -> Similarity:
    """Return ``world_from_model`` of a model that a camera shows at a pose; cached.

    Args:
        camera: camera in the world.
        camera_from_world: pose of the world in that camera.
        pose: pose of the model, perhaps with a camera of another scale.
        scale: length of the model's unit in the world's; parallel cameras give it themselves.
    """
    if isinstance(pose.camera, Parallel) and isinstance(camera, Parallel):
        scale = pose.camera.scale / camera.scale
    own = pose.camera_from_model
    scaled = RigidTransform(own.rotation, scale * own.translation)
    return Similarity(camera_from_world.inverse() @ scaled, scale)


def triangulate_scale(
    cameras: Sequence[tuple[Camera, RigidTransform]], reference: int, ray: FloatArray, depth: float
) -> float | None:
    """Return the scale by which a point on a viewing ray is where the other cameras look.

    Args:
        cameras: each camera, and its pose ``camera_from_world`` in the world.
        reference: index of the camera whose ray it is.
        ray: (3,), z = 1, in the frame of that camera.
        depth: depth of the point along the ray, in the model's unit.

    Returns:
        Lengths of the model's unit in one of the world's; None where the other cameras' viewing
        rays do not meet that ray.
    """
    own = cameras[reference][1].inverse()
    start, along = own.translation, own.rotation @ ray
    left, right = 0.0, 0.0
    for index, (camera, camera_from_world) in enumerate(cameras):
        if index == reference or isinstance(camera, Parallel):
            continue
        world_from_camera = camera_from_world.inverse()
        middle = np.array([camera.width / 2.0, camera.height / 2.0])
        axis = world_from_camera.rotation @ camera.rays(middle)
        axis /= np.linalg.norm(axis)
        across = np.eye(3) - np.outer(axis, axis)
        left += float(along @ across @ along)
        right += float(along @ across @ (world_from_camera.translation - start))
    if not left > MIN_PARALLAX**2 * float(along @ along) or not right > 0.0:
        return None
    return depth * left / right
