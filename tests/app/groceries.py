"""Groceries in one photo, one in front of another, and a post in front of the demo's car. The
things are ours, shaded and noisy: for testing the app, not for judging fits.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import load_photo, save_image
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.placing import look_from

SIZE = WIDTH, HEIGHT = 480, 320
CAMERA = Perspective(620.0, 620.0, 240.0, 160.0, WIDTH, HEIGHT)
LIGHT = np.array([0.5, -0.6, -0.62])  # unit length
TABLE = 0.35
SAMPLES = 3
"""Along a pixel's side."""


@dataclass(frozen=True)
class Thing:
    """What stands in a photo."""

    shape: trimesh.Trimesh
    colour: tuple[int, int, int]
    place: tuple[float, float, float]
    """Of its middle, by the camera's axes."""
    degrees: float
    """By which it is turned from a view of its corner."""


def box(*sides: float) -> trimesh.Trimesh:
    """Of small triangles, each on one printed field."""
    shape = trimesh.creation.box(extents=sides)
    for _ in range(4):
        shape = shape.subdivide()
    return shape


THREE = {
    "crackers.ply": Thing(box(1.6, 0.6, 2.1), (230, 70, 50), (-0.55, 0.1, 10.0), 4.0),
    "tea.ply": Thing(box(1.5, 1.0, 0.9), (60, 170, 90), (0.15, 0.55, 8.2), -5.0),
    "sugar.ply": Thing(box(0.9, 0.7, 1.7), (235, 210, 90), (1.35, 0.0, 9.6), 6.0),
}
"""The tea stands in front of the crackers."""
TWO_MORE = {
    "can.ply": Thing(
        trimesh.creation.cylinder(0.5, 1.2, sections=96).subdivide().subdivide(),
        (90, 130, 220), (2.5, 0.5, 9.0), 5.0,
    ),
    "orange.ply": Thing(
        trimesh.creation.icosphere(subdivisions=4, radius=0.6),
        (240, 150, 40), (-2.4, 0.5, 9.0), -6.0,
    ),
}  # fmt: skip
POST = Thing(box(0.16, 1.5, 0.16), (225, 215, 70), (-0.3, 0.25, 5.5), 7.0)
"""Metres; in front of the demo's car. A glTF file's y points upwards: it stands."""


@dataclass(frozen=True)
class Groceries:
    """Paths, and where all stand."""

    photo: Path
    models: tuple[Path, ...]
    truths: tuple[Pose, ...]
    start: Path
    """Of the first one."""


def make_groceries(folder: Path, five: bool = False) -> Groceries:
    """Write photo, models, and a start of the first model; of three things or ``five``."""
    folder.mkdir(exist_ok=True)
    table = np.full((HEIGHT, WIDTH, 3), TABLE)
    things = THREE | TWO_MORE if five else THREE
    picture, models, truths = _photographed(folder, table, CAMERA, things)
    photo, start = folder / "shelf.png", folder / "start.json"
    save_image(photo, picture)
    first = truths[0].camera_from_model
    moved = RigidTransform(first.rotation, first.translation + np.array([0.12, -0.08, 0.3]))
    save_pose(start, PoseRecord(Pose(CAMERA, moved)))
    return Groceries(photo, models, truths, start)


def make_car_behind_post(folder: Path) -> Groceries:
    """The demo at half its size, with a post in front of its car."""
    folder.mkdir(exist_ok=True)
    demo = demo_case()
    opened, start = load_photo(demo.photo), folder / "start.json"
    car, begin = (
        load_pose(path, opened.width, opened.height).pose.scaled(0.5)
        for path in (demo.truth, demo.start)
    )
    small = cv2.resize(opened.pixels, (480, 360), interpolation=cv2.INTER_AREA)
    behind = np.asarray(small, float) / 255.0
    picture, models, truths = _photographed(folder, behind, car.camera, {"post.glb": POST})
    save_image(folder / "car.png", picture)
    save_pose(start, PoseRecord(begin))
    return Groceries(folder / "car.png", (demo.model, *models), (car, *truths), start)


def _photographed(
    folder: Path, behind: FloatArray, camera: Camera, things: dict[str, Thing]
) -> tuple[np.ndarray, tuple[Path, ...], tuple[Pose, ...]]:
    """The picture of what is ``behind`` (height, width, 3; in [0, 1]) with things in front; their
    files and poses.
    """
    models, truths = [], []
    picture = behind.repeat(SAMPLES, axis=0).repeat(SAMPLES, axis=1)
    nearest = np.full(picture.shape[:2], np.inf)
    for seed, (name, thing) in enumerate(things.items()):
        path = _write_printed(folder / name, thing, seed)
        mesh = load_mesh(path)
        corner = look_from("three-quarter", mesh, None, camera).camera_from_model.rotation
        angles = [thing.degrees, thing.degrees / 2.0]
        rotation = Rotation.from_euler("yx", angles, degrees=True).as_matrix() @ corner
        pose = Pose(camera, RigidTransform(rotation, thing.place - rotation @ mesh.centre))
        large = pose.scaled(float(SAMPLES))
        renderer = SoftwareRenderer(mesh)
        image, depth = renderer.render(large), renderer.depth(large)
        lit = image.reflectance * (0.45 + 0.5 * image.normals @ LIGHT)[..., None]
        in_front = depth < nearest
        picture[in_front], nearest[in_front] = lit[in_front], depth[in_front]
        models.append(path)
        truths.append(pose)
    small = cv2.resize(picture, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    small = small + np.random.default_rng(0).normal(0.0, 0.01, small.shape)
    pixels = np.rint(np.clip(small, 0.0, 1.0) * 255.0).astype(np.uint8)
    return pixels, tuple(models), tuple(truths)


def _write_printed(path: Path, thing: Thing, seed: int) -> Path:
    """A shape of one colour with printed fields, each face its own."""
    shape, random = thing.shape, np.random.default_rng(seed)
    faces = shape.triangles_center / shape.extents
    fields = (
        np.floor(4.0 * (faces + 0.5)).astype(int) + 5 * np.argmax(np.abs(faces), axis=1)[:, None]
    )
    print_of = 0.35 + 0.65 * random.random((20, 20, 20, 1))
    shade = print_of[tuple(fields.T)]
    corners = shape.vertices[shape.faces].reshape(-1, 3)
    colours = np.repeat(np.rint(shade * np.array(thing.colour)), 3, axis=0).astype(np.uint8)
    printed = trimesh.Trimesh(
        corners, np.arange(len(corners)).reshape(-1, 3), vertex_colors=colours, process=False
    )
    printed.export(str(path))
    return path
