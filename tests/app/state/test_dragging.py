"""Motions under the pointer: what must stay, stays; what is pulled, comes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseviewer.app.state.dragging import (
    MAX_ZOOM,
    fit_pins,
    radius_in_photo,
    roll,
    roll_and_scale,
    rotate,
    scale_about,
    trackball,
    translate,
    vehicle_pins,
    with_vehicle_pin,
)
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.chart import VehicleChart
from tests.geometry.test_charts import make_keypoints, make_vehicle_pose
from tests.meshes import make_bumpy

SEEDS = st.integers(0, 2**32 - 1)
MESH = make_bumpy(2)
CENTRE = MESH.centre
PARALLEL = Parallel(60.0, 250.0, 270.0, 640, 480)
PERSPECTIVE = Perspective(700.0, 560.0, 250.0, 270.0, 640, 480)
CAMERAS = pytest.mark.parametrize("camera", [PARALLEL, PERSPECTIVE], ids=["parallel", "pinhole"])
few = settings(deadline=None, max_examples=40)


def random_pose(random, camera) -> Pose:
    place = [*random.uniform(-2.0, 2.0, 2), random.uniform(6.0, 15.0)]
    return Pose(camera, RigidTransform.from_rotation_vector(random.normal(size=3), place))


def assert_centre_stays(before: Pose, after: Pose):
    assert after.project(CENTRE) == pytest.approx(before.project(CENTRE), abs=1e-9)
    rotation = after.camera_from_model.rotation
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def depth(pose: Pose) -> float:
    return float(pose.camera_from_model.apply(CENTRE)[2])


@CAMERAS
@given(seed=SEEDS)
@few
def test_every_rotation_keeps_the_centre_and_is_proper(camera, seed):
    random = np.random.default_rng(seed)
    pose = random_pose(random, camera)
    start, end = random.uniform(0.0, 640.0, (2, 2))
    for after in (
        rotate(pose, CENTRE, random.normal(size=3) * 3.0),
        trackball(pose, CENTRE, radius_in_photo(pose, MESH), start, end),
        roll(pose, CENTRE, random.normal() * 3.0),
        roll_and_scale(pose, CENTRE, start, end),
        scale_about(pose, CENTRE, math.exp(random.normal())),
    ):
        assert_centre_stays(pose, after)


@CAMERAS
def test_a_trackball_takes_its_near_side_along(camera):
    pose = Pose(camera, RigidTransform(np.eye(3), np.array([0.0, 0.0, 9.0])))
    middle = pose.project(CENTRE)
    nearest = CENTRE - np.array([0.0, 0.0, 0.5])
    for way in ([20.0, 0.0], [0.0, 20.0], [-15.0, 10.0]):
        after = trackball(pose, CENTRE, 90.0, middle, middle + way)
        went = after.project(nearest) - pose.project(nearest)
        assert float(went @ np.array(way)) > 0.0


@given(seed=SEEDS)
@few
def test_roll_and_scale_takes_the_grabbed_point_along(seed):
    random = np.random.default_rng(seed)
    pose = random_pose(random, PARALLEL)
    angles, levers = random.uniform(0.0, 7.0, 2), random.uniform(10.0, 150.0, 2)
    middle = pose.project(CENTRE)
    start, end = (
        middle + r * np.array([math.cos(a), math.sin(a)])
        for a, r in zip(angles, levers, strict=True)
    )
    # The point of the model at the centre's depth that is seen at the start.
    at = np.append((start - [pose.camera.cx, pose.camera.cy]) / PARALLEL.scale, depth(pose))
    point = pose.camera_from_model.inverse().apply(at)
    assert pose.project(point) == pytest.approx(start, abs=1e-9)
    after = roll_and_scale(pose, CENTRE, start, end)
    assert after.project(point) == pytest.approx(end, abs=1e-8)


def test_a_roll_is_clockwise_in_the_photo():
    for camera in (PARALLEL, PERSPECTIVE):
        pose = Pose(camera, RigidTransform(np.eye(3), np.array([0.3, -0.2, 9.0])))
        aside = CENTRE + np.array([0.5, 0.0, 0.0])
        after = roll(pose, CENTRE, 0.3)
        right, down = after.project(aside) - after.project(CENTRE)
        assert right > 0.0
        assert down > 0.0


@CAMERAS
def test_a_drag_across_the_centre_cannot_blow_the_model_up(camera):
    pose = Pose(camera, RigidTransform(np.eye(3), np.array([0.0, 0.0, 9.0])))
    middle = pose.project(CENTRE)
    far = roll_and_scale(pose, CENTRE, middle, middle + np.array([1e6, 0.0]))
    before, after = (radius_in_photo(p, MESH) for p in (pose, far))
    assert after <= before * MAX_ZOOM * (1.0 + 1e-9)
    back = roll_and_scale(pose, CENTRE, middle + np.array([100.0, 0.0]), middle)
    assert radius_in_photo(back, MESH) > 0.0


@CAMERAS
@given(seed=SEEDS)
@few
def test_scaling_multiplies_the_size_at_the_centres_depth(camera, seed):
    random = np.random.default_rng(seed)
    pose, zoom = random_pose(random, camera), math.exp(random.uniform(-1.5, 1.5))
    after = scale_about(pose, CENTRE, zoom)
    offsets = np.column_stack([random.normal(size=(4, 2)), np.zeros(4)])
    points = CENTRE + offsets @ pose.camera_from_model.rotation  # side by side with the centre
    assert after.project(points) - after.project(CENTRE) == pytest.approx(
        zoom * (pose.project(points) - pose.project(CENTRE)), abs=1e-8
    )


@CAMERAS
@pytest.mark.parametrize("count", [1, 2, 3])
@given(seed=SEEDS)
@settings(deadline=None, max_examples=15)
def test_pins_that_can_be_reached_are_reached(camera, count, seed):
    random = np.random.default_rng(seed)
    pose = random_pose(random, camera)
    # Well apart, as pins are set; three of them far from one line.
    points = CENTRE + np.eye(3)[:count] * random.choice([-0.8, 0.8], (count, 1))
    wanted = rotate(pose, CENTRE, random.normal(size=3) * 0.1)
    wanted = translate(scale_about(wanted, CENTRE, 1.1), CENTRE, random.normal(size=2) * 20.0)
    pixels = wanted.project(points)
    after = fit_pins(MESH, pose, points, pixels)
    assert after.project(points) == pytest.approx(pixels, abs=0.01)


@CAMERAS
@pytest.mark.parametrize("pin", [0, 1, 2])
@given(seed=SEEDS)
@few
def test_a_vehicles_pin_lands_under_the_pointer_and_the_others_hold(camera, pin, seed):
    random = np.random.default_rng(seed)
    keypoints = make_keypoints(random)
    chart = VehicleChart.near(keypoints, make_vehicle_pose(random, keypoints, camera, (0.5, 0.95)))
    parameters = chart.from_pose(make_vehicle_pose(random, keypoints, camera, (0.5, 0.95)))
    before = vehicle_pins(chart, parameters)
    # A tip pulled only a little, so that it stays inside the rim.
    pixel = before[pin] + random.uniform(-8.0, 8.0, 2)
    changed = with_vehicle_pin(chart, parameters, pin, pixel)
    after = vehicle_pins(chart, changed)
    assert after[pin] == pytest.approx(pixel, abs=1e-9)
    others = [i for i in range(3) if i != pin]
    assert after[others] == pytest.approx(before[others], abs=1e-9)


@CAMERAS
def test_the_wheels_pins_are_where_the_wheels_are(camera):
    random = np.random.default_rng(0)
    keypoints = make_keypoints(random)
    pose = make_vehicle_pose(random, keypoints, camera)
    chart = VehicleChart.near(keypoints, pose)
    pins = vehicle_pins(chart, chart.from_pose(pose))
    wheels = pose.project([chart.side.rear_wheel, chart.side.front_wheel])
    assert pins[:2] == pytest.approx(wheels, abs=1e-9)
    # The tip lies where the axle points in the photo.
    axle = pose.camera_from_model.rotation @ chart.side.axle
    way = pins[2] - pins[0]
    assert way / np.linalg.norm(way) == pytest.approx(axle[:2] / np.linalg.norm(axle[:2]), abs=1e-9)


@given(seed=SEEDS, pin=st.sampled_from([0, 2]))
@few
def test_an_axle_pulled_beyond_the_rim_stays_in_the_chart(seed, pin):
    random = np.random.default_rng(seed)
    keypoints = make_keypoints(random)
    pose = make_vehicle_pose(random, keypoints, PARALLEL)
    chart = VehicleChart.near(keypoints, pose)
    parameters = chart.from_pose(pose)
    direction = random.uniform(0.0, 2.0 * math.pi)
    pixel = vehicle_pins(chart, parameters)[pin]
    pixel = pixel + 3000.0 * np.array([math.cos(direction), math.sin(direction)])
    changed = with_vehicle_pin(chart, parameters, pin, pixel)
    assert chart.from_pose(chart.to_pose(changed)) == pytest.approx(changed, abs=1e-6)
    assert np.linalg.norm(changed[4:]) == pytest.approx(math.sqrt(1.0 - 0.05**2), abs=1e-5)
