"""Calibration on small tables: what can be told apart is, and what cannot is not claimed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.confidence import verdict
from poseviewer.evaluation.trials import Trial
from poseviewer.files.table import append_row
from tests.measure import calibrate
from tests.measure.calibrate import (
    NAMES,
    VERDICT,
    Calibration,
    load_judged,
    weights_as_python,
    written_part,
)

TRIAL = Trial(
    case="", set="s", method="default", pixels="near", accuracy_percent=1.0, found=True, status="",
    error_percent_start=9.0, error_percent_end=1.0, error_px_start=9.0, error_px_end=1.0, seconds=1,
)  # fmt: skip


def write_table(path: Path, informative: bool) -> Path:
    """Forty trials of twenty cases; right ones show better features, or the same."""
    random = np.random.default_rng(0)
    for index in range(40):
        right = index % 2 == 0
        level = (3.0 if right else 0.0) if informative else 0.0
        features = {name: level + random.normal(0, 0.3) for name in NAMES}
        text = " ".join(f"{name}={value:.4f}" for name, value in features.items())
        error = 1.0 if right else 9.0
        append_row(path, replace(TRIAL, case=f"case-{index // 2}", error_percent_end=error,
                                 evidence=text))  # fmt: skip
    return path


@pytest.mark.parametrize(("informative", "area"), [(True, (1.0, 1.0)), (False, (0.2, 0.8))])
def test_only_what_can_be_told_apart_is(tmp_path, capsys, informative, area):
    table = write_table(tmp_path / "trials.csv", informative)
    assert calibrate.main([str(table)]) == 0
    shown = capsys.readouterr().out
    line = next(line for line in shown.splitlines() if line.startswith("| other half"))
    assert area[0] <= float(line.split("|")[4]) <= area[1]


def test_what_is_seen_is_weighed_without_touching_the_other_weights(tmp_path, capsys):
    table = write_table(tmp_path / "trials.csv", informative=True)
    assert calibrate.main([str(table), "--seen"]) == 0
    *others, seen = written_part(VERDICT.read_text()).splitlines()[2 : 2 + len(NAMES)]
    written = capsys.readouterr().out.splitlines()
    assert set(others) < set(written)
    assert seen not in written


def test_a_truth_that_is_known_to_be_worse_makes_more_of_them_right(tmp_path, capsys):
    table = write_table(tmp_path / "trials.csv", informative=True)
    assert sum(trial.right for trial in load_judged([table])) == 20
    assert sum(trial.right for trial in load_judged([table], {"s": 8.5})) == 40
    for name, words in (("s", "must be some of both"), ("other", "no trial of set")):
        assert calibrate.main([str(table), "--accuracy", name, "8.5"]) == 2
        assert words in capsys.readouterr().err


def test_the_weights_of_the_program_are_written_as_they_stand():
    columns = np.array(list(verdict.FEATURES.values())).T
    limits = verdict.OFFSET, verdict.FOUND_FROM, verdict.LOST_BELOW
    text = weights_as_python(Calibration(columns[0], columns[1], columns[2], *limits), 156, 123)
    assert tuple(verdict.FEATURES) == NAMES
    assert text == written_part(VERDICT.read_text())
