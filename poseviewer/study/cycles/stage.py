"""The vehicle as Blender gets it: upright, z up, its lowest point at 0; and what it is made of."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.files.mesh.load import linear_from_srgb
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.keypoints import VehicleKeypoints

DIAMETER = 5.0
"""Of the vehicle in the stage, in Blender's metres: its tolerances are made for such sizes."""
PARALLEL_DEPTH = 100.0
"""How far away a parallel camera stands, so that all shadows lie before it."""
FURTHEST = 1000.0
Finish = Literal["paint", "plastic", "rubber", "metal", "glass"]
FINISHES: tuple[Finish, ...] = get_args(Finish)
NAMED: tuple[tuple[Finish, str], ...] = (
    ("rubber", r"tyre|tire|rubber"),
    ("plastic", r"trim|edge|liner|bezel|wiper"),
    ("metal", r"rim\b|wheel|chrome|mirror glass|exhaust|badge|lamp (projector|left|right)"),
    ("glass", r"glass|window|windscreen|windshield"),
)
"""The first that a part's name holds."""
SHADES = 24
"""Steps per channel within which colours count as the same paint."""


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


def find_finishes(mesh: Mesh) -> NDArray[np.int32]:
    """(F,) indices into ``FINISHES``. Paint is the colour of most of the surface whose part has no
    telling name; of the rest, what has another colour is plastic.
    """
    of_part = [_by_name(name) for name in mesh.part_names]
    finishes = np.array(of_part, np.int32)[mesh.face_part]
    is_open = finishes < 0
    _, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    shades = np.rint(mesh.colours[mesh.faces].mean(axis=1) * SHADES).astype(np.int64)
    codes = shades @ [(SHADES + 1) ** 2, SHADES + 1, 1]
    if is_open.any():
        kinds, which = np.unique(codes[is_open], return_inverse=True)
        paint = kinds[np.argmax(np.bincount(which, areas[is_open]))]
        finishes[is_open & (codes == paint)] = FINISHES.index("paint")
    finishes[finishes < 0] = FINISHES.index("plastic")
    return finishes


def corner_colours(
    mesh: Mesh, finishes: NDArray[np.int32], paint: ArrayLike | None
) -> NDArray[np.float32]:
    """(F, 3, 3) linear RGB of the faces' corners; ``paint``: display-encoded RGB of a new coat."""
    colours = np.array(mesh.colours[mesh.faces], np.float32)
    if paint is not None:
        colours[finishes == FINISHES.index("paint")] = np.asarray(paint, np.float32)
    return linear_from_srgb(colours).astype(np.float32)


def _by_name(name: str) -> int:
    for finish, pattern in NAMED:
        if re.search(pattern, name.lower()):
            return FINISHES.index(finish)
    return -1
