"""Circles of an ellipse, and a vehicle's pose from the ellipses of its wheels."""

import math

import numpy as np
import pytest

from poseviewer.errors import QuickStartError
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform, rotation_about, rotation_angle
from poseviewer.starts.sides import look_from
from poseviewer.vehicle import wheel_pose
from poseviewer.vehicle.chart import visible_side
from poseviewer.vehicle.wheel_pose import Ellipse, Wheels, ellipse_through, poses_from_wheels
from tests.app.state.documents import CAR, make_keypoints

PINHOLE = Perspective(900.0, 850.0, 300.0, 260.0, 640, 480)
FLAT = Parallel(40.0, 300.0, 260.0, 640, 480)
KEYPOINTS = make_keypoints()
RADIUS = 0.31


def make_view(camera, seed: int) -> Pose:
    """A car seen from one of its sides, a little turned, not head-on."""
    rng = np.random.default_rng(seed)
    side = ("three-quarter", "left", "right")[seed % 3]
    pose = look_from(side, CAR, KEYPOINTS, camera)
    turn = rotation_about(rng.uniform(0.05, 0.3), rng.uniform(-0.4, 0.4), rng.uniform(-0.1, 0.1))
    rotation, centre = (
        turn @ pose.camera_from_model.rotation,
        pose.camera_from_model.apply(CAR.centre),
    )
    return Pose(pose.camera, RigidTransform(rotation, centre - rotation @ CAR.centre))


def wheels_of(pose: Pose) -> Wheels:
    rims = wheel_pose.wheel_rims(pose, visible_side(KEYPOINTS, pose), RADIUS)
    return Wheels(*map(ellipse_through, rims))


@pytest.mark.parametrize("seed", range(4))
def test_five_points_give_their_ellipse(seed: int):
    rng = np.random.default_rng(seed)
    b = rng.uniform(10, 40)
    wanted = Ellipse(300.0, 200.0, b * rng.uniform(1.1, 3.0), b, rng.uniform(0, math.pi))
    points = wanted.outline(60)[rng.integers(0, 12) + np.arange(5) * 12 - 12]
    found = ellipse_through(points)
    assert np.abs(found.distances(wanted.outline())).max() < 0.02
    assert np.abs(wanted.distances(points)).max() < 1e-9


def test_points_that_are_no_ellipse_are_refused():
    with pytest.raises(QuickStartError, match="needs 5 different"):
        ellipse_through([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    star = [[0, -100], [20, 10], [100, 0], [10, 30], [-100, 100]]
    with pytest.raises(QuickStartError, match=r"No ellipse|edge-on"):
        ellipse_through(star)
    with pytest.raises(QuickStartError, match="edge-on"):
        ellipse_through([[x, 2.0 * x] for x in range(6)])
    with pytest.raises(QuickStartError, match="must be above 0"):
        Ellipse(0.0, 0.0, 10.0, 0.0, 0.0)


@pytest.mark.parametrize("camera", [PINHOLE, FLAT], ids=["perspective", "parallel"])
@pytest.mark.parametrize("seed", range(6))
def test_two_wheels_give_the_pose(camera, seed: int):
    pose = make_view(camera, seed)
    best = poses_from_wheels(wheels_of(pose), KEYPOINTS, camera)[0]
    assert best.from_above
    assert best.error_px < 0.05
    assert best.radius == pytest.approx(RADIUS, rel=2e-3)
    rotation = best.pose.camera_from_model.rotation
    assert rotation_angle(rotation, pose.camera_from_model.rotation) < 5e-3
    drawn, wanted = (one.project(CAR.vertices) for one in (best.pose, pose))
    np.testing.assert_allclose(drawn, wanted, atol=0.6)


def test_the_two_wheels_together_have_one_answer_in_perspective():
    close = Perspective(500.0, 500.0, 320.0, 240.0, 640, 480)
    for seed in range(6):
        pose = make_view(close, seed)
        assert len(poses_from_wheels(wheels_of(pose), KEYPOINTS, close)) == 1


@pytest.mark.parametrize(
    ("rear", "front"),
    [((60.0, 55.0, 0.0), (60.0, 8.0, 1.57)), ((60.0, 8.0, 0.0), (60.0, 8.0, 1.57))],
)
def test_ellipses_that_no_car_shows_are_refused(rear, front):
    wheels = Wheels(Ellipse(150.0, 240.0, *rear), Ellipse(400.0, 240.0, *front))
    with pytest.raises(QuickStartError, match="No pose of this model shows its wheels"):
        poses_from_wheels(wheels, KEYPOINTS, PINHOLE)
