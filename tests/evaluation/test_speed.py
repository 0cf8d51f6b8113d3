"""The benchmark goes every path for real, and says of each what it says it does."""

from __future__ import annotations

import pytest

from poseviewer.cli import main as cli
from poseviewer.evaluation.speed import (
    SpeedReport,
    demo_with_truth,
    make_workload,
    measure_speed,
    time_paths,
)
from tests.gpu import require_gpu
from tests.opengl import require_opengl

MAP_SIZE = 3


@pytest.fixture(scope="module")
def work():
    return make_workload(*demo_with_truth(), 5_000, 320)


@pytest.fixture(scope="module")
def report() -> SpeedReport:
    require_opengl()
    return measure_speed(True, lambda _: None, MAP_SIZE)


@pytest.mark.slow
def test_a_report_has_each_path_both_methods_and_the_maps(report):
    assert [row.path for row in report.rows] == ["a", "d", "e"]
    for row in report.rows:
        assert 0.0 < row.least <= row.median <= row.most
        assert row.threads == (report.machine["cores"] if row.path == "e" else 1)
    assert [fit["method"] for fit in report.fits] == ["default", "paper"]
    assert all(fit["evaluations"] > 1 for fit in report.fits)
    assert (report.maps["maps"], report.maps["points"]) == (15, 15 * MAP_SIZE**2)
    text = report.as_markdown()
    for words in ("| a  pyrender", "software, all cores", "machine of 2010", "numba", "15 maps of"):
        assert words in text, words


@pytest.mark.slow
def test_a_gpu_is_timed(work, monkeypatch):
    require_gpu(monkeypatch)
    assert [row.path for row in time_paths(work, "f", 1)] == ["f"]


def test_rows_go_to_a_file_that_can_be_written_alone(tmp_path, capsys):
    assert cli.main(["bench", "--quick", "--json", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert "is a folder" in printed.err
    assert printed.err.count("\n") == 1  # nothing about the work
