"""The world in which a vehicle is path-traced: z up, the vehicle's lowest point at 0."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.keypoints import VehicleKeypoints

DIAMETER = 5.0
"""Of the vehicle in the stage, in Blender's metres: its tolerances are made for such sizes."""
PARALLEL_DEPTH = 100.0
"""How far away a parallel camera stands, so that all shadows lie before it."""
FURTHEST = 1000.0


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """The vehicle turned upright, and the camera that sees it exactly as the pose does."""

    mesh: Mesh
    """``vertices`` and ``normals`` in the stage's frame; z is up, x along the vehicle."""
    pose: Pose
    """``camera_from_model`` is the camera from the stage."""


def make_stage(mesh: Mesh, keypoints: VehicleKeypoints, pose: Pose) -> Stage:
    """A similarity takes the model to the stage; the camera follows, so the picture is the same:
    under perspective it depends on ratios of lengths alone, under parallel projection its scale
    makes up for them.
    """
    turn = upright(keypoints)
    size = DIAMETER / mesh.diameter
    placed = size * mesh.vertices @ turn.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    floor = np.array([*(low + high)[:2] / 2.0, low[2]])
    camera, place = pose.camera, pose.camera_from_model
    # In the camera, x' = size (R x + t) and x = turn^T (s + floor) / size.
    rotation = place.rotation @ turn.T
    translation = rotation @ floor + size * place.translation
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=camera.scale / size)
        translation[2] = PARALLEL_DEPTH
    return Stage(
        replace(mesh, vertices=placed - floor, normals=mesh.normals @ turn.T),
        Pose(camera, RigidTransform(rotation, translation)),
    )


def upright(keypoints: VehicleKeypoints) -> FloatArray:
    """(3, 3): rotation of the stage from the model; its x runs along the vehicle, z up."""
    side = keypoints.left
    along = (side.front_wheel - side.rear_wheel) / side.wheelbase
    return np.stack([along, side.axle, np.cross(along, side.axle)])
