"""A whole input for a command: photo, model and poses, small enough to fit in a second."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import PlacedModel
from tests.meshes import make_bumpy
from tests.several import LIGHT, coloured, lit_models, save_model


@dataclass(frozen=True)
class Scene:
    """Paths of one registration."""

    photo: Path
    model: Path
    truth: Path
    start: Path


def make_scene(folder: Path) -> Scene:
    """Write the scene's files, with a photo that is good for testing commands, not for fits."""
    return make_scene_of(coloured(make_bumpy(3), (1.0, 0.8, 0.6)), folder)


def make_scene_of(
    mesh: Mesh, folder: Path, rotation_vector: Sequence[float] = (0.4, -0.3, 0.2)
) -> Scene:
    """Write the files of ``make_scene`` for another mesh and rotation (rad)."""
    scene = Scene(*(folder / name for name in ("p.png", "m.ply", "true.json", "start.json")))
    save_model(scene.model, mesh)
    pose = Pose(
        Perspective(300.0, 300.0, 83.0, 58.0, 160, 120),
        RigidTransform.from_rotation_vector(rotation_vector, [0.1, 0.05, 7.0]),
    )
    # Black ground, as the model is 0 there.
    pixels = lit_models([PlacedModel(mesh, pose)], LIGHT, np.random.default_rng(0), 0.0, 4.0)
    save_image(scene.photo, pixels)
    save_pose(scene.truth, PoseRecord.of(pose))
    start = FreeBodyChart.near(mesh, pose).to_pose(np.array([0.05, -0.06, 0.04, 0.05, -0.04, 0.05]))
    save_pose(scene.start, PoseRecord.of(start))
    return scene
