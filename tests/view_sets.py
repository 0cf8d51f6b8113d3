"""A shape seen by three cameras whose poses to one another are known: in memory, and as files."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseviewer.files.formats.bop import BopObject
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.files.scene_assets import view_of_file
from poseviewer.files.scene_json import save_scene
from poseviewer.files.structs import PhotoReference
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.image import Photo
from poseviewer.geometry.symmetry_group import Symmetry, SymmetryAxis
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.photo_sets import LoadedViews
from poseviewer.scene.assets import PhotoFile
from poseviewer.scene.types import PlacedModel, Scene, View
from tests.meshes import make_box, make_bumpy
from tests.several import coloured, lit_models, save_model, write_bop_scene
from tests.writing import write

CAMERA = Perspective(600.0, 600.0, 160.5, 120.5, 320, 240)
MESH = coloured(make_bumpy(3), (1.0, 0.8, 0.6))
NAMES = ("a.png", "b.png", "c.png")
DISTANCE = 12.0
LAST = [0.0, 0.0, 0.0, 1.0]
"""Row of a 4x4 matrix."""
SET_FROM_MODEL = RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [3.0, -1.0, 2.0])
OFF = np.array([0.15, -0.15, 0.12, 0.1, -0.08, 0.06])
"""Offset of the start: 14 degrees, an eighth of the radius, 6 % of the distance."""


def focal_length(camera: Camera) -> float:
    """Focal length of a perspective camera, px."""
    assert isinstance(camera, Perspective)
    return camera.fx


def camera_from_set(turn_deg: float, tilt_deg: float, aside: float) -> RigidTransform:
    """Pose, in the set, of a camera that looks past the model's centre from these angles."""
    turn = RigidTransform.from_rotation_vector([0.0, np.radians(turn_deg), 0.0], np.zeros(3))
    tilt = RigidTransform.from_rotation_vector([np.radians(tilt_deg), 0.0, 0.0], np.zeros(3))
    rotation = tilt.rotation @ turn.rotation
    centre = SET_FROM_MODEL.apply(MESH.centre)
    return RigidTransform(rotation, np.array([aside, 0.0, DISTANCE]) - rotation @ centre)


CAMERAS_FROM_SET = (
    camera_from_set(0.0, 0.0, 0.1),
    camera_from_set(35.0, -10.0, -0.15),
    camera_from_set(-30.0, 25.0, 0.0),
)
TRUTH = tuple(Pose(CAMERA, place @ SET_FROM_MODEL) for place in CAMERAS_FROM_SET)
START = FreeBodyChart.near(MESH, TRUTH[0]).to_pose(OFF)


@cache
def make_pixels(index: int, light: tuple[float, float, float]) -> NDArray[np.uint8]:
    """A photo of the shape on a dark ground with a blob beside it; smoothed and noisy."""
    ground = np.full((3 * CAMERA.height, 3 * CAMERA.width, 3), 0.08)
    cv2.circle(ground, (200 + 250 * index, 120), 60, (0.5, 0.3, 0.4), -1)
    placed = [PlacedModel(MESH, TRUTH[index])]
    return lit_models(placed, light, np.random.default_rng(index), ground)


BOX = coloured(make_box((1.3, 2.2, 0.9)), (0.5, 0.7, 1.0))
BOX_SYMMETRY = Symmetry.from_axes(BOX.centre, [SymmetryAxis(axis, 2) for axis in np.eye(3)])
SET_FROM_BOX = RigidTransform.from_rotation_vector(
    [0.5, 0.5, 0.1], SET_FROM_MODEL.apply(MESH.centre) + np.array([2.1, 0.2, 0.3])
)
BOX_TRUTH = tuple(Pose(CAMERA, place @ SET_FROM_BOX) for place in CAMERAS_FROM_SET)

LIGHTS = ((0.4, -0.7, -0.6), (-0.5, -0.5, -0.7), (0.1, -0.9, -0.4))
"""Unit: each photo has its own."""


def make_views(unit: float = 1.0, scale: float | None = 1.0) -> LoadedViews:
    """The set in memory; its lengths are ``unit`` of the model's."""
    views = []
    for index, place in enumerate(CAMERAS_FROM_SET):
        pixels = make_pixels(index, LIGHTS[index])
        photo = Photo(pixels, NAMES[index], f"{index}" * 64, camera=CAMERA)
        moved = RigidTransform(place.rotation, place.translation / unit)
        views.append(View(PhotoFile.of(photo), CAMERA, moved))
    return LoadedViews("set", tuple(views), None, scale)


def write_set(folder: Path, **fields: Any) -> Path:
    """Write a scene file without objects: the cameras of the photos, and other fields."""
    views = tuple(
        view_of_file(folder / name, CAMERA, camera_from_world=place)
        for name, place in zip(NAMES, CAMERAS_FROM_SET, strict=True)
    )
    save_scene(folder / "set.json", Scene(views=views, **fields))
    return folder / "set.json"


def write_views(folder: Path) -> tuple[Path, Path, Path]:
    """Photos, model, start and our own set file; returns the set's, the model's and the start's."""
    for index, name in enumerate(NAMES):
        save_image(folder / name, make_pixels(index, LIGHTS[index]))
    save_model(folder / "m.ply", MESH)
    save_pose(folder / "start.json", PoseRecord.of(START, PhotoReference(NAMES[0], 320, 240)))
    return write_set(folder), folder / "m.ply", folder / "start.json"


def write_two(folder: Path) -> tuple[Path, Path, Path]:
    """Write photos of shape and box; returns the cameras' file, of known scale, and models."""
    for index, name in enumerate(NAMES):
        placed = [PlacedModel(MESH, TRUTH[index]), PlacedModel(BOX, BOX_TRUTH[index])]
        lit = lit_models(placed, LIGHTS[index], np.random.default_rng(index))
        save_image(folder / name, lit)
    save_model(folder / "ball.ply", MESH)
    save_model(folder / "box.ply", BOX)
    return write_set(folder), folder / "ball.ply", folder / "box.ply"


def write_colmap(model: Path, names: Sequence[str] = NAMES) -> Path:
    """The cameras of the set as a COLMAP model in this folder."""
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("7 PINHOLE 320 240 600 600 160.5 120.5\n")
    lines = []
    for number, (name, place) in enumerate(zip(names, CAMERAS_FROM_SET, strict=True), 1):
        q = Rotation.from_matrix(place.rotation).as_quat(scalar_first=True)
        numbers = " ".join(map(repr, map(float, (*q, *place.translation))))
        lines += [f"{number} {numbers} 7 {name}", ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")
    return model


def write_frames(folder: Path, **shared: Any) -> Path:
    """Write a ``transforms.json``; ``shared``: what it says of all frames."""
    frames = []
    for name, place in zip(NAMES, CAMERAS_FROM_SET, strict=True):
        world = (OPENGL_FROM_OPENCV @ place).inverse()
        matrix = np.vstack([np.column_stack([world.rotation, world.translation]), LAST])
        frames.append({"file_path": f"./{Path(name).stem}", "transform_matrix": matrix.tolist()})
    return write(folder / "transforms.json", {**shared, "frames": frames})


def write_bop(folder: Path, with_world: bool) -> Path:
    """Write a BOP scene of object 5, with copies of the photos."""
    photos = {number: folder / name for number, name in enumerate(NAMES)}
    objects = {n: [BopObject(5, pose.camera_from_model)] for n, pose in enumerate(TRUTH)}
    worlds = dict(enumerate(CAMERAS_FROM_SET)) if with_world else None
    return write_bop_scene(folder / "bop", CAMERA, photos, objects, worlds)
