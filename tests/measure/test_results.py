"""The results page is made from what was measured, and from nothing else."""

from __future__ import annotations

import csv
from datetime import date
from pathlib import Path

import pytest

from tests.measure.results import BEGIN, END, PAGE, README, main, page_of, summary_of, with_rows

COLUMNS = ("method", "set", "case", "degrees", "accuracy_percent", "verdict",
           "error_percent_start", "error_percent_end")  # fmt: skip


def measured(folder: Path, ends: dict[str, list[float]]) -> Path:
    for study in ("study", "real", "clutter", "among"):
        (folder / study).mkdir()
    (folder / "study" / "study.md").write_text(
        "# Study\n\n| a table of the study |\n\n![it](study.png)\n"
    )
    (folder / "bench.md").write_text("| a table of the bench |\n")
    for study, name in (("real", "hope"), ("clutter", "clutter"), ("among", "among")):
        with (folder / study / "trials.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(COLUMNS)
            for end in ends[name]:
                verdict = "found" if end < 3.0 else "lost"
                table.writerow(("default", name, f"{name}-0", 15, 1.0, verdict, 10.0, end))
            table.writerow(("paper", name, f"{name}-0", 15, 1.0, "found", 10.0, 99.0))
    return folder


def test_page_and_rows_say_what_was_measured(tmp_path: Path):
    folder = measured(
        tmp_path, {"hope": [0.4, 0.6, 1.5, 20.0], "clutter": [0.5], "among": [1.2, 4.0]}
    )
    page = page_of(folder, date(2026, 11, 23), "--starts 1")
    assert "Measured on 2026-11-23" in page
    assert "results FOLDER --starts 1`" in page
    assert "| a table of the study |" in page
    assert "| a table of the bench |" in page
    assert "| all | 15° | 2 | 10.0 % | 2.60 % | 0 % | 50 % | 50 % | 50 % | 100 % |" in page
    wanted = "| 15° | 4 | 10.0 % | 1.05 % | 50 % | 75 % | 75 % | 75 % |"
    assert wanted in page
    assert "| first table | `found` | 3 | 3 | 0 |" in page
    assert "| first table | `lost` | 1 | 0 | 1 |" in page
    assert "| groceries | 4 | 1.05 % | 50 % | 75 % |" in summary_of(folder)


def test_the_readme_has_a_place_for_its_rows():
    text = README.read_text(encoding="utf-8")
    changed = with_rows(text, "| new |")
    assert f"{BEGIN}\n| new |\n{END}" in changed
    assert changed.split(BEGIN)[0] == text.split(BEGIN)[0]
    assert changed.split(END)[1] == text.split(END)[1]


def test_a_folder_without_trials_is_said_and_changes_no_page(tmp_path: Path, capsys):
    before = PAGE.read_bytes(), README.read_bytes()
    with pytest.raises(SystemExit, match="2"):
        main([str(tmp_path), "--only-write"])
    message = capsys.readouterr().err.splitlines()[-1]
    assert message.endswith("holds no trials; leave out --only-write to measure them")
    assert (PAGE.read_bytes(), README.read_bytes()) == before
