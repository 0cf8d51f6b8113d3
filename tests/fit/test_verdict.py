"""The verdict on poses of the small scene: the true one is better than one far off, and is told."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from poseviewer.confidence.verdict import Verdict, judge, judge_together, percent_right
from poseviewer.confidence.weights import FOUND_FROM, LOST_BELOW
from poseviewer.fit.judge import gather_features
from poseviewer.fit.probing import free_motions
from poseviewer.fit.problem import make_problem
from poseviewer.geometry.camera import Parallel
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.starts.loading import open_photo
from poseviewer.vehicle.chart import LEAST_AXLE_COMPONENT, VehicleChart
from tests.geometry.test_charts import make_keypoints
from tests.opened import by

OFF = np.array([0.7, -0.5, 0.3, 0.3, 0.2, 0.1])


@pytest.fixture(scope="module")
def verdicts(scene):
    registration = open_photo(scene.photo, scene.model, scene.truth)
    problem, _ = make_problem(by(registration, chart="free-body"))
    renderer = SoftwareRenderer(registration.objects[0].mesh)
    poses = [problem.chart.to_pose(parameters) for parameters in (np.zeros(6), OFF)]
    return [
        judge(gather_features(problem, registration.objects[0].mesh, renderer, pose))
        for pose in poses
    ]


def test_the_true_pose_is_likely_and_one_far_off_is_lost(verdicts):
    right, wrong = verdicts
    assert wrong.word == "lost"
    assert right.word != "lost"
    assert right.probability > 0.5 > wrong.probability


def test_the_features_speak_for_the_true_pose(verdicts):
    right, wrong = (verdict.features for verdict in verdicts)
    assert right.turn_margin > wrong.turn_margin
    assert right.spread_percent < wrong.spread_percent
    assert all(np.isfinite(list(asdict(right).values())))


def test_worse_features_are_never_more_probable(verdicts):
    best = verdicts[0].features
    worse = replace(best, spread_percent=best.spread_percent + 20.0, outline=0.0)
    assert judge(worse).probability < judge(best).probability


def test_a_pose_at_the_border_of_its_chart_has_motions(scene):
    """The axle lies as flat as the vehicle's numbers allow: one more step leads to no pose."""
    registration = open_photo(scene.photo, scene.model, scene.truth)
    problem, _ = make_problem(by(registration, chart="free-body"))
    camera = Parallel(60.0, 100.0, 80.0, 200, 160)
    chart = VehicleChart(make_keypoints(np.random.default_rng(3)).left, camera)
    flattest = np.sqrt(1.0 - LEAST_AXLE_COMPONENT**2) - 1e-9
    parameters, free = np.array([0.3, 0.6, 0.3, 0.01, 0.0, flattest]), (True,) * 4 + (False, True)
    with pytest.raises(OutsideChartError):
        chart.to_pose(parameters + 1e-4 * np.eye(6)[5])
    body = FreeBodyChart.near(registration.objects[0].mesh, chart.to_pose(parameters), False)
    views = (replace(problem.views[0], chart=chart),)
    here = replace(problem, views=views, start=parameters, free=free)
    motions = free_motions(here, parameters, body)
    np.testing.assert_allclose(motions @ motions.T, np.eye(5), atol=1e-9)


def test_a_model_of_which_too_little_is_seen_is_lost(verdicts):
    right = verdicts[0].features
    hidden = judge(replace(right, seen=0.3))
    assert hidden.word == "lost"
    assert any("Only 30%" in reason for reason in hidden.reasons)
    assert judge(replace(right, seen=0.5)).word == verdicts[0].word


def test_a_model_in_part_hidden_must_be_more_probable_to_be_found(verdicts):
    right = verdicts[0].features
    shares = np.linspace(0.0, 1.0, 101)
    whole = [replace(right, outline=share, seen=1.0) for share in shares]
    between = [f for f in whole if judge(f).word == "found" and judge(f).probability < 0.95]
    assert between
    assert all(judge(replace(f, seen=0.6)).word == "doubtful" for f in between)


@pytest.mark.parametrize("word", ["found", "doubtful", "lost"])
def test_word_and_number_of_a_verdict_never_contradict(word: str):
    """The number alone leads to its word, and is never sure."""
    said = {percent_right(word, probability) for probability in np.linspace(0.0, 1.0, 101)}
    assert max(said) < 100
    for share in said:
        number = share / 100.0
        by_number = (
            "found" if number >= FOUND_FROM else "lost" if number < LOST_BELOW else "doubtful"
        )
        assert by_number == word


@pytest.mark.parametrize(
    ("alone", "word"),
    [
        ([0.9, 0.9], "found"),
        ([0.1, 0.1, 0.1], "lost"),
        ([0.99, 0.99, 0.3], "found"),
        ([0.97, 0.97, 0.01], "doubtful"),  # a camera contradicts the other two
        ([0.99, 0.01], "doubtful"),  # one of the other
        ([0.99, 0.99, 0.99, 0.7, 0.7, 0.7, 0.7], "doubtful"),  # fewer than half are as sure
        ([0.87, 0.77, 0.47, 0.52, 0.95, 0.01, 0.01, 0.06], "doubtful"),  # as many for it as against
        ([0.87, 0.47, 0.47, 0.52, 0.95, 0.01, 0.01, 0.06], "lost"),
    ],
)
def test_several_photos_are_of_one_mind_or_it_is_doubtful(alone: list[float], word: str):
    verdict = judge_together([Verdict("found", one, (), None) for one in alone])
    assert verdict.word == word
    assert min(alone) - 1e-9 <= verdict.probability <= max(alone) + 1e-9
    assert len(verdict.views) == len(alone)
