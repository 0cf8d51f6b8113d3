"""Charts there and back, over random poses, near the identity and near the singularity."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from tests.meshes import make_box

SEEDS = st.integers(0, 2**32 - 1)
PARALLEL = Parallel(150.0, 310.0, 255.0, 640, 480)
PERSPECTIVE = Perspective(700.0, 690.0, 310.0, 255.0, 640, 480)
FREE_BODIES = [(PARALLEL, (0, 0)), *((PERSPECTIVE, (a, b)) for a in (0, 1) for b in (0, 1))]
CAMERAS = pytest.mark.parametrize("camera", [PARALLEL, PERSPECTIVE], ids=["parallel", "pinhole"])


def make_keypoints(random) -> VehicleKeypoints:
    """A car of any size and orientation in its own frame; axle not quite square in the file."""
    forward, left, up = np.linalg.qr(random.normal(size=(3, 3)))[0].T
    if np.linalg.det([forward, left, up]) < 0.0:
        up = -up
    size, origin = random.uniform(0.1, 100.0), random.normal(size=3)

    def side(sign: float) -> SideKeypoints:
        rear = origin + size * (sign * 0.3 * left - 0.2 * up)
        return SideKeypoints(rear, rear + size * forward, sign * left + 1e-3 * forward)

    return VehicleKeypoints(side(1.0), side(-1.0))


def make_vehicle_pose(random, keypoints, camera, towards=(0.2, 0.95)) -> Pose:
    """A pose at which the left axle has a share within ``towards`` along the view."""
    side = keypoints.left
    share = random.uniform(*towards)
    angle = random.uniform(0.0, 2.0 * np.pi)
    in_plane = np.sqrt(1.0 - share**2)
    axle = np.array([in_plane * np.cos(angle), in_plane * np.sin(angle), -share])
    along = np.cross(axle, random.normal(size=3))
    along /= np.linalg.norm(along)
    model = np.column_stack([side.axle, (side.front_wheel - side.rear_wheel) / side.wheelbase])
    model = np.column_stack([model, np.cross(*model.T)])
    rotation = np.column_stack([axle, along, np.cross(axle, along)]) @ model.T
    depth = 12.0 * side.wheelbase
    place = np.array([*random.uniform(-0.5, 0.5, 2) * side.wheelbase, depth])
    if isinstance(camera, Parallel):
        camera = Parallel(150.0 / side.wheelbase, camera.cx, camera.cy, camera.width, camera.height)
    return Pose(camera, RigidTransform(rotation, place - rotation @ side.rear_wheel))


def assert_same_picture(a: Pose, b: Pose, points, tolerance_px=1e-6):
    assert a.project(points) == pytest.approx(b.project(points), abs=tolerance_px)
    angle = rotation_angle(a.camera_from_model.rotation, b.camera_from_model.rotation)
    assert angle < 1e-6


def corners(keypoints: VehicleKeypoints):
    sides = (keypoints.left, keypoints.right)
    return np.array([p for s in sides for p in (s.rear_wheel, s.front_wheel)])


@CAMERAS
@pytest.mark.parametrize("free_principal", [False, True])
@pytest.mark.parametrize("free_focal", [False, True])
@given(seed=SEEDS)
@settings(deadline=None, max_examples=60)
def test_vehicle_chart_round_trip(camera, free_focal, free_principal, seed):
    random = np.random.default_rng(seed)
    keypoints = make_keypoints(random)
    pose = make_vehicle_pose(random, keypoints, camera)
    chart = VehicleChart.near(keypoints, pose, free_focal, free_principal)
    if free_principal:
        pose = replace(pose, camera=replace(pose.camera, cx=260.0, cy=280.0))
    parameters = chart.from_pose(pose)
    again = chart.to_pose(parameters)
    assert_same_picture(again, pose, corners(keypoints))
    assert chart.from_pose(again) == pytest.approx(parameters, abs=1e-9)
    assert len(parameters) == len(chart.names) == len(chart.scales(parameters))
    assert len(parameters) == 6 + free_focal + 2 * free_principal


@CAMERAS
@given(seed=SEEDS)
@settings(deadline=None, max_examples=60)
def test_vehicle_numbers_are_the_papers(camera, seed):
    random = np.random.default_rng(seed)
    keypoints = make_keypoints(random)
    pose = make_vehicle_pose(random, keypoints, camera)
    parameters = VehicleChart.near(keypoints, pose).from_pose(pose)
    rear, front = pose.project([keypoints.left.rear_wheel, keypoints.left.front_wheel])
    assert parameters[0:2] * [640, 480] == pytest.approx(rear)
    assert parameters[2:4] * [640, 480] == pytest.approx(front - rear)
    psi = pose.camera_from_model.rotation @ keypoints.left.axle
    assert parameters[4:6] == pytest.approx(psi[:2])
    assert psi[2] == pytest.approx(-np.sqrt(1.0 - parameters[4] ** 2 - parameters[5] ** 2))


@CAMERAS
def test_the_side_is_the_one_that_is_seen(camera):
    random = np.random.default_rng(1)
    keypoints = make_keypoints(random)
    pose = make_vehicle_pose(random, keypoints, camera)
    assert VehicleChart.near(keypoints, pose).side is keypoints.left
    mirrored = VehicleKeypoints(keypoints.right, keypoints.left)
    assert VehicleChart.near(mirrored, pose).side is mirrored.right


def test_a_long_focal_length_goes_over_into_parallel_projection():
    random = np.random.default_rng(2)
    keypoints = make_keypoints(random)
    square = replace(PERSPECTIVE, fy=PERSPECTIVE.fx)  # as parallel projection has them
    chart = VehicleChart(keypoints.left, square, free_focal=True)
    parameters = np.array([0.4, 0.6, 0.35, -0.05, 0.3, -0.2, 0.0])
    parallel = chart.to_pose(parameters)
    assert isinstance(parallel.camera, Parallel)
    points = corners(keypoints)
    for width_per_focal, tolerance_px in [(1e-2, 3.0), (1e-3, 0.3), (1e-4, 0.03)]:
        parameters[6] = width_per_focal
        pose = chart.to_pose(parameters)
        difference = np.abs(pose.project(points) - parallel.project(points)).max()
        assert 1e-3 * tolerance_px < difference < tolerance_px


@pytest.mark.parametrize(
    "parameters",
    [
        [0.5, 0.5, 0.3, 0.0, 0.9, 0.6],
        [0.5, 0.5, 0.3, 0.0, 1.0, 0.0],
        [0.5, 0.5, 0.0, 0.0, 0.1, 0.1],
        [0.5, 0.5, np.nan, 0.0, 0.1, 0.1],
        [0.5, np.inf, 0.3, 0.0, 0.1, 0.1],
    ],
)
@CAMERAS
def test_vehicle_numbers_outside_the_chart_are_refused(camera, parameters):
    chart = VehicleChart(make_keypoints(np.random.default_rng(3)).left, camera)
    with pytest.raises(OutsideChartError):
        chart.to_pose(np.array(parameters))


def make_free_body(random, camera, free_focal=False, free_principal=False):
    centre, radius = random.normal(size=3), random.uniform(0.1, 10.0)
    if isinstance(camera, Parallel):
        camera = Parallel(100.0 / radius, camera.cx, camera.cy, 640, 480)
    place = np.array([*random.uniform(-radius, radius, 2), random.uniform(3, 20) * radius])
    turn = random.normal(size=3)
    rotation = RigidTransform.from_rotation_vector(turn, np.zeros(3)).rotation
    pose = Pose(camera, RigidTransform(rotation, place - rotation @ centre))
    chart = FreeBodyChart(pose, centre, radius, free_focal, free_principal)
    rim = random.normal(size=(200, 3))
    rim = centre + radius * rim / np.linalg.norm(rim, axis=1, keepdims=True)
    return chart, pose, rim


@pytest.mark.parametrize("size", [1e-12, 1e-6, 0.1, 0.9])
@pytest.mark.parametrize(("camera", "free"), FREE_BODIES)
@given(seed=SEEDS)
@settings(deadline=None, max_examples=40)
def test_free_body_round_trip(camera, free, size, seed):
    random = np.random.default_rng(seed)
    chart, start, rim = make_free_body(random, camera, *free)
    count = 6 + free[0] + 2 * free[1]
    assert chart.from_pose(start) == pytest.approx(np.zeros(count), abs=1e-12)
    assert_same_picture(chart.to_pose(np.zeros(count)), start, rim)
    parameters = random.uniform(-size, size, count)
    parameters[6:] *= 0.02  # or the model swallows the camera
    parameters.setflags(write=False)
    pose = chart.to_pose(parameters)
    assert chart.from_pose(pose) == pytest.approx(parameters, abs=1e-9)
    assert_same_picture(chart.to_pose(chart.from_pose(pose)), pose, rim)
    assert len(chart.names) == count


@pytest.mark.parametrize(("camera", "free"), FREE_BODIES)
@given(seed=SEEDS)
@settings(deadline=None, max_examples=20)
def test_free_body_numbers_move_the_picture_by_comparable_amounts(camera, free, seed):
    chart, start, rim = make_free_body(np.random.default_rng(seed), camera, *free)
    before = start.project(rim)
    radius_px = np.abs(before - before.mean(axis=0)).max()
    for k in range(len(chart.names)):
        parameters = np.zeros(len(chart.names))
        parameters[k] = 0.01
        moved = np.linalg.norm(chart.to_pose(parameters).project(rim) - before, axis=1).max()
        most = 0.04 if "principal" in chart.names[k] else 0.03  # beside the axis sizes change, too
        assert 0.002 * radius_px < moved < most * radius_px, chart.names[k]


@pytest.mark.parametrize(
    ("place", "error"),
    [
        ([0.0, 0.0, -5.0], "behind"),
        ([np.nan, 0.0, 5.0], "out of all proportion"),
        ([0.0, np.inf, 5.0], "out of all proportion"),
    ],
)
def test_a_pose_that_shows_no_model_has_no_free_body_chart(place, error):
    pose = Pose(PERSPECTIVE, RigidTransform(np.eye(3), np.array(place)))
    with pytest.raises(SingularChartError, match=error):
        FreeBodyChart.near(make_box(), pose)
    with pytest.raises(SettingsError, match="perspective"):
        FreeBodyChart.near(make_box(), replace(pose, camera=PARALLEL), free_focal=True)


@CAMERAS
def test_a_vehicle_seen_head_on_has_no_vehicle_chart(camera):
    keypoints = make_keypoints(np.random.default_rng(4))
    for towards in ((-0.02, 0.02), (-0.6, -0.5)):
        pose = make_vehicle_pose(np.random.default_rng(5), keypoints, camera, towards)
        chart = VehicleChart(keypoints.left, pose.camera)
        with pytest.raises(SingularChartError, match="head-on"):
            chart.from_pose(pose)
