"""Random views show the whole vehicle, from a side, where the vehicle chart has numbers."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.evaluation.photos import random_view
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.mesh.load import load_mesh
from poseviewer.geometry.camera import Parallel
from poseviewer.vehicle.chart import VehicleChart
from tests.vehicles import save_vehicle


@pytest.mark.parametrize("parallel", [True, False])
def test_views_show_the_whole_vehicle_from_a_side(tmp_path, parallel):
    path = save_vehicle(tmp_path)
    mesh = load_mesh(path)
    keypoints = load_keypoints(path, mesh)
    assert keypoints is not None
    sides = set()
    for seed in range(40):
        pose = random_view(mesh, keypoints, (320, 200), parallel, np.random.default_rng(seed))
        assert isinstance(pose.camera, Parallel) == parallel
        seen = pose.project(mesh.vertices)
        assert np.all((seen > 0.0) & (seen < [320.0, 200.0]))
        assert np.ptp(seen, axis=0).max() > 100.0
        up = pose.camera_from_model.rotation @ [0.0, 0.0, 1.0]
        assert up[1] < -0.8  # y points down
        chart = VehicleChart.near(keypoints, pose)
        sides.add(chart.side is keypoints.left)
        back = chart.to_pose(chart.from_pose(pose))
        assert back.project(mesh.vertices) == pytest.approx(seen, abs=1e-6)
    assert sides == {True, False}
