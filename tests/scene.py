"""A whole input for a command: photo, model and poses, small enough to fit in a second."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_bumpy
from tests.several import save_model

LIGHT = np.array([0.4, -0.7, -0.6])  # unit length and never a shadow: the lit part stays positive


@dataclass(frozen=True)
class Scene:
    """Paths of one registration."""

    photo: Path
    model: Path
    truth: Path
    start: Path


def make_scene(folder: Path) -> Scene:
    """Write the scene's files. The photo is ours, smoothed and noisy: for testing commands, not
    for judging fits (those are tested on photos of another hand)."""
    ball = make_bumpy(3)
    # One pigment of varying strength: grey reflectance explains its colour photo.
    mesh = replace(ball, colours=ball.colours[:, :1] * np.array([1.0, 0.8, 0.6], np.float32))
    return make_scene_of(mesh, folder)


def make_scene_of(mesh: Mesh, folder: Path) -> Scene:
    """Write the files of ``make_scene`` for another mesh."""
    scene = Scene(*(folder / name for name in ("p.png", "m.ply", "true.json", "start.json")))
    save_model(scene.model, mesh)
    pose = Pose(
        Perspective(300.0, 300.0, 83.0, 58.0, 160, 120),
        RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [0.1, 0.05, 7.0]),
    )
    image = SoftwareRenderer(mesh).render(pose.scaled(4.0))
    lit = image.reflectance * (0.5 + 0.45 * image.normals @ LIGHT)[..., None]
    lit = np.where(image.mask[..., None], lit, 0.0)  # black ground: as M is 0 there
    small = cv2.resize(lit, (160, 120), interpolation=cv2.INTER_AREA)
    small = small + np.random.default_rng(0).normal(0.0, 0.01, small.shape)
    save_image(scene.photo, np.rint(np.clip(small, 0.0, 1.0) * 255.0).astype(np.uint8))
    save_pose(scene.truth, PoseRecord(pose))
    start = FreeBodyChart.near(mesh, pose).to_pose(np.array([0.05, -0.06, 0.04, 0.05, -0.04, 0.05]))
    save_pose(scene.start, PoseRecord(start))
    return scene
