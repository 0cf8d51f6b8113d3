"""Starts are as far off as is said, and the same every time."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.errors import SingularChartError
from poseviewer.evaluation.photos import make_seed
from poseviewer.evaluation.trials import READINGS, draw_start

NUMBERS = np.array([0.7, -0.4, 0.0, 0.2])
SPANS = np.array([0.5, 0.5, 1.0, 1.0])


def draw(reading, share, seed, is_pose=lambda _: True):
    return draw_start(NUMBERS, SPANS, reading, share, seed, is_pose)


@pytest.mark.parametrize(("reading", "most"), [("relative", abs(NUMBERS)), ("absolute", SPANS)])
def test_each_number_is_off_by_up_to_the_share_and_no_more(reading, most):
    off = np.abs([draw(reading, 0.16, seed) - NUMBERS for seed in range(400)])
    assert np.all(off <= 0.16 * most)
    assert np.all(off.max(axis=0) >= 0.15 * most)


@pytest.mark.parametrize("reading", READINGS)
def test_a_seed_gives_one_start(reading):
    assert np.array_equal(draw(reading, 0.1, 5), draw(reading, 0.1, 5))
    assert not np.array_equal(draw(reading, 0.1, 5), draw(reading, 0.1, 6))


def test_what_is_no_pose_is_drawn_again():
    start = draw("absolute", 0.3, 1, lambda parameters: parameters[0] > 0.75)
    assert start[0] > 0.75
    with pytest.raises(SingularChartError, match="30%"):
        draw("absolute", 0.3, 1, lambda _: False)


def test_seeds_do_not_change_from_one_machine_to_the_next():
    assert make_seed(0, "plain", 1) == 2563212165
    assert make_seed(0, "plain", 2) != make_seed(0, "plain", 1)
