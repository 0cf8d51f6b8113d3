"""Wilson intervals are those of the books."""

from __future__ import annotations

import pytest

from poseviewer.evaluation.report import wilson_interval


@pytest.mark.parametrize(
    ("found", "trials", "low", "high"),
    [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (8, 10, 0.4902, 0.9433), (10, 10, 0.7225, 1.0)],
)
def test_intervals_are_those_of_the_books(found, trials, low, high):
    assert wilson_interval(found, trials) == pytest.approx((low, high), abs=5e-5)
