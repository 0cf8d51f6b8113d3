"""How far the model is from the camera: for the clip planes of tools that draw it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform

NEAREST = 1e-3
"""The near plane, in the model's diameters at the least: for cameras inside the model."""


@dataclass(frozen=True, slots=True)
class ViewDepths:
    """Distances along the view, in the model's unit."""

    near: float
    """A plane before all of the model."""
    far: float
    """The model's furthest point."""


def view_depths(pose: Pose, mesh: Mesh) -> ViewDepths:
    """The distances of a model at a pose."""
    depths = pose.camera_from_model.apply(mesh.vertices)[:, 2]
    least = NEAREST * mesh.diameter
    return ViewDepths(max(0.5 * float(depths.min()), least), max(float(depths.max()), 2.0 * least))


def in_front(pose: Pose, mesh: Mesh) -> Pose:
    """The pose with the model before the camera: parallel projection has no depth to keep."""
    if not isinstance(pose.camera, Parallel):
        return pose
    place = pose.camera_from_model
    depth = float(place.apply(mesh.vertices)[:, 2].min())
    shift = np.array([0.0, 0.0, max(mesh.diameter - depth, 0.0)])
    return replace(
        pose, camera_from_model=RigidTransform(place.rotation, place.translation + shift)
    )
