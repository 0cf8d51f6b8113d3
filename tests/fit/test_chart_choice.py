"""The chart that suits a model and a pose, and why."""

import numpy as np
import pytest

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.fit.problem import choose_chart
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from tests.meshes import make_box

MESH = make_box()
CAR = VehicleKeypoints(
    SideKeypoints(np.array([-1.0, 0.5, 0.0]), np.array([1.0, 0.5, 0.0]), np.array([0.0, 1.0, 0.0])),
    SideKeypoints(
        np.array([-1.0, -0.5, 0.0]), np.array([1.0, -0.5, 0.0]), np.array([0.0, -1.0, 0.0])
    ),
)


def pose_turned(degrees: float) -> Pose:
    """The car's left side towards the camera at 0 degrees, its front at 90."""
    upright = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    turn = RigidTransform.from_rotation_vector([0.0, np.radians(degrees), 0.0], np.zeros(3))
    place = np.array([0.0, 0.0, 12.0])
    camera = Perspective(500.0, 500.0, 320.0, 240.0, 640, 480)
    return Pose(camera, RigidTransform(turn.rotation @ upright, place))


def test_a_car_seen_from_its_side_gets_the_vehicle_chart():
    chart, note = choose_chart("auto", MESH, CAR, pose_turned(20.0))
    assert (chart.name, note) == ("vehicle", "")
    chart, note = choose_chart("free-body", MESH, CAR, pose_turned(20.0))
    assert (chart.name, note) == ("free-body", "")


def test_a_car_seen_head_on_gets_the_free_body_chart_and_a_reason():
    chart, note = choose_chart("auto", MESH, CAR, pose_turned(90.0))
    assert chart.name == "free-body"
    assert "head-on" in note
    with pytest.raises(SingularChartError, match="--chart free-body"):
        choose_chart("vehicle", MESH, CAR, pose_turned(90.0))


def test_a_model_without_wheels_gets_the_free_body_chart_and_a_reason():
    chart, note = choose_chart("auto", MESH, None, pose_turned(20.0))
    assert chart.name == "free-body"
    assert "no wheels" in note
    with pytest.raises(SettingsError, match=r"keypoints\.json"):
        choose_chart("vehicle", MESH, None, pose_turned(20.0))
