"""Shares with their intervals, in tables and figures of trials."""

import math
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.evaluation.report import Share, calibration_table, reliability_panels, study_table
from poseviewer.evaluation.trials import Trial
from poseviewer.figures.study_sheet import make_study_sheet

TRIAL = Trial(
    case="a", set="plain", method="paper", pixels="whole", reading="relative", percent=1.0,
    traits="model with colours", accuracy_percent=0.0, found=True, error_percent_start=9.0,
    error_percent_end=0.1, error_px_start=9.0, error_px_end=0.1, seconds=1.0, status="CONVERGED",
    verdict="found", probability=0.9,
)  # fmt: skip
LOST = replace(TRIAL, found=False, verdict="lost", probability=0.2)


def test_an_interval_is_wide_for_few_trials_and_never_beyond_0_and_100():
    assert str(Share.of([TRIAL] * 10)) == "100 (72 to 100)"
    assert str(Share.of([TRIAL] * 9 + [LOST] * 31)) == "22 (12 to 38)"
    assert str(Share.of([])) == "-"
    assert math.isnan(Share.of([]).low)


def test_shares_stand_beside_their_deviation_in_table_and_figure():
    far = [replace(trial, percent=16.0) for trial in (TRIAL, LOST, LOST, LOST)]
    trials = [*far, TRIAL, replace(TRIAL, set="photo-parallel"), replace(TRIAL, reading="absolute")]
    assert "| 100 (21 to 100) | 25 (5 to 70) |" in study_table(trials).as_markdown()
    relative, absolute = reliability_panels(trials)
    titles = ["synthetic, plain black ground", "photo, parallel"]
    assert [panel.axes["title"] for panel in relative] == titles
    near, away = relative[0].lines["paper, whole"]
    assert near == (1.0, *Share.of([TRIAL]))
    assert away == (16.0, *Share.of(far))
    sheet = make_study_sheet([relative, absolute])
    first, *_ = sheet.axes[0].collections  # the intervals of the first line
    ends = np.ravel(first.get_paths()[1].vertices)
    assert ends == pytest.approx([16.0, away[2], 16.0, away[3]])


def test_stated_probabilities_are_compared_with_the_true_share_by_stratum():
    half = replace(LOST, visible=0.6, traits="model with colours, focal length free")
    table = calibration_table([TRIAL, TRIAL, half, half, replace(TRIAL, probability=math.nan)])
    rows = {row[0]: row[1:] for row in table.rows}
    assert rows["all"] == ("4", "55", "50 (15 to 85)", "2", "100 (34 to 100)")
    assert rows["seen 50-90 %"] == rows["focal length free"] == ("2", "20", "0 (0 to 66)", "0", "-")
    assert rows["model with colours"] == rows["all"]
    assert len(rows) == 4
