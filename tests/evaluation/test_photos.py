"""Random views show the whole vehicle from a side; starts are as far off as is said."""

import numpy as np
import pytest

from poseviewer.errors import SingularChartError
from poseviewer.evaluation.photos import demo_photo, draw_start, make_seed, random_view
from poseviewer.evaluation.plan import READINGS
from poseviewer.evaluation.trials import load_cached_model
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.vehicle.chart import VehicleChart
from tests.vehicles import save_vehicle


def test_views_show_the_whole_vehicle_from_a_side(tmp_path):
    path = save_vehicle(tmp_path)
    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    assert keypoints is not None
    sides = set()
    for seed in range(40):
        pose = random_view(mesh, keypoints, (320, 200), np.random.default_rng(seed))
        pixels = pose.project(mesh.vertices)
        assert np.all((pixels > 0.0) & (pixels < [320.0, 200.0]))
        assert np.ptp(pixels, axis=0).max() > 100.0
        up = pose.camera_from_model.rotation @ [0.0, 0.0, 1.0]
        assert up[1] < -0.8  # y points down
        sides.add(VehicleChart.near(keypoints, pose).side is keypoints.left)
    assert sides == {True, False}


@pytest.fixture(scope="module")
def car():
    """The demo's key points and true pose, and its chart."""
    case = demo_photo("photo-parallel")
    keypoints = load_cached_model(case.mesh)[0].keypoints
    assert keypoints is not None
    return keypoints, case.truth, VehicleChart.near(keypoints, case.truth)


@pytest.mark.parametrize("reading", READINGS)
def test_each_parameter_is_off_by_up_to_the_share_and_no_more(car, reading):
    keypoints, truth, chart = car
    true = chart.from_pose(truth)
    most = 0.16 * (abs(true) if reading == "relative" else chart.scales(true))
    starts = [draw_start(keypoints, truth, False, reading, 0.16, seed) for seed in range(100)]
    off = np.abs([chart.from_pose(start) - true for start in starts])
    assert np.all(off <= most + 1e-9)
    assert np.all(off.max(axis=0) >= 0.9 * most)


def test_a_seed_gives_one_start(car):
    keypoints, truth, *_ = car

    def translation(seed):
        start = draw_start(keypoints, truth, False, "relative", 0.1, seed)
        return start.camera_from_model.translation

    assert np.array_equal(translation(5), translation(5))
    assert not np.array_equal(translation(5), translation(6))
    assert make_seed(0, "plain", 1) == 2563212165


def test_starts_that_are_no_pose_are_given_up(car):
    keypoints, truth, *_ = car
    with pytest.raises(SingularChartError, match="100000%"):
        draw_start(keypoints, truth, False, "absolute", 1000.0, 0)
