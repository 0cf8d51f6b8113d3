"""Three boxes of groceries in one photo, one in front of another. The photo is ours, shaded and
noisy: for testing the app, not for judging fits.
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
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.placing import look_from

SIZE = WIDTH, HEIGHT = 480, 320
CAMERA = Perspective(620.0, 620.0, 240.0, 160.0, WIDTH, HEIGHT)
LIGHT = np.array([0.5, -0.6, -0.62])  # unit length
TABLE = 0.35
SAMPLES = 3
"""Along a pixel's side."""
BOXES = {
    "crackers.ply": ((1.6, 0.6, 2.1), (230, 70, 50), (-0.55, 0.1, 10.0), 4.0),
    "tea.ply": ((1.5, 1.0, 0.9), (60, 170, 90), (0.15, 0.55, 8.2), -5.0),
    "sugar.ply": ((0.9, 0.7, 1.7), (235, 210, 90), (1.35, 0.0, 9.6), 6.0),
}
"""Sides, colour, place of the middle by the camera's axes, and degrees that it is turned from a
view of its corner. The tea stands in front of the crackers."""


@dataclass(frozen=True)
class Groceries:
    """Paths, and where all stand."""

    photo: Path
    models: tuple[Path, ...]
    truths: tuple[Pose, ...]
    start: Path
    """Of the first one."""


def make_groceries(folder: Path) -> Groceries:
    """Write photo, models, and a start of the first model."""
    folder.mkdir(exist_ok=True)
    models, truths = [], []
    nearest = np.full((SAMPLES * HEIGHT, SAMPLES * WIDTH), np.inf)
    picture = np.full((*nearest.shape, 3), TABLE)
    for seed, (name, (sides, colour, place, degrees)) in enumerate(BOXES.items()):
        path = _write_box(folder / name, sides, colour, seed)
        mesh = load_mesh(path)
        corner = look_from("three-quarter", mesh, None, CAMERA).camera_from_model.rotation
        turn = Rotation.from_euler("yx", [degrees, degrees / 2.0], degrees=True).as_matrix()
        rotation = turn @ corner
        pose = Pose(CAMERA, RigidTransform(rotation, place - rotation @ mesh.centre))
        large = pose.scaled(float(SAMPLES))
        renderer = SoftwareRenderer(mesh)
        image, depth = renderer.render(large), renderer.depth(large)
        lit = image.reflectance * (0.45 + 0.5 * image.normals @ LIGHT)[..., None]
        in_front = depth < nearest
        picture[in_front], nearest[in_front] = lit[in_front], depth[in_front]
        models.append(path)
        truths.append(pose)
    small = cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA)
    small = small + np.random.default_rng(0).normal(0.0, 0.01, small.shape)
    photo, start = folder / "shelf.png", folder / "start.json"
    save_image(photo, np.rint(np.clip(small, 0.0, 1.0) * 255.0).astype(np.uint8))
    first = truths[0].camera_from_model
    moved = RigidTransform(first.rotation, first.translation + np.array([0.12, -0.08, 0.3]))
    save_pose(start, PoseRecord(Pose(CAMERA, moved)))
    return Groceries(photo, tuple(models), tuple(truths), start)


def _write_box(path: Path, sides: tuple[float, ...], colour: tuple[int, ...], seed: int) -> Path:
    """A box of one colour with printed fields, each face its own."""
    random = np.random.default_rng(seed)
    box = trimesh.creation.box(extents=sides)
    for _ in range(4):
        box = box.subdivide()
    faces = box.triangles_center / np.array(sides)
    fields = (
        np.floor(4.0 * (faces + 0.5)).astype(int) + 5 * np.argmax(np.abs(faces), axis=1)[:, None]
    )
    print_of = 0.35 + 0.65 * random.random((20, 20, 20, 1))
    shade = print_of[tuple(fields.T)]
    corners = box.vertices[box.faces].reshape(-1, 3)
    colours = np.repeat(np.rint(shade * np.array(colour)), 3, axis=0).astype(np.uint8)
    shape = trimesh.Trimesh(
        corners, np.arange(len(corners)).reshape(-1, 3), vertex_colors=colours, process=False
    )
    shape.export(str(path))
    return path
