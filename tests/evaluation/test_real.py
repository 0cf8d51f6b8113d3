"""Starts of a folder of cases: every case is fitted, and the rows say how far off it was."""

from __future__ import annotations

import json

import numpy as np
import pytest

from poseviewer.evaluation.study import real_tasks
from poseviewer.fit.search import Search
from poseviewer.fit.settings import FitSettings, Limits
from tests.commands import read_rows
from tests.commands import run as run_command
from tests.evaluation.real_folder import write_real_folder

WANTED = ("case", "degrees", "draw", "method", "error_percent_start", "error_percent_end",
          "evaluations", "seconds", "verdict")  # fmt: skip


@pytest.fixture
def folder(scene):
    return write_real_folder(scene)


def run(folder, out, *more) -> int:
    options = ["study", "--real", folder, "--out", out, "--degrees", "5", "--jobs", 1, "--quiet"]
    return run_command(*options, *more)


@pytest.mark.slow
def test_every_start_is_fitted_and_both_methods_share_a_table(folder, tmp_path, capsys):
    assert run(folder, tmp_path) == 0
    assert run(folder, tmp_path, "--method", "paper", "--evaluations", 20_000) == 0
    rows = read_rows(tmp_path / "trials.csv")
    assert set(WANTED) <= set(rows[0])
    assert [(r["case"], r["draw"], r["method"]) for r in rows] == [
        (case, draw, method)
        for method in ("default", "paper")
        for case in ("ball-a", "ball-b")
        for draw in "01"
    ]
    for row in rows[:4]:
        assert float(row["error_percent_end"]) < 1.0 < float(row["error_percent_start"])
        assert float(row["accuracy_percent"]) == pytest.approx(2.0)
    assert "100%" in capsys.readouterr().out
    assert "| default: scene |" in (tmp_path / "study.md").read_text()


def test_cases_degrees_and_draws_are_chosen(folder, tmp_path):
    assert run(folder, tmp_path, "--cases", "*-b", "--draws", 1, "--evaluations", 30) == 0
    assert [(row["case"], row["draw"]) for row in read_rows(tmp_path / "trials.csv")] == [
        ("ball-b", "0")
    ]


def test_lines_of_the_report_tell_how_much_is_seen(folder, tmp_path):
    data = json.loads((folder / "cases.json").read_text())
    data["cases"][0]["visible"] = 0.6
    (folder / "cases.json").write_text(json.dumps(data))
    assert run(folder, tmp_path, "--draws", 1, "--evaluations", 30) == 0
    text = (tmp_path / "study.md").read_text()
    head, _, *rows = [line for line in text.splitlines() if line.startswith("|")]
    assert "| called found | of these wrongly |" in head
    assert [row.split("|")[1].strip() for row in rows] == [
        "default: scene",
        "default: scene, seen 50-90 %",
    ]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--cases", "dog"], "dog"),
        (["--degrees", "7"], "7"),
    ],
)
def test_what_cannot_work_is_said_in_a_line(folder, tmp_path, capsys, more, said):
    assert run(folder, tmp_path / "out", *more) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert said in message
    assert not (tmp_path / "out" / "trials.csv").exists()


@pytest.mark.parametrize("name", ["cases.json", "starts.json"])
@pytest.mark.parametrize("content", [None, "{", "[1]", '{"cases": [{"id": "a"}]}'])
def test_a_folder_without_cases_or_starts_is_said(folder, tmp_path, capsys, name, content):
    if content is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(content)
    assert run(folder, tmp_path / "out") == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert name in message


def test_the_other_cases_of_the_photo_can_be_given(folder):
    (task,) = real_tasks(folder, [5], 1, "*-a", FitSettings(), among_others=True)
    assert [one.name for one in task.others] == ["ball-b"]
    scene, _ = task.open()
    assert [one.locked for one in scene.objects] == [False, True]
    shown = scene.pose(1).camera_from_model
    assert np.array_equal(shown.translation, task.others[0].truth.camera_from_model.translation)
    (alone,) = real_tasks(folder, [5], 1, "*-a", FitSettings())
    assert len(alone.open()[0].objects) == 1


def test_a_trial_among_others_is_a_search_of_their_scene(folder):
    settings = FitSettings(chart="free-body", limits=Limits(evaluations=900))
    (task,) = real_tasks(folder, [5], 1, "*-a", settings, among_others=True)
    scene, renderer = task.open()
    *_, last = Search(scene, {0: renderer}).run()
    trial = task.run()
    assert trial.evaluations == last.progress.evaluations
    assert trial.loss_end == last.progress.loss < trial.loss_start
