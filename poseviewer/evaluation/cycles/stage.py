"""What Blender gets: the vehicle upright, z up, its lowest point at 0; what it is made of; and the
scene about it, drawn at random: sun, surroundings, ground and paint.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Literal, get_args

import cv2
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
PAINTS = (
    (0.75, 0.76, 0.78),
    (0.86, 0.86, 0.84),
    (0.10, 0.10, 0.11),
    (0.45, 0.46, 0.48),
    (0.55, 0.06, 0.07),
    (0.07, 0.20, 0.45),
    (0.12, 0.30, 0.20),
    (0.55, 0.45, 0.32),
)
"""Display-encoded RGB of cars: silver, white, black, grey, red, blue, green, sand."""
SUN_RISE_DEG, SUN_TURN_DEG, SUN_ANGLE_DEG = (22.0, 65.0), 100.0, (0.6, 6.0)
"""Above the horizon; to either side of the photographer; across: behind haze it is wider."""
AROUND_WIDTH, AROUND_HEIGHT = 1024, 512
"""Of the equirectangular picture: a turn about the vertical, and from zenith to nadir."""
PHOTO_LOWEST_DEG, PHOTO_HIGHEST_DEG = -30.0, 50.0
"""Between which a photo is stretched; above and below, its first and last row go on."""
GLARE, GLARE_FROM = 3.0, 0.8
"""How much brighter than its photo shows it a clipped sky is, and from which light on."""


@dataclass(frozen=True, slots=True, eq=False)
class StagedVehicle:
    """The vehicle turned upright, and the camera that sees it exactly as the pose does."""

    mesh: Mesh
    """``vertices`` and ``normals`` in the stage's frame; z is up, x along the vehicle."""
    pose: Pose
    """``camera_from_model`` is the camera from the stage."""


def make_stage(mesh: Mesh, keypoints: VehicleKeypoints, pose: Pose) -> StagedVehicle:
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
    return StagedVehicle(
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


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What a vehicle is photographed in; directions are the stage's: z up, x ahead, y left."""

    sun_towards: FloatArray
    """(3,), towards the sun."""
    sun_light: FloatArray
    """(3,): linear RGB that a white surface facing the sun gains."""
    sun_angle: float
    """Diameter of the sun in the sky, radians: shadows are the softer the larger it is."""
    surroundings: NDArray[np.float32]
    """(h, w, 3) linear RGB, in all directions, rows from the zenith down."""
    ground: FloatArray
    """(3,): linear RGB reflectance of the ground, as the paint mirrors it."""
    behind: NDArray[np.float32]
    """(3,) or (h, w, 3) display-encoded RGB in [0, 1]: what the shadow falls on, and all else."""
    paint: FloatArray | None = None
    """(3,): display-encoded RGB of another paint; None: the model's own."""
    exposure: float = 1.0
    seed: int = 0


def random_scene(
    pose: Pose,
    keypoints: VehicleKeypoints,
    behind: NDArray[np.uint8] | FloatArray,
    repainted: bool,
    random: np.random.Generator,
) -> Surroundings:
    """Daylight on a vehicle before a photo (h, w, 3) uint8, or a plain of one colour (3,).

    The sun is somewhere on the photographer's side.
    """
    towards_camera = -(upright(keypoints) @ pose.camera_from_model.rotation[2])
    azimuth = math.atan2(towards_camera[1], towards_camera[0])
    azimuth += math.radians(random.uniform(-SUN_TURN_DEG, SUN_TURN_DEG))
    rise = math.radians(random.uniform(*SUN_RISE_DEG))
    level = math.cos(rise)
    towards = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(rise)])
    if behind.ndim == 1:
        picture = np.asarray(behind, np.float32)
        ground = linear_from_srgb(picture)
        around = around_plain(np.asarray(ground, float), random)
    else:
        height, width = pose.camera.height, pose.camera.width
        photo = np.asarray(behind, np.uint8)
        picture = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA) / np.float32(255)
        around = around_photo(photo)
        ground = linear_from_srgb(picture[-max(1, height // 6) :]).mean(axis=(0, 1))
    paint = np.array(PAINTS[int(random.integers(len(PAINTS)))])
    return Surroundings(
        sun_towards=towards,
        sun_light=random.uniform(0.5, 1.1) * np.array([1.0, 0.95, 0.87]),
        sun_angle=math.radians(random.uniform(*SUN_ANGLE_DEG)),
        surroundings=scaled_to(around, random.uniform(0.35, 0.6)),
        ground=np.asarray(ground, float),
        behind=np.asarray(picture, np.float32),
        paint=paint if repainted else None,
        exposure=random.uniform(1.0, 1.5),
        seed=int(random.integers(2**31)),
    )


def around_photo(photo: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(512, 1024, 3) linear RGB, rows from the zenith down: a photo (h, w, 3) and its mirror image
    side by side, closing the circle.
    """
    both = np.concatenate([photo, photo[:, ::-1]], axis=1)
    top, bottom = (
        round((90.0 - edge) / 180.0 * AROUND_HEIGHT)
        for edge in (PHOTO_HIGHEST_DEG, PHOTO_LOWEST_DEG)
    )
    small = cv2.resize(both, (AROUND_WIDTH, bottom - top), interpolation=cv2.INTER_AREA)
    band = linear_from_srgb(small / 255.0)
    rows = np.clip(np.arange(AROUND_HEIGHT) - top, 0, bottom - top - 1)
    # The sky above and the ground below are as bright all around, or streaks would meet there.
    band[0], band[-1] = band[0].mean(axis=0), band[-1].mean(axis=0)
    light = band[rows]
    over = np.clip((light - GLARE_FROM) / (1.0 - GLARE_FROM), 0.0, 1.0)
    return (light * (1.0 + (GLARE - 1.0) * over)).astype(np.float32)


def around_plain(ground: FloatArray, random: np.random.Generator) -> NDArray[np.float32]:
    """(512, 1024, 3) linear RGB: a plain of ``ground`` (3,), linear RGB, hills, a clear sky."""
    rise = 90.0 - (np.arange(AROUND_HEIGHT) + 0.5) / AROUND_HEIGHT * 180.0
    haze, zenith = np.array([0.75, 0.80, 0.88]), np.array([0.22, 0.38, 0.72])
    share = np.clip(rise / 60.0, 0.0, 1.0)[:, None] ** 0.6
    rows = np.where(rise[:, None] < 0.0, ground, (1.0 - share) * haze + share * zenith)
    light = np.repeat(rows[:, None], AROUND_WIDTH, axis=1)
    hills = np.array([0.10, 0.13, 0.08]) * random.uniform(0.6, 1.4)
    is_hill = (rise[:, None] >= 0.0) & (rise[:, None] < _skyline(random))
    light[is_hill] = hills
    return light.astype(np.float32)


def scaled_to(light: NDArray[np.float32], ambient: float) -> NDArray[np.float32]:
    """The same, so bright that a white ground is lit to ``ambient`` by its upper half alone."""
    rise = np.pi * (0.5 - (np.arange(AROUND_HEIGHT // 2) + 0.5) / AROUND_HEIGHT)
    # Of Lambert's cosine and the solid angle of a row's pixels: their sum is 1.
    weights = np.sin(rise) * np.cos(rise)
    grey = light[: AROUND_HEIGHT // 2].mean(axis=(1, 2))
    return np.float32(ambient / max(float(grey @ weights / weights.sum()), 1e-6)) * light


def _skyline(random: np.random.Generator) -> FloatArray:
    """(w,): degrees above the horizon, once around without a step."""
    turn = np.linspace(0.0, 2.0 * math.pi, AROUND_WIDTH, endpoint=False)
    waves = [random.uniform(0.3, 2.5) / n * np.sin(n * turn + random.uniform(0, 6.3))
             for n in range(1, 12)]  # fmt: skip
    return 6.0 + np.sum(waves, axis=0)
