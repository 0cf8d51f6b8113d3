"""What the studies of starts and of models print, and what they say of a folder of others."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from poseviewer.errors import SettingsError
from tests.measure import auto_start
from tests.measure.trial_table import print_trials


@dataclass(frozen=True, slots=True)
class Row:
    name: str
    share: float


def test_rows_go_to_one_stream_and_their_summary_to_the_other(capsys):
    code = print_trials([Row("a, b", 0.5), Row("c", 1.0)], lambda rows: f"{len(rows)} rows")
    out, err = capsys.readouterr()
    assert code == 0
    assert list(csv.reader(out.splitlines())) == [["name", "share"], ["a, b", "0.5"], ["c", "1.0"]]
    assert err == "2 rows\n"


def test_what_was_printed_before_a_mistake_stays(capsys):
    def trials() -> Iterator[Row]:
        yield Row("a", 0.5)
        raise SettingsError("b: is not there; name another")

    assert print_trials(trials(), lambda _: "never") == 2
    out, err = capsys.readouterr()
    assert out.splitlines() == ["name,share", "a,0.5"]
    assert err == "poseviewer: b: is not there; name another\n"


@pytest.mark.parametrize("study", [auto_start])
def test_a_folder_without_cases_is_said(study, tmp_path, capsys):
    assert study.main([str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("poseviewer: ")
    assert "cases.json" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("study", [auto_start])
def test_no_case_at_all_is_refused(study, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        study.main([str(tmp_path), "--every", "0"])
    assert stop.value.code == 2
    assert "--every: 0 is not a whole number above 0" in capsys.readouterr().err
