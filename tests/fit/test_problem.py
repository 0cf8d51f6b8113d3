"""Searches coarse to fine: what they report is judged on the photo, and they end at its minimum."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.fit.compared_pixels import ViewResidual
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.stages import fit_pose, make_stages
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import RigidTransform
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.optimise.restart_options import RestartOptions
from poseviewer.render.attributes import PhotoAttributes
from poseviewer.render.pyramid.levels import downsample, with_structure
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from tests.meshes import make_bumpy
from tests.several import lit_on_noise

MESH = make_bumpy(4)
RENDERER = SoftwareRenderer(MESH)
OFF = np.array([0.05, -0.06, 0.04, 0.05, -0.04, 0.05])


def true_pose(width: int) -> Pose:
    camera = Perspective(
        2.0 * width, 2.0 * width, 0.52 * width, 0.37 * width, width, width * 3 // 4
    )
    return Pose(camera, RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [0.1, 0.05, 7.0]))


def make_problem(width: int, **settings) -> FitProblem:
    """The lit model on a ground of noise, to be found from a start near it."""
    pose = true_pose(width)
    channels = lit_on_noise(RENDERER, pose)
    weights = np.ones(channels.shape[:2], np.float32)
    photo = PhotoAttributes(channels, weights, clipped=True, colour_reflectance=True)
    chart = FreeBodyChart.near(MESH, FreeBodyChart.near(MESH, pose).to_pose(OFF))
    view = ViewResidual(photo, chart, DEFAULT.on("clip"))
    return FitProblem(MESH, (view,), np.zeros(6), FitSettings(**settings))


def make_structured(width: int, factor: int, is_refined: bool = False, **settings) -> FitProblem:
    """The problem by classes and edges, on a photo ``factor`` times smaller."""
    lit = make_problem(width, **settings)
    plain = replace(lit.photo, clipped=False, colour_reflectance=False)
    fine = downsample(plain, 1) if is_refined else None
    view = ViewResidual(with_structure(plain, factor), lit.chart, DEFAULT, fine)
    return replace(lit, views=(view,))


@pytest.fixture(scope="module")
def coarse_problem() -> FitProblem:
    return make_structured(320, 1, search="simplex")


@pytest.fixture(scope="module")
def search(coarse_problem) -> list[FitProgress]:
    return list(fit_pose(coarse_problem, RENDERER))


def test_it_goes_from_a_coarse_level_to_the_photo_and_ends_at_the_truth(search):
    factors = [progress.factor for progress in search]
    assert factors[0] > 1
    assert factors == sorted(factors, reverse=True)
    assert factors[-1] == 1
    assert search[-1].status is Status.CONVERGED
    apart = search[-1].pose.project(MESH.vertices) - true_pose(320).project(MESH.vertices)
    assert np.linalg.norm(apart, axis=1).max() < 0.5


def test_losses_are_those_of_the_photo(coarse_problem, search):
    assert search[0].evaluations == 1
    assert search[0].start_loss == pose_loss(coarse_problem, RENDERER, coarse_problem.start)
    assert len({progress.start_loss for progress in search}) == 1
    seen = {progress.loss: progress for progress in search}
    assert len(seen) > 5
    for loss, progress in seen.items():
        assert loss == pose_loss(coarse_problem, RENDERER, progress.parameters)
        shown = coarse_problem.chart.to_pose(progress.parameters).camera_from_model
        assert np.array_equal(progress.pose.camera_from_model.translation, shown.translation)
    losses = [progress.loss for progress in search]
    assert losses == sorted(losses, reverse=True)


def test_every_evaluation_counts_and_is_told(search):
    counts = [progress.evaluations for progress in search]
    assert set(counts) == set(range(1, counts[-1] + 1))
    assert counts == sorted(counts)
    restarts = [progress.restart for progress in search]
    assert restarts == sorted(restarts)
    assert set(restarts) == set(range(restarts[-1] + 1))


@pytest.mark.parametrize("evaluations", [1, 40, 350])
def test_limits_hold_on_every_level(evaluations):
    problem = make_problem(320, limits=Limits(evaluations=evaluations))
    *_, end = fit_pose(problem, RENDERER)
    assert end.status is Status.EVALUATIONS_SPENT
    assert end.evaluations == evaluations
    assert end.loss == pose_loss(problem, RENDERER, end.parameters)


def test_locked_numbers_stay_on_every_level():
    problem = make_problem(320, lock=("rotation_y", "log_depth"))
    *_, end = fit_pose(problem, RENDERER)
    assert np.array_equal(end.parameters[[1, 5]], [0.0, 0.0])
    assert end.loss < end.start_loss


def test_a_population_evaluated_on_several_threads_is_the_same_search():
    """Also where a limit ends it within a generation, and where nobody asks any more."""
    problem = make_structured(160, 1, limits=Limits(evaluations=150))
    alone = list(fit_pose(problem, RENDERER))
    assert alone[-1].loss < alone[0].loss
    together = list(fit_pose(problem, RENDERER, 3))
    assert len(together) == len(alone)
    for one, other in zip(alone, together, strict=True):
        assert one.evaluations == other.evaluations
        assert one.loss == other.loss
        assert np.array_equal(one.parameters, other.parameters)
        assert np.array_equal(one.candidates, other.candidates)
    left = fit_pose(problem, RENDERER, 2)
    assert next(left).status is Status.RUNNING
    del left  # it ends its threads


@pytest.mark.slow
def test_a_search_that_ends_on_a_finer_photo_ends_nearer_to_the_truth():
    problem = make_structured(480, 4)
    *_, coarse = fit_pose(problem, RENDERER)
    *_, fine = fit_pose(make_structured(480, 4, is_refined=True), RENDERER)
    assert coarse.status is fine.status is Status.CONVERGED
    assert fine.evaluations > coarse.evaluations
    truth = true_pose(480).project(MESH.vertices)
    off = [
        np.linalg.norm(end.pose.project(MESH.vertices) - truth, axis=1).mean()
        for end in (coarse, fine)
    ]
    assert off[1] < 0.7 * off[0]
    assert fine.loss == pose_loss(problem, RENDERER, fine.parameters)


def test_clipped_pixels_are_searched_by_the_simplex_on_the_photo_alone():
    problem = make_problem(160, pixels="clip", options=RestartOptions(multi_starts=3))
    (stage,) = make_stages(problem, RENDERER)
    assert stage.levels[0].photo is problem.photo
    assert stage.options is problem.settings.options


def test_a_search_ends_without_what_is_hidden_there():
    culled_at: list[Pose] = []

    class Recording(SoftwareRenderer):
        def cull(self, pose: Pose) -> SoftwareRenderer:
            culled_at.append(pose)
            return super().cull(pose)

    problem = make_structured(160, 2, is_refined=True)
    *_, end = fit_pose(problem, Recording(MESH))
    pose = culled_at[-1]  # of the fine photo
    assert (pose.camera.width, pose.camera.height) == (160, 120)
    away = pose.project(MESH.vertices) - end.pose.project(MESH.vertices)
    assert np.abs(away).max() < 2.0
    assert end.loss == pose_loss(problem, RENDERER, end.parameters)


def test_a_model_out_of_sight_is_said():
    problem = make_problem(320)
    empty = replace(problem.photo, weights=np.zeros((240, 320)), clipped=False)
    *_, end = fit_pose(problem.on([empty]), RENDERER)
    assert end.status is Status.NOTHING_SEEN
