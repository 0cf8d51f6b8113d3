"""The verdict on poses of the small scene: the true one is better than one far off, and is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.fit.gathering import gather_evidence
from poseviewer.fit.verdict import judge
from poseviewer.registration import FitSettings, as_recorded, load_registration, make_problem
from poseviewer.render.software import SoftwareRenderer

OFF = np.array([0.7, -0.5, 0.3, 0.3, 0.2, 0.1])


@pytest.fixture(scope="module")
def verdicts(scene):
    registration = load_registration(scene.photo, scene.model, scene.truth)
    problem, _ = make_problem(registration, FitSettings(chart="free-body"))
    renderer = SoftwareRenderer(registration.mesh)
    poses = [problem.chart.to_pose(numbers) for numbers in (np.zeros(6), OFF)]
    return [judge(gather_evidence(problem, registration.mesh, renderer, pose)) for pose in poses]


def test_the_true_pose_is_likely_and_one_far_off_is_lost(verdicts):
    right, wrong = verdicts
    assert wrong.word == "lost"
    assert right.word != "lost"
    assert right.probability > 0.5 > wrong.probability


def test_the_numbers_speak_for_the_true_pose(verdicts):
    right, wrong = (verdict.evidence for verdict in verdicts)
    assert right.loss_margin > wrong.loss_margin
    assert right.outline_excess > wrong.outline_excess
    assert all(np.isfinite(list(as_recorded(verdicts[0]).evidence.values())))


def test_nothing_to_see_is_lost():
    verdict = judge(None)
    assert (verdict.word, verdict.probability) == ("lost", 0.0)


def test_worse_evidence_is_never_more_probable(verdicts):
    best = verdicts[0].evidence
    worse = replace(best, spread_percent=best.spread_percent + 20.0, outline=0.0)
    assert judge(worse).probability < judge(best).probability
