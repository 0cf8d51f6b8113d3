"""A search with restarts: when it restarts, from where, and whose pose is taken."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import SURE_FROM, SURE_IF_OCCLUDED, Verdict
from poseviewer.fit import search as searching
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.search import Search, is_accepted, is_focal_moved, is_restarted
from poseviewer.fit.stages import fit_pose, make_stages
from poseviewer.fit.visibility import Occlusion
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.opening.scenes import open_scene
from poseviewer.opening.sources import Sources
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.settings import Limits
from poseviewer.scene.types import Scene

FOUND, UNSURE = Verdict("found", SURE_FROM), Verdict("found", SURE_FROM - 0.01)
LOST = Verdict("lost", 0.1)


@pytest.fixture
def judge(monkeypatch):
    """Makes every verdict the same, and keeps the poses that were judged."""
    asked: list[FitProgress] = []

    def judging(verdict: Verdict) -> list[FitProgress]:
        def judged(progress: FitProgress, *_: object) -> FitProgress:
            asked.append(progress)
            return replace(progress, verdict=verdict)

        monkeypatch.setattr(searching, "judge_end", judged)
        asked.clear()
        return asked

    return judging


def run(scene: Scene, renderer, **changes) -> list[FitProgress]:
    settings = replace(scene.objects[0].settings, **changes)
    search = Search(scene.with_object(0, settings=settings), {0: renderer})
    return [now.progress for now in search.run()]


@pytest.fixture(scope="module")
def small(scene):
    """A small problem, its scene and renderer, and where one search ends."""
    data = open_scene(Sources(scene.photo, model=scene.model, start=scene.start))
    problem, _ = make_problem(data)
    renderer = make_renderer(data.objects[0].mesh)
    *_, alone = fit_pose(problem, renderer)
    return problem, data, renderer, alone


@pytest.mark.slow
def test_a_pose_that_is_trusted_ends_the_fit_and_another_is_searched_for_again(small, judge):
    _, data, renderer, alone = small
    judge(FOUND)
    *_, end = run(data, renderer)
    assert end.evaluations == alone.evaluations
    judge(LOST)
    states = run(data, renderer)
    assert all(state.status is Status.RUNNING for state in states[:-1])
    assert all(state.verdict is None for state in states[:-1])
    end = states[-1]
    assert end.status is Status.CONVERGED
    assert end.verdict == LOST
    assert end.start_loss == alone.start_loss
    assert end.evaluations > alone.evaluations
    losses = [state.loss for state in states if state.evaluations > alone.evaluations]
    assert max(losses) <= alone.loss  # what was found first stays the best until then
    assert np.all(np.diff([state.evaluations for state in states]) >= 0)


def test_a_restart_begins_where_the_search_before_ended_without_the_coarsest_level(small):
    problem, _, renderer, alone = small
    states = list(fit_pose(problem, renderer, before=alone))
    assert states[0].loss == alone.loss
    assert states[0].evaluations == alone.evaluations + 1
    assert {state.start_loss for state in states} == {alone.start_loss}
    stages = {state.restart for state in states}
    assert len(stages) == len(make_stages(problem, renderer)) - 1
    assert min(stages) == alone.restart + 1


def test_a_focal_length_is_settled_once_a_run_moves_it_by_less_than_its_spread(small):
    end = small[3]
    centre, camera = end.problem.mesh.centre, end.pose.camera
    spread = np.diag([0.01] * 6 + [0.05**2])
    told = replace(end, covariance=PoseCovariance(end.pose, centre, spread))
    for share, moves in ((0.01, (False, False)), (0.04, (True, False)), (0.06, (True, True))):
        focal = camera.fx * np.exp(share)
        before = replace(end.pose, camera=replace(camera, fx=focal, fy=focal))
        assert (is_focal_moved(before, end), is_focal_moved(before, told)) == moves


@pytest.mark.parametrize(
    ("verdict", "restarts"), [(FOUND, []), (UNSURE, [False]), (LOST, [False, True])]
)
def test_a_found_pose_that_is_not_sure_is_only_continued(small, verdict, restarts):
    problem, _, _, alone = small
    end = replace(alone, verdict=verdict)
    given = [is_turned for is_turned in (False, True) if is_restarted(end, is_turned)]
    assert given == restarts
    clipped = replace(problem, views=(replace(problem.views[0], loss=DEFAULT.on("clip")),))
    assert not is_restarted(replace(end, problem=clipped), False)  # no classes and edges
    # Less is asked of a pose among other objects.
    doubtful = replace(end, verdict=Verdict("doubtful", SURE_IF_OCCLUDED))
    assert is_restarted(doubtful, True)
    nothing = np.zeros(problem.photo.weights.shape, bool)
    views = (replace(problem.views[0], occlusion=Occlusion(nothing, nothing, nothing)),)
    assert not is_restarted(replace(doubtful, problem=replace(problem, views=views)), True)


@pytest.mark.parametrize(
    ("is_turned", "before", "found", "taken"),
    [
        (False, 0.5, 0.45, True),  # it has less loss
        (False, 0.5, 0.3, False),
        (True, 0.75, 0.8, False),
        (True, 0.5, 0.8, True),
        (True, 0.02, 0.4, False),  # neither is likely: then the one near
    ],
)
def test_a_turned_pose_must_be_likely(small, is_turned, before, found, taken):
    known: FitProgress = replace(small[3], verdict=Verdict("doubtful", before))
    after = replace(known, loss=known.loss - 1.0, verdict=Verdict("doubtful", found))
    assert is_accepted(after, known, is_turned) == taken
    assert not is_accepted(replace(after, loss=known.loss), known, is_turned)


def test_the_limits_are_those_of_all_searches(small, judge):
    _, data, renderer, alone = small
    limits = Limits(evaluations=alone.evaluations + 40)
    judge(LOST)
    *_, end = run(data, renderer, limits=limits)
    assert end.status is Status.EVALUATIONS_SPENT
    assert limits.evaluations <= end.evaluations < limits.evaluations + 40


@pytest.mark.parametrize("verdict", [FOUND, LOST])
def test_an_estimate_is_kept_and_says_why_unless_the_end_is_sure(small, judge, verdict):
    problem, data, renderer, _ = small
    asked = judge(verdict)
    *before, end = run(data, renderer, keep_start=True, limits=Limits(evaluations=300))
    if verdict is FOUND:
        assert end.status is Status.EVALUATIONS_SPENT
        return
    assert before[-1].loss < end.loss  # the search had found something
    assert end.status is Status.KEPT
    assert np.array_equal(end.parameters, problem.start)
    assert end.loss == end.start_loss == pose_loss(problem, renderer, problem.start)
    assert len(asked) == 2  # the verdict is on the start
    said = "away, where 10 % of comparable calibration fits were right."
    assert end.verdict.reasons[0].endswith(said)
