"""Ends of fits against one another, where it is known how far they are apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.evaluation.run import TRIALS
from poseviewer.evaluation.trials import RealTrial, real_tasks
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.table import RowTable
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from tests.evaluation.real_folder import write_real_folder
from tests.measure import agreement
from tests.measure.agreement import agreements, distances, summary


@pytest.fixture
def folder(scene):
    return write_real_folder(scene)


def save_ends(folder: Path, out: Path, shifts: list[tuple[float, float]]) -> None:
    """Trials of two cases, two fits each, whose ends are the truth shifted by model radii."""
    table = RowTable(out / TRIALS, RealTrial)
    tasks = real_tasks(folder, (5,), 2, "", FitSettings(limits=Limits(evaluations=1)))
    for task, shift in zip(tasks, shifts, strict=True):
        mesh, truth = load_mesh(task.case.mesh), task.case.truth
        there = FreeBodyChart.near(mesh, truth).to_pose(np.array([0.0, 0.0, 0.0, *shift, 0.0]))
        chart = FreeBodyChart.near(mesh, Pose(truth.camera, task.start.camera_from_model))
        end = " ".join(repr(float(number)) for number in chart.from_pose(there))
        table.append(replace(task.run(), end=end))


@pytest.mark.slow
def test_how_far_ends_are_apart_and_from_the_truth(folder, tmp_path):
    save_ends(folder, tmp_path, [(0.0, 0.0), (0.1, 0.0), (0.1, 0.0), (0.1, 0.001)])
    one, other = agreements(folder, tmp_path)
    assert (one.case, one.fits, other.case, other.fits) == ("ball-a", 2, "ball-b", 2)
    assert one.accuracy_percent == pytest.approx(2.0)
    # The chart's unit is half the diagonal of the ball's box in space, the per cents are of that in
    # the photo: a tenth of 3 ** 0.5 radii, of 2 * 2 ** 0.5 radii.
    assert one.apart_percent == pytest.approx(6.1, abs=0.7)
    assert one.middle_percent == pytest.approx(0.0, abs=1e-6)
    assert other.apart_percent == pytest.approx(one.apart_percent / 100.0, rel=0.1)
    assert other.middle_percent == pytest.approx(one.apart_percent, rel=0.1)
    apart = np.median([one.apart_percent, other.apart_percent])
    middle = other.middle_percent / 2.0
    shares = np.array([[x.middle_outline, x.truth_outline] for x in (one, other)])
    assert np.all(shares[:, 1] > 0.9)  # the photo is drawn at the truth
    assert shares[0, 0] == shares[0, 1] > shares[1, 0] + 0.3
    outlines = [f"{share:.0%}" for share in np.median(shares, axis=0)] + ["0"]
    line = summary([one, other]).splitlines()[1]
    assert line.split() == ["scene", "2", "4", f"{apart:.2f}", f"{middle:.2f}", "1", *outlines]


def test_the_middle_is_where_most_ends_are(scene, folder):
    mesh = load_mesh(scene.model)
    truth = real_tasks(folder, (5,), 1, "", FitSettings())[0].case.truth
    chart = FreeBodyChart.near(mesh, truth)
    ends = [chart.to_pose(np.array([0.0, 0.0, 0.0, u, 0.0, 0.0])) for u in (0.5, 0.0, 0.01)]
    apart = distances(mesh, ends, truth)
    assert np.allclose(apart, apart.T)
    assert np.all(np.diag(apart) == 0.0)
    assert np.argmin(apart.sum(axis=1)) != 0


def test_the_command_prints_a_line_for_each_case(folder, tmp_path, capsys):
    save_ends(folder, tmp_path, [(0.0, 0.0), (0.0, 0.1), (0.0, 0.0), (0.0, 0.0)])
    assert agreement.main([str(folder), str(tmp_path), "--degrees", "5"]) == 0
    said = capsys.readouterr()
    assert [line.split(",")[1] for line in said.out.splitlines()] == ["case", "ball-a", "ball-b"]
    assert "scene" in said.err


@pytest.mark.parametrize("degrees", [["--degrees", "15"], []])
def test_without_fits_it_says_so(folder, tmp_path, capsys, degrees):
    if degrees:
        save_ends(folder, tmp_path, 4 * [(0.0, 0.0)])
    assert agreement.main([str(folder), str(tmp_path), *degrees]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "trials.csv: no such fits" in message
    assert (tmp_path / TRIALS).exists() == bool(degrees)
