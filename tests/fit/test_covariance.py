"""The covariance of a pose, from the loss about the end of its search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.fit.judge import find_covariance, inverse_curvature, judge_end
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.scene import Scene as FitScene
from poseviewer.fit.stages import fit_pose
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.loading import open_photo
from tests.opened import by
from tests.scene import Scene


@pytest.fixture(scope="module")
def registration(scene: Scene) -> FitScene:
    return open_photo(scene.photo, scene.model, scene.truth)


@pytest.fixture(scope="module")
def problem(registration: FitScene) -> FitProblem:
    return make_problem(by(registration, chart="free-body"))[0]


@pytest.fixture(scope="module")
def renderer(registration: FitScene) -> SoftwareRenderer:
    return SoftwareRenderer(registration.objects[0].mesh)


def test_the_curvature_of_a_known_quadratic_is_found_under_jumps() -> None:
    random = np.random.default_rng(0)
    axes, _ = np.linalg.qr(random.normal(size=(6, 6)))
    hessian = (axes * [300.0, 1000.0, 3000.0, 5000.0, 10000.0, 20000.0]) @ axes.T
    centre = 0.003 * random.normal(size=6)

    def losses(points: Sequence[np.ndarray]) -> np.ndarray:
        away = np.array(points) - centre
        smooth = 40.0 + 0.5 * np.einsum("ni,ij,nj->n", away, hessian, away)
        return smooth + 0.003 * random.normal(size=len(away))

    least, inverse = inverse_curvature(losses, 6)
    assert least == pytest.approx(40.0, abs=0.02)
    ratios = np.linalg.eigvals(inverse @ hessian).real
    assert 0.8 < ratios.min() <= ratios.max() < 1.25


def test_the_end_of_a_fit_is_sure_and_the_same_on_any_threads(
    problem: FitProblem, registration: FitScene, renderer: SoftwareRenderer
) -> None:
    *_, end = fit_pose(problem, renderer)
    verdict = judge_end(end, problem, registration.objects[0].mesh, renderer)
    sure = verdict.covariance
    assert verdict.word == "found"
    assert sure is not None
    assert np.linalg.eigvalsh(sure.matrix)[0] > 0.0
    said = sure.deviations
    assert 0.0 < said["sideways"] < said["depth"] < registration.objects[0].mesh.diameter
    assert 0.0 < sure.px < 5.0
    seen = verdict.features.seen if verdict.features is not None else 0.0
    again = find_covariance(problem, registration.objects[0].mesh, renderer, end.pose, seen, 3)
    assert again is not None
    np.testing.assert_array_equal(again.matrix, sure.matrix)


def test_the_less_is_seen_the_less_sure_it_is(
    problem: FitProblem, registration: FitScene, renderer: SoftwareRenderer
) -> None:
    whole, half = (
        find_covariance(problem, registration.objects[0].mesh, renderer, registration.pose(0), seen)
        for seen in (1.0, 0.5)
    )
    assert whole is not None
    assert half is not None
    assert half.px > whole.px


def test_a_number_that_is_held_is_sure(
    problem: FitProblem, registration: FitScene, renderer: SoftwareRenderer
) -> None:
    held = replace(problem, free=(True,) * 5 + (False,))
    sure = find_covariance(held, registration.objects[0].mesh, renderer, registration.pose(0), 1.0)
    assert sure is not None
    assert np.linalg.matrix_rank(sure.matrix / np.outer(sure.scales, sure.scales)) == 5
    assert sure.matrix[5, 5] == pytest.approx(0.0, abs=1e-12)


def test_a_free_focal_length_has_a_deviation_of_its_own(
    registration: FitScene, renderer: SoftwareRenderer
) -> None:
    free, _ = make_problem(by(registration, chart="free-body", free_focal=True))
    sure = find_covariance(free, registration.objects[0].mesh, renderer, registration.pose(0), 1.0)
    held, _ = make_problem(by(registration, chart="free-body"))
    known = find_covariance(held, registration.objects[0].mesh, renderer, registration.pose(0), 1.0)
    assert sure is not None
    assert known is not None
    assert sure.matrix.shape == (7, 7)
    assert sure.deviations["focal_px"] > 0.0
    assert sure.deviations["depth"] > known.deviations["depth"]


def test_where_nothing_is_seen_it_is_not_told(
    problem: FitProblem, registration: FitScene, renderer: SoftwareRenderer
) -> None:
    *_, end = fit_pose(replace(problem, limits=replace(problem.limits, evaluations=1)), renderer)
    far = np.array([0.0, 0.0, 0.0, 30.0, 30.0, 0.0])
    lost = replace(end, pose=problem.chart.to_pose(far))
    verdict = judge_end(lost, problem, registration.objects[0].mesh, renderer)
    assert (verdict.word, verdict.probability, verdict.covariance) == ("lost", 0.0, None)
