"""The paper's method: four attributes, one simplex, the photo alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.fit.loss import lighting_loss, whole_photo_loss
from poseviewer.fit.problem import ComparedView, FitProblem, pose_loss
from poseviewer.fit.progress import Status
from poseviewer.fit.settings import FitSettings
from poseviewer.fit.stages import PAPER_PATIENCE, fit_pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.render.moments import model_attributes
from poseviewer.render.types import PhotoAttributes
from tests.fit.test_problem import MESH, MODEL, RENDERER, true_pose

POSE = true_pose(320)
LIGHT = np.array([0.5, 0.4, -0.7, -0.6])


def make_photo(clipped: bool, ground: float) -> PhotoAttributes:
    """Grey: the model under one light on ground of one grey, and a little noise."""
    image = RENDERER.render(POSE)
    all_pixels = np.ones((240, 320), np.float32)
    attributes = model_attributes(image, PhotoAttributes(all_pixels[..., None], all_pixels))
    lit = np.where(image.mask, attributes @ LIGHT, ground)
    lit = lit + np.random.default_rng(0).normal(0.0, 0.02, lit.shape)
    return PhotoAttributes(lit[..., None].astype(np.float32), all_pixels, clipped)


@pytest.mark.parametrize("clipped", [True, False])
def test_the_loss_is_one_minus_the_squared_correlation_with_the_best_light(clipped):
    photo = make_photo(clipped, ground=0.3)
    image = RENDERER.render(POSE)
    pixels = image.mask if clipped else np.ones_like(image.mask)
    model = model_attributes(image, replace(photo, clipped=True))[pixels]
    grey = photo.channels[pixels][:, 0].astype(float)
    known = np.column_stack([model, np.ones(len(model))])
    left = grey - known @ np.linalg.lstsq(known, grey, rcond=None)[0]
    loss = lighting_loss if clipped else whole_photo_loss
    found = loss(RENDERER.moments(POSE, photo))
    assert found == pytest.approx(left.var() / grey.var(), rel=1e-3)


def test_beside_the_model_it_has_no_colour_of_its_own():
    photo = make_photo(clipped=False, ground=0.6)
    moments = RENDERER.moments(POSE, photo)
    assert whole_photo_loss(moments) > lighting_loss(moments) + 0.01


@pytest.mark.parametrize("clipped", [True, False])
def test_it_finds_a_pose_nearby_and_stops_when_restarts_gain_nothing(clipped):
    chart = FreeBodyChart.near(MESH, POSE)
    start = np.array([0.02, -0.02, 0.02, 0.01, -0.01, 0.02])
    loss = lighting_loss if clipped else whole_photo_loss
    views = (ComparedView(make_photo(clipped, 0.0), chart, loss),)
    problem = FitProblem(MODEL, views, start, FitSettings("paper"))
    search = list(fit_pose(problem, RENDERER))
    end = search[-1]
    assert end.status is Status.CONVERGED
    assert {progress.factor for progress in search} == {1}
    assert end.restart >= PAPER_PATIENCE
    assert end.loss == pose_loss(problem, RENDERER, end.parameters) < end.start_loss
    assert np.abs(end.parameters).max() < 1e-2  # where it stops, hangs on the last digits
