"""Calibration on small tables: what can be told apart is, and what cannot is not claimed."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from poseviewer.errors import SettingsError
from tests.measure import calibrate_verdict
from tests.measure.calibrate_verdict import NAMES, JudgedTrial, calibrate, load_judged


def write_table(path, informative: bool):
    """Forty trials of twenty cases; right ones show better evidence, or the same."""
    random = np.random.default_rng(0)
    with path.open("w", newline="") as file:
        columns = ("case", "set", "method", "accuracy_percent", "error_percent_end", "verdict")
        table = csv.DictWriter(file, (*columns, "evidence"))
        table.writeheader()
        for index in range(40):
            right = index % 2 == 0
            level = (3.0 if right else 0.0) if informative else 0.0
            signs = {name: -1.0 if name == "spread_percent" else 1.0 for name in NAMES}
            parameters = {name: signs[name] * level + random.normal(0, 0.3) for name in NAMES}
            text = " ".join(f"{name}={value:.4f}" for name, value in parameters.items())
            cells = (f"case-{index // 2}", "s", "default", 1.0, 1.0 if right else 9.0, "", text)
            table.writerow(dict(zip((*columns, "evidence"), cells, strict=True)))
    return path


def test_separable_rows_have_an_area_of_one_and_right_words(tmp_path, capsys):
    table = write_table(tmp_path / "trials.csv", informative=True)
    assert calibrate_verdict.main([str(table)]) == 0
    shown = capsys.readouterr().out
    other = next(line for line in shown.splitlines() if line.startswith("other half"))
    assert "1.00" in other
    trials = load_judged([table])
    found = calibrate([trial for trial in trials if trial.tunes])
    words = found.words(trials)
    assert words == ["found" if trial.right else "lost" for trial in trials]
    scope: dict[str, object] = {}
    exec(shown[shown.index('"""How much') :], scope)  # what would be written is Python
    assert set(scope["FEATURES"]) == set(NAMES)  # type: ignore[call-overload]


def test_rows_without_information_are_not_told_apart(tmp_path):
    trials = load_judged([write_table(tmp_path / "trials.csv", informative=False)])
    found = calibrate([trial for trial in trials if trial.tunes])
    other = [trial for trial in trials if not trial.tunes]
    right, scores = np.array([trial.right for trial in other]), found.probabilities(other)
    assert 0.2 < np.mean(scores[right][:, None] > scores[~right]) < 0.8


def test_a_truth_that_is_known_to_be_worse_makes_more_of_them_right(tmp_path, capsys):
    table = write_table(tmp_path / "trials.csv", informative=True)
    assert sum(trial.right for trial in load_judged([table])) == 20
    assert sum(trial.right for trial in load_judged([table], {"s": 8.5})) == 40
    with pytest.raises(SettingsError, match="no trial of set 'other'; the tables' sets: s"):
        load_judged([table], {"other": 8.5})
    assert calibrate_verdict.main([str(table), "--accuracy", "s=3"]) == 0
    assert calibrate_verdict.main([str(table), "--accuracy", "s=8.5"]) == 2  # all are right
    assert "are right: there must be some of both" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["s", "s=much", "=3", "s=-1", "s=nan"])
def test_an_accuracy_that_is_none_is_refused(tmp_path, capsys, text):
    with pytest.raises(SystemExit) as stopped:
        calibrate_verdict.main([str(tmp_path / "trials.csv"), "--accuracy", text])
    assert stopped.value.code == 2
    assert "wanted SET=PERCENT" in capsys.readouterr().err


def test_all_trials_of_a_case_are_in_one_half(tmp_path):
    trials = load_judged([write_table(tmp_path / "trials.csv", informative=True)])
    halves = {trial.case: {t.tunes for t in trials if t.case == trial.case} for trial in trials}
    assert all(len(half) == 1 for half in halves.values())
    assert {next(iter(half)) for half in halves.values()} == {True, False}


def test_one_kind_of_answer_is_refused_in_a_sentence():
    trials = [JudgedTrial("a", "s", True, dict.fromkeys(NAMES, 1.0))] * 3
    with pytest.raises(SettingsError, match="of 3 trials to tune on, 3 are right"):
        calibrate(trials)
