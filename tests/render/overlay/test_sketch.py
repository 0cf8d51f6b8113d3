"""The outline that needs nothing compiled, against the rasteriser's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.overlay.contour import Sketch, quick_silhouette
from poseviewer.render.software.software_renderer import SoftwareRenderer
from tests.meshes import make_box, make_sphere

MESHES = {"box": make_box(), "ball": make_sphere(6)}
CAMERAS = {
    "perspective": Perspective(500.0, 500.0, 310.0, 250.0, 640, 480),
    "parallel": Parallel(120.0, 310.0, 250.0, 640, 480),
}


def filled(segments: np.ndarray) -> np.ndarray:
    """(480, 640): what an outline, drawn in one go, encloses."""
    lines = np.zeros((482, 642), np.uint8)
    for start, end in np.rint(segments).astype(int) + 1:
        cv2.line(lines, start.tolist(), end.tolist(), 1)
    cv2.floodFill(lines, None, (0, 0), (2,))
    return lines[1:-1, 1:-1] != 2


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_a_sketch_covers_what_the_rasteriser_covers(mesh, camera):
    pose = Pose(camera, RigidTransform.from_rotation_vector([0.4, -0.7, 0.2], [0.3, -0.1, 6.0]))
    sketched = filled(quick_silhouette(mesh, Sketch(mesh), pose))
    drawn = filled(quick_silhouette(mesh, SoftwareRenderer(mesh), pose))
    assert np.sum(sketched & drawn) > 0.97 * np.sum(sketched | drawn) > 1000


@pytest.mark.parametrize("place", [[0.0, 0.0, -6.0], [900.0, 0.0, 6.0]])
def test_of_a_model_out_of_sight_nothing_is_sketched(place):
    pose = Pose(CAMERAS["perspective"], RigidTransform(np.eye(3), np.array(place)))
    assert not Sketch(MESHES["ball"]).covers(pose).any()


def test_a_model_that_the_camera_is_in_is_sketched_without_overflow():
    pose = Pose(CAMERAS["perspective"], RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.1])))
    assert Sketch(MESHES["ball"]).covers(pose).any()
