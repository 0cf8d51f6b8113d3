"""A photo of two boxes of one model, with print on them."""

from pathlib import Path

import numpy as np

from poseviewer.files.photo import save_image
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import PlacedModel
from tests.meshes import make_printed
from tests.scene import Scene
from tests.several import LIGHT, lit_models, save_model

CAMERA = Perspective.from_field_of_view(50.0, 640, 480)
MESH = make_printed()
PLACES = ([0.5, 0.6, -0.1], [-1.6, 0.1, 8.0]), ([0.3, -0.5, 2.2], [1.5, 0.2, 9.0])
POSES = (Pose(CAMERA, RigidTransform.from_rotation_vector(*place)) for place in PLACES)
TRUTH = [PlacedModel(MESH, pose) for pose in POSES]


def make_two(folder: Path) -> Scene:
    """Write ``two.png`` and ``carton.ply``; nobody knows the poses."""
    save_model(folder / "carton.ply", MESH)
    save_image(folder / "two.png", lit_models(TRUTH, LIGHT, np.random.default_rng(0), 0.3))
    return Scene(folder / "two.png", folder / "carton.ply", folder / "none", folder / "none")


def off(pose: Pose) -> float:
    """Distance from the nearer one of the boxes, % of its size."""
    return min(pose_error(MESH, pose, own.pose).percent for own in TRUTH)
