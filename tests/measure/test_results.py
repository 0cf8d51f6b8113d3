"""The results page is made from what was measured, and from nothing else."""

import csv
from pathlib import Path

import pytest

from tests.measure.results import PAGE, README, fill, page_tables, readme_rows

COLUMNS = ("method", "set", "case", "degrees", "accuracy_percent", "verdict",
           "error_percent_start", "error_percent_end")  # fmt: skip


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    ends = {"hope": [0.4, 0.6, 1.5, 20.0], "clutter": [0.5], "among": [1.2, 4.0]}
    for study, name in (("real", "hope"), ("clutter", "clutter"), ("among", "among")):
        (tmp_path / study).mkdir()
        with (tmp_path / study / "trials.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(COLUMNS)
            for end in ends[name]:
                verdict = "found" if end < 3.0 else "lost"
                table.writerow(("default", name, f"{name}-0", 15, 1.0, verdict, 10.0, end))
            table.writerow(("paper", name, f"{name}-0", 15, 1.0, "found", 10.0, 99.0))
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.md").write_text("# Study\n\n| a study |\n\n![it](study.png)\n")
    (tmp_path / "speed.md").write_text("| speeds |\n")
    return tmp_path


def test_page_and_readme_say_what_was_measured(measured: Path) -> None:
    tables = page_tables(measured, "--starts 1")
    assert "results FOLDER --starts 1`" in tables["measured"]
    assert (tables["study"], tables["speed"]) == ("| a study |", "| speeds |")
    row = "| 15° | 4 | 10.0 % | 1.05 % | 50 % | 75 % | 75 % | 75 % |"
    assert tables["real"].endswith(row)
    row = "| all | 15° | 2 | 10.0 % | 2.60 % | 0 % | 50 % | 50 % | 50 % | 100 % |"
    assert tables["among"].endswith(row)
    assert "| first table | `found` | 3 | 3 | 0 |" in tables["verdict"]
    assert "| first table | `lost` | 1 | 0 | 1 |" in tables["verdict"]
    assert "| groceries | 4 | 1.05 % | 50 % | 75 % |" in readme_rows(measured)
    for path, contents in ((PAGE, tables), (README, {"results": "| new |"})):
        before = path.read_text(encoding="utf-8")
        copy = measured / path.name
        copy.write_text(before, encoding="utf-8")
        fill(copy, contents)
        after = copy.read_text(encoding="utf-8")
        assert all(table in after for table in contents.values())
        assert after.split("<!--")[0] == before.split("<!--")[0]
        assert after.rpartition("-->")[2] == before.rpartition("-->")[2]
