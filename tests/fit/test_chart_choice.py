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
SIDES = [np.array([[-1.0, y, 0.0], [1.0, y, 0.0], [0.0, 2.0 * y, 0.0]]) for y in (0.5, -0.5)]
CAR = VehicleKeypoints(*(SideKeypoints(*side) for side in SIDES))


def pose_turned(degrees: float) -> Pose:
    """The car's left side towards the camera at 0 degrees, its front at 90."""
    upright = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    turn = RigidTransform.from_rotation_vector([0.0, np.radians(degrees), 0.0], np.zeros(3))
    place = RigidTransform(turn.rotation @ upright, np.array([0.0, 0.0, 12.0]))
    return Pose(Perspective(500.0, 500.0, 320.0, 240.0, 640, 480), place)


@pytest.mark.parametrize(
    ("keypoints", "degrees", "chosen", "reason", "refusal"),
    [
        (CAR, 20.0, "vehicle", "", ""),
        (CAR, 90.0, "free-body", "head-on", 'chart="free-body"'),
        (None, 20.0, "free-body", "no wheels", r"keypoints\.json"),
    ],
    ids=["from its side", "head-on", "without wheels"],
)
def test_the_chart_suits_model_and_pose(keypoints, degrees, chosen, reason, refusal):
    chart, note = choose_chart("auto", MESH, keypoints, pose_turned(degrees))
    assert chart.name == chosen
    assert reason in note
    assert bool(note) == bool(reason)
    chart, note = choose_chart("free-body", MESH, keypoints, pose_turned(degrees))
    assert (chart.name, note) == ("free-body", "")
    if refusal:
        with pytest.raises((SettingsError, SingularChartError), match=refusal):
            choose_chart("vehicle", MESH, keypoints, pose_turned(degrees))
