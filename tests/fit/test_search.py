"""A fit with its verdict: where that is bad it goes on, and then looks farther."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.model import judge_end
from poseviewer.files.demo import demo_case
from poseviewer.fit.problem import FitProblem, Status, fit_pose, make_problem, stages_of
from poseviewer.fit.registration import Registration
from poseviewer.fit.search import (
    SURE,
    WAYS,
    further_search,
    is_taken,
    judged_fit,
    with_verdict,
)
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.registration import load_registration


@pytest.fixture(scope="module")
def demo() -> tuple[Registration, Renderer]:
    files = demo_case()
    registration = load_registration(files.photo, files.model, files.start)
    return registration, make_renderer(registration.mesh)


def start_off_by(registration: Registration, share: float, seed: int, **more) -> FitProblem:
    """The demo from a start, off its own by up to a share of each number's span."""
    problem, _ = make_problem(registration, FitSettings(**more))
    off = share * np.random.default_rng(seed).uniform(-1.0, 1.0, len(problem.start))
    pose = problem.chart.to_pose(problem.start + off * problem.chart.scales(problem.start))
    moved = replace(registration, start=pose)
    return make_problem(moved, FitSettings(**more))[0]


def run_both(problem: FitProblem, mesh: Mesh, renderer: Renderer):
    """The end of the first search alone, judged, and all of the judged fit."""
    *_, alone = fit_pose(problem, renderer, 2)
    alone = with_verdict(alone, problem, mesh, renderer, judge_end)
    return alone, list(judged_fit(problem, mesh, renderer, judge_end, 2))


def test_a_pose_that_is_trusted_ends_the_fit(demo):
    registration, renderer = demo
    alone, states = run_both(start_off_by(registration, 0.0, 0), registration.mesh, renderer)
    assert alone.verdict is not None
    assert alone.verdict.word == "found"
    assert states[-1].evaluations == alone.evaluations
    assert states[-1].verdict == alone.verdict


def test_a_pose_that_is_not_is_looked_for_farther_away(demo):
    registration, renderer = demo
    alone, states = run_both(start_off_by(registration, 0.35, 2), registration.mesh, renderer)
    assert alone.verdict is not None
    assert alone.verdict.word != "found"
    assert all(state.status is Status.RUNNING for state in states[:-1])
    assert all(state.verdict is None for state in states[:-1])
    end = states[-1]
    assert end.status is Status.CONVERGED
    assert end.verdict is not None
    assert end.evaluations > 1.5 * alone.evaluations
    assert end.start_loss == alone.start_loss
    assert end.loss < alone.loss - 1.0  # from here the first search ends in another valley
    losses = [state.loss for state in states if state.evaluations > alone.evaluations]
    assert max(losses) <= alone.loss + 1e-9  # what was found first stays the best until then
    assert np.all(np.diff([state.evaluations for state in states]) >= 0)


def test_a_search_that_is_not_trusted_goes_on_from_its_end_before_it_looks_farther(demo):
    registration, renderer = demo
    problem = start_off_by(registration, 0.35, 2)
    *_, alone = fit_pose(problem, renderer, 2)
    alone = with_verdict(alone, problem, registration.mesh, renderer, judge_end)
    near = further_search(problem, alone, "on", 0.0)
    wide = further_search(problem, alone, "wide", 0.0)
    assert near is not None
    assert wide is not None
    assert np.array_equal(near.start, alone.parameters)
    assert np.array_equal(wide.start, problem.start)
    stages = [stages_of(one, renderer, alone.pose) for one in (problem, near, wide)]
    assert [len(each) for each in stages] == [len(stages[0]), len(stages[0]) - 1, len(stages[0])]
    assert further_search(replace(problem, method="paper"), alone, "on", 0.0) is None
    assert WAYS.index("on") < WAYS.index("turned") < WAYS.index("wide")


@pytest.mark.parametrize(
    ("way", "before", "found", "taken"),
    [
        ("on", 0.5, 0.45, True),  # it went on from there, and has less loss
        ("on", 0.5, 0.3, False),
        ("turned", 0.5, 0.55, False),
        ("turned", 0.5, 0.8, True),
        ("wide", 0.5, 0.55, False),
        ("wide", 0.75, 0.8, False),
        ("wide", 0.5, 0.8, True),
        ("wide", 0.02, 0.6, False),  # hardly likelier than not: then the one near the start
        ("wide", 0.02, 0.8, True),
    ],
)
def test_what_is_found_far_away_must_be_likely(way, before, found, taken):
    assert is_taken(found, before, way) == taken


def test_a_found_pose_that_is_not_sure_is_only_gone_on_from(demo):
    registration, renderer = demo
    problem = start_off_by(registration, 0.0, 0)
    *_, end = fit_pose(problem, renderer, 2)
    sure = with_verdict(end, problem, registration.mesh, renderer, judge_end)
    assert sure.verdict is not None
    assert sure.verdict.probability >= SURE
    less = replace(sure, verdict=replace(sure.verdict, probability=SURE - 0.01))
    lost = replace(sure, verdict=replace(sure.verdict, word="lost", probability=0.1))
    for end, ways in ((sure, []), (less, ["on"]), (lost, ["on", "turned", "wide"])):
        given = [w for w in dict.fromkeys(WAYS) if further_search(problem, end, w, 0.0)]
        assert given == ways


def test_the_limits_are_those_of_both_searches(demo):
    registration, renderer = demo
    problem = start_off_by(registration, 0.35, 2)
    problem = replace(problem, limits=Limits(evaluations=2000))
    *_, end = judged_fit(problem, registration.mesh, renderer, judge_end, 2)
    assert end.status is Status.EVALUATIONS_SPENT
    assert 2000 <= end.evaluations < 2040


def test_other_searches_have_no_second_one(demo):
    registration, renderer = demo
    problem = start_off_by(registration, 0.3, 2, method="paper", limits=Limits(evaluations=300))
    alone, states = run_both(problem, registration.mesh, renderer)
    assert states[-1].evaluations == alone.evaluations
