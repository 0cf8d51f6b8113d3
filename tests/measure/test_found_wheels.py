"""Wheels on photos of other cars than the demo's: path-traced, and one real."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.measure.found_wheels import Trial, run_trials, summary


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "guess"), [("bmw-6", False), ("bmw-7", True), ("car_audi_tts", True)]
)
def test_wheels_place_the_car(shared_data: Path, case: str, guess: bool):
    (*_, trial) = run_trials(shared_data, case, guess)
    assert trial.case == case
    assert trial.percent is not None
    assert trial.percent < 15.0


@pytest.mark.slow
def test_a_car_seen_from_behind_shows_no_two_wheels(shared_data: Path):
    (*_, trial) = run_trials(shared_data, "bmw-2")
    assert (trial.case, trial.found) == ("bmw-2", False)


def test_the_summary_counts_what_is_right():
    trials = [
        Trial("cars", "a", True, 1.0, 3.0, 5.0, 2.0),
        Trial("cars", "b", True, 50.0, 70.0, 80.0, 40.0),
        Trial("cars", "c", False),
    ]
    assert summary(trials).splitlines()[1].split() == ["cars", "3", "2", "1", "2.0"]
