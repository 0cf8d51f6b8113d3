"""A view: a photo, its camera, and where that camera stands in the world."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform, Similarity

WORLD = RigidTransform.identity()
"""``camera_from_world`` of a camera whose frame is the world."""
LEAST_PARALLAX = 1e-3
"""Sine of the angle between lines of sight from which they are said to meet."""
POSES_KEPT = 4096
"""Number of poses that are told apart by identity: more than undo steps, objects and views."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A photo of a scene."""

    name: str
    """Name of the photo's file, with its folder where two views would else share a name."""
    photo: Photo
    """Undistorted where a lens is known."""
    camera: Camera
    """Camera of ``photo``."""
    camera_from_world: RigidTransform = WORLD
    """Pose of the world, in its unit; by default the world is the camera's frame."""
    mask: Mask | None = None
    """Weight of each pixel for all objects; None: all count."""
    path: Path | None = None
    """The photo's file; None: there is none."""

    def pose(self, world_from_model: Similarity) -> Pose:
        """The pose by which this view shows a model, as ``pose_in_view``."""
        return pose_in_view(self.camera, self.camera_from_world, world_from_model)

    def world_from_model(self, pose: Pose, scale: float = 1.0) -> Similarity:
        """The inverse of ``pose``, as ``world_from_pose``."""
        return world_from_pose(self.camera, self.camera_from_world, pose, scale)


@lru_cache(maxsize=POSES_KEPT)
def pose_in_view(camera: Camera, camera_from_world: RigidTransform, place: Similarity) -> Pose:
    """The pose, in the model's unit, of a model at a ``place`` in the world, cached."""
    camera_from_model, size = camera_from_world @ place.rigid, place.scale
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
    """The place in the world of a model that a camera shows at a ``pose``; ``scale``: lengths of
    the world's unit to one of the model's, which the cameras tell under parallel projection.
    """
    if isinstance(pose.camera, Parallel) and isinstance(camera, Parallel):
        scale = pose.camera.scale / camera.scale
    place = pose.camera_from_model
    place = RigidTransform(place.rotation, scale * place.translation)
    return Similarity(camera_from_world.inverse() @ place, scale)


def scale_by_sight(
    views: Sequence[View], reference: int, ray: FloatArray, depth: float
) -> float | None:
    """The scale by which a point at a ``depth``, in the model's unit, along a ``ray`` (3,), z = 1,
    of view ``reference`` is where the others look; None where their sights do not meet that ray.
    """
    own = views[reference].camera_from_world.inverse()
    start, along = own.translation, own.rotation @ ray
    left, right = 0.0, 0.0
    for index, view in enumerate(views):
        if index == reference or isinstance(view.camera, Parallel):
            continue
        world_from_camera = view.camera_from_world.inverse()
        middle = np.array([view.camera.width / 2.0, view.camera.height / 2.0])
        sight = world_from_camera.rotation @ view.camera.rays(middle)
        sight /= np.linalg.norm(sight)
        across = np.eye(3) - np.outer(sight, sight)
        left += float(along @ across @ along)
        right += float(along @ across @ (world_from_camera.translation - start))
    if not left > LEAST_PARALLAX**2 * float(along @ along) or not right > 0.0:
        return None
    return depth * left / right
