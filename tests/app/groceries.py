"""Groceries in one photo, one in front of another: ours, shaded and noisy, for testing the app, not
for judging fits.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
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


THINGS = {
    "crackers.ply": Thing(box(1.6, 0.6, 2.1), (230, 70, 50), (-0.55, 0.1, 10.0), 4.0),
    "tea.ply": Thing(box(1.5, 1.0, 0.9), (60, 170, 90), (0.15, 0.55, 8.2), -5.0),
    "sugar.ply": Thing(box(0.9, 0.7, 1.7), (235, 210, 90), (1.35, 0.0, 9.6), 6.0),
    "can.ply": Thing(
        trimesh.creation.cylinder(0.5, 1.2, sections=96).subdivide().subdivide(),
        (90, 130, 220), (2.5, 0.5, 9.0), 5.0,
    ),
    "orange.ply": Thing(
        trimesh.creation.icosphere(subdivisions=4, radius=0.6),
        (240, 150, 40), (-2.4, 0.5, 9.0), -6.0,
    ),
}  # fmt: skip
"""The tea stands in front of the crackers."""


@dataclass(frozen=True)
class Groceries:
    """Paths, and where all stand."""

    photo: Path
    models: tuple[Path, ...]
    truths: tuple[Pose, ...]
    start: Path
    """Of the first one."""


def make_groceries(folder: Path) -> Groceries:
    """Write photo, five models, and a start of the first model."""
    folder.mkdir(exist_ok=True)
    table = np.full((HEIGHT, WIDTH, 3), TABLE)
    picture, models, truths = _photographed(folder, table, CAMERA, THINGS)
    photo, start = folder / "shelf.png", folder / "start.json"
    save_image(photo, picture)
    first = truths[0].camera_from_model
    moved = RigidTransform(first.rotation, first.translation + np.array([0.12, -0.08, 0.3]))
    save_pose(start, PoseRecord(Pose(CAMERA, moved)))
    return Groceries(photo, models, truths, start)


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
