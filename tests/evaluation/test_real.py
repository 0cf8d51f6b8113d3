"""Starts of a folder of cases: every case is fitted, and the rows say how far off it was."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from poseviewer.evaluation.plan import Plan
from poseviewer.evaluation.study import real_tasks
from poseviewer.fit.search import Search
from poseviewer.scene.settings import Limits
from tests.commands import read_rows, refusal, run
from tests.evaluation.real_folder import write_real_folder
from tests.scene import make_scene
from tests.writing import edit

STUDY = "study --real . --out out --degrees 5 --jobs 1 --quiet"


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A folder of cases, as the working folder."""
    monkeypatch.chdir(tmp_path)
    return write_real_folder(make_scene(tmp_path))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.usefixtures("folder")
def test_every_start_is_fitted_and_both_methods_share_a_table(capsys):
    assert run(f"{STUDY} --draws 1 --evaluations 2000") == 0
    assert run(f"{STUDY} --draws 1 --method paper --evaluations 2000") == 0
    rows = read_rows(Path("out/trials.csv"))
    every = product(("default", "paper"), ("ball-a", "ball-b"), "0")
    assert [(r["method"], r["case"], r["draw"]) for r in rows] == [*every]
    for row in rows[:2]:
        assert float(row["error_percent_end"]) < 1.0 < float(row["error_percent_start"])
        assert float(row["accuracy_percent"]) == pytest.approx(2.0)
        assert (float(row["probability"]) > 0.5) == (row["verdict"] != "lost")
        assert row["traits"] == "model with colours"
    printed = capsys.readouterr().out
    assert "| model with colours | 4 |" in printed
    assert "| default: scene |" in Path("out/study.md").read_text()


def test_cases_and_draws_are_chosen_and_the_report_tells_how_much_is_seen(folder):
    edit(folder / "cases.json", lambda data: data["cases"][0].update(visible=0.6))
    line = f"{STUDY} --draws 1 --evaluations 30"
    assert run(f"{line} --cases *-b") == 0
    assert [(r["case"], r["draw"]) for r in read_rows(Path("out/trials.csv"))] == [("ball-b", "0")]
    assert run(line) == 0
    head, _, *rows = Path("out/study.md").read_text().splitlines()[4:8]
    assert "| 5° | start | end |" in head
    names = ["default: scene", "default: scene, seen 50-90 %"]
    assert [row.split("|")[1].strip() for row in rows] == names


def test_starts_of_an_unknown_focal_length_are_a_tenth_off_in_it(folder):
    plan = Plan(out=folder, real=folder, degrees=(5,), draws=2)
    known, off = (real_tasks(replace(plan, free_focal=free), folder) for free in (False, True))
    near, far = (np.array([t.start.camera_from_model.translation for t in s]) for s in (known, off))
    assert (far / near)[:, 2] == pytest.approx([1.1, 1.0 / 1.1] * 2, rel=0.02)  # as large


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_the_error_of_a_focal_length_is_told_in_its_own_deviations():
    assert run(f"{STUDY} --draws 1 --cases *-a --free-focal") == 0
    (row,) = read_rows(Path("out/trials.csv"))
    assert row["traits"] == "model with colours, focal length free"
    evidence = dict(part.split("=") for part in row["evidence"].split())
    assert 0.0 < float(evidence["focal_deviations"]) < 5.0


@pytest.mark.parametrize(
    ("damaged", "content", "more", "said"),
    [
        ("", None, "--cases dog", "dog"),
        ("", None, "--degrees 7", "degrees 7"),
        *(
            (name, content, "", name)
            for name in ("cases.json", "starts.json")
            for content in (None, "{", "[1]", '{"cases": [{"id": "a"}]}')
        ),
    ],
)
def test_what_cannot_work_is_said_in_a_line(folder, capsys, damaged, content, more, said):
    if damaged and content is None:
        (folder / damaged).unlink()
    elif damaged:
        (folder / damaged).write_text(content)
    assert said in refusal(capsys, f"{STUDY} {more}")
    assert not Path("out/trials.csv").exists()


@pytest.mark.slow
@pytest.mark.long
def test_a_trial_among_others_is_a_search_of_their_scene(folder):
    plan = Plan(out=folder, degrees=(5,), draws=1, cases="*-a", limits=Limits(evaluations=300))
    (task,) = real_tasks(replace(plan, among_others=True), folder)
    assert [one.name for one in task.others] == ["ball-b"]
    scene, renderer = task.open()
    assert [one.locked for one in scene.objects] == [False, True]
    shown = scene.pose(1).camera_from_model
    assert np.array_equal(shown.translation, task.others[0].truth.camera_from_model.translation)
    *_, last = Search(scene, {0: renderer}).run()
    trial = task.run()
    assert trial.evaluations == last.progress.evaluations
    assert trial.loss_end == last.progress.loss < trial.loss_start
    (alone,) = real_tasks(plan, folder)
    assert len(alone.open()[0].objects) == 1
