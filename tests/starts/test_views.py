"""A model whose outline is to fill a rectangle does, whatever its rotation and the camera."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.starts.automatic import outline_box
from poseviewer.starts.views import ground_views, poses_filling, sample_rotations
from tests.app.state.documents import make_keypoints
from tests.meshes import make_box

CAR = make_box((4.0, 1.7, 1.3))
BOX = Rectangle(20.0, 70.0, 60.0, 35.0)
CAMERAS = (Perspective(150.0, 140.0, 83.0, 58.0, 160, 120), Parallel(1.0, 83.0, 58.0, 160, 120))


@pytest.mark.parametrize("camera", CAMERAS)
def test_outlines_have_the_middle_and_the_size_of_the_rectangle(camera):
    fits = poses_filling(BOX, sample_rotations(60), CAR.vertices, CAR.centre, camera)
    assert len(fits.poses) == 60
    for pose, misshapen in zip(fits.poses, fits.aspect_errors, strict=True):
        seen = outline_box(pose, CAR.vertices)
        np.testing.assert_allclose(seen.centre, BOX.centre, atol=0.5)
        assert seen.width * seen.height == pytest.approx(BOX.width * BOX.height, rel=0.04)
        aspect = np.log(seen.width / seen.height) - np.log(BOX.width / BOX.height)
        assert misshapen == pytest.approx(abs(aspect), abs=1e-6)


def test_even_rotations_leave_no_gap():
    rotations = Rotation.from_matrix(sample_rotations(2000))
    asked = Rotation.random(300, rng=np.random.default_rng(0))
    nearest = [float((one.inv() * rotations).magnitude().min()) for one in asked]
    assert np.degrees(max(nearest)) < 22.0


def test_a_vehicle_stands_on_its_wheels():
    views = ground_views(make_keypoints())
    np.testing.assert_allclose(views @ np.swapaxes(views, 1, 2), np.tile(np.eye(3), (540, 1, 1)),
                               atol=1e-12)  # fmt: skip
    up_in_photo = views @ np.array([0.0, 0.0, 1.0])
    assert (up_in_photo[:, 1] < -0.75).all()  # v points down
