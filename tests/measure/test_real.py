"""Photos with known poses: what is measured of each case, and what the table counts."""

import csv
from dataclasses import replace

import pytest

from tests.evaluation.real_folder import write_real_folder
from tests.measure import real
from tests.measure.real import Trial, summary

RIGHT = Trial("cups", "rectangle", "a", 9.0, 0.5, 1, 0.2, 0.1, 2.0, "found", False, 3, 5, 1, True)
WRONG = replace(RIGHT, percent=30.0, deviations=9.0, is_wrong=True, right_proposal=0)


@pytest.mark.slow
def test_the_scenes_ball_is_found(scene, capsys):
    folder = str(write_real_folder(scene))
    assert real.main([folder, "--cases", "ball-a"]) == 0
    out, err = capsys.readouterr()
    rows = list(csv.DictReader(out.splitlines()))
    assert [row["way"] for row in rows] == ["whole photo", "rectangle"]
    assert rows[0]["proposals"] == "0"  # a ball without print
    assert float(rows[1]["percent"]) < 2.0
    assert rows[1]["is_wrong"] == "False"
    assert "scene, " in err


@pytest.mark.slow
def test_several_photos_are_fitted_from_one_start(shared_data, capsys):
    folder = str(shared_data / "clutter")
    assert real.main([folder, "--views", "--every", "200", "--photos", "3"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert [row["way"] for row in rows] == ["3 photos"]


def test_the_table_counts_starts_and_what_is_found_wrongly():
    _, own, whole, _ = summary([RIGHT, WRONG]).splitlines()
    assert own.split()[2:6] == ["2", "9.00", "15.25", "1.00"]
    assert own.split()[8:] == ["50%", "50%", "50%", "2", "1", "50%", "1", "1", "2", "3.00"]
    assert whole.split()[2:] == own.split()[2:]
