"""Errors of poses whose distance is known."""

import numpy as np
import pytest

from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from tests.meshes import make_box

MESH = make_box()


def test_a_shift_is_measured_in_px_and_in_per_cent():
    camera = Parallel(50.0, 80.0, 60.0, 160, 120)
    truth = Pose(camera, RigidTransform.identity())
    moved = Pose(camera, RigidTransform(np.eye(3), np.array([0.06, 0.08, 3.0])))
    error = pose_error(MESH, moved, truth)
    assert error.reprojection_px == pytest.approx(5.0)
    assert error.percent == pytest.approx(100.0 * 5.0 / np.hypot(100.0, 50.0))


def test_a_turn_is_measured_in_degrees_and_a_model_behind_the_camera_is_infinitely_far():
    camera, place = Perspective(100.0, 100.0, 80.0, 60.0, 160, 120), np.array([0.0, 0.0, 9.0])
    truth = Pose(camera, RigidTransform(np.eye(3), place))
    turned = RigidTransform.from_rotation_vector([0.0, np.radians(30.0), 0.0], place)
    assert pose_error(MESH, Pose(camera, turned), truth).rotation_deg == pytest.approx(30.0)
    behind = Pose(camera, RigidTransform(np.eye(3), -place))
    assert pose_error(MESH, behind, truth).reprojection_px == np.inf
