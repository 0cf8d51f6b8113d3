"""The paper's method: four attributes, one simplex, the photo alone."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.fit.compared_pixels import ViewResidual
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.fit.progress import Status
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.losses.paper_loss import PAPER, lighting_loss, whole_photo_loss
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.moments import model_attributes
from poseviewer.render.pyramid.levels import downsample
from poseviewer.scene.settings import FitSettings
from tests.fit.test_problem import MESH, RENDERER, true_pose

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


def problem_at(start: np.ndarray, clipped: bool, **settings) -> FitProblem:
    """The pose to be found from numbers of the free-body chart about it."""
    loss = PAPER.on("clip" if clipped else "whole")
    views = (ViewResidual(make_photo(clipped, 0.0), FreeBodyChart.near(MESH, POSE), loss),)
    return FitProblem(MESH, views, start, FitSettings("paper", **settings))


def test_models_search_the_papers_loss_from_a_coarse_level_on():
    problem = problem_at(np.full(6, 0.03), clipped=False, search="models")
    search = list(fit_pose(problem, RENDERER))
    assert [progress.factor for progress in search][:: len(search) - 1] == [2, 1]
    assert search[-1].status is Status.CONVERGED
    assert np.abs(search[-1].parameters).max() < 1e-2


def test_poses_that_cover_much_less_than_the_start_are_the_worst():
    """Clipped, a few pixels on one grey are explained better than all of them."""
    problem = problem_at(np.zeros(6), clipped=True)
    far = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # 2.7 times as far away
    assert pose_loss(problem, RENDERER, far) < problem.worst_loss
    (compared, *_) = (progress.problem for progress in fit_pose(problem, RENDERER))
    assert pose_loss(compared, RENDERER, far) == problem.worst_loss
    assert pose_loss(compared, RENDERER, problem.start) < problem.worst_loss
    coarse = compared.on([downsample(compared.photo, 2)])
    assert pose_loss(coarse, RENDERER, problem.start) < problem.worst_loss


@pytest.mark.parametrize("clipped", [True, False])
def test_it_finds_a_pose_nearby_and_stops_when_restarts_gain_nothing(clipped):
    problem = problem_at(np.array([0.02, -0.02, 0.02, 0.01, -0.01, 0.02]), clipped)
    search = list(fit_pose(problem, RENDERER))
    end = search[-1]
    assert end.status is Status.CONVERGED
    assert {progress.factor for progress in search} == {1}
    assert end.restart > end.problem.settings.options.patience
    assert end.loss == pose_loss(problem, RENDERER, end.parameters) < end.start_loss
    assert np.abs(end.parameters).max() < 1e-2  # where it stops, hangs on the last digits
