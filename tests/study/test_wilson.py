"""Wilson intervals are those of the books."""

from __future__ import annotations

import pytest
from scipy.stats import binomtest

from poseviewer.study.wilson import wilson_interval


@pytest.mark.parametrize(
    ("found", "trials", "low", "high"),
    [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (8, 10, 0.4902, 0.9433), (10, 10, 0.7225, 1.0)],
)
def test_known_intervals(found, trials, low, high):
    assert wilson_interval(found, trials) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(("found", "trials"), [(1, 1), (3, 7), (98, 100), (0, 1000)])
def test_as_scipy_has_them(found, trials):
    wanted = binomtest(found, trials).proportion_ci(method="wilson")
    assert wilson_interval(found, trials) == pytest.approx((wanted.low, wanted.high), abs=1e-12)


@pytest.mark.parametrize(("found", "trials"), [(0, 0), (3, 2), (-1, 2)])
def test_no_trials_have_none(found, trials):
    with pytest.raises(ValueError, match="successes"):
        wilson_interval(found, trials)
