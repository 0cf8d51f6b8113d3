"""An unknown focal length: freed, it comes nearer to the true one, and the pose with it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from poseviewer.api import load
from poseviewer.app.state.camera_change import with_camera
from poseviewer.files.demo import demo_case
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import load_pose
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.pose_error import pose_error
from poseviewer.starts.loading import load_model


def fit_demo(factor: float, free: bool) -> tuple[float, float, int]:
    """Focal length that a fit ends with, in true ones, error in px, and evaluations."""
    case = demo_case()
    photo, model = load_photo(case.photo), load_model(case.model)
    start, truth = (
        load_pose(path, photo.width, photo.height).pose for path in (case.start, case.truth)
    )
    assert isinstance(start.camera, Perspective)
    assert isinstance(truth.camera, Perspective)
    focal = factor * truth.camera.fx
    begin = with_camera(start, replace(start.camera, fx=focal, fy=focal), model.mesh.centre)
    end = load(case.photo, model, begin, free_focal=free).fit(threads=2)
    assert isinstance(end.pose.camera, Perspective)
    assert end.progress is not None
    error = pose_error(model.mesh, end.pose, truth).reprojection_px
    return end.pose.camera.fx / truth.camera.fx, error, end.progress.evaluations


@pytest.mark.slow
def test_on_the_demo_it_is_found_from_a_quarter_or_a_third_off():
    for factor in (0.75, 4.0 / 3.0):
        focal, error, _ = fit_demo(factor, free=True)
        assert abs(focal - 1.0) < 0.06
        assert error < 2.0


@pytest.mark.slow
def test_where_the_focal_length_stays_one_search_is_enough():
    # Near the least loss, which lies beside the true length.
    free, held = (fit_demo(0.975, free)[2] for free in (True, False))
    assert free < 1.5 * held
