"""The benchmark goes every path for real, and says of each what it says it does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import jsonschema
import pytest

from poseviewer.cli import main as cli
from poseviewer.evaluation.speed import (
    SpeedReport,
    StageTime,
    demo_with_truth,
    make_workload,
    measure_speed,
    time_paths,
)
from poseviewer.fit.loss import lighting_loss
from poseviewer.render.moments import moments_of_images
from poseviewer.render.renderers import make_renderer
from tests.gpu import require_gpu
from tests.opengl import require_opengl

STAGES = {
    "a": {"draw", "sum", "loss", "total"},
    "d": {"draw", "sum", "loss", "total"},
    "e": {"total"},
}
ROW = {
    "type": "object",
    "properties": {
        "path": {"enum": list("adef")},
        "stage": {"type": "string"},
        **{k: {"type": "integer", "minimum": 1} for k in ("triangles", "width", "height")},
        **{k: {"type": "integer", "minimum": 1} for k in ("threads", "runs", "faces")},
        **{k: {"type": "number", "minimum": 0} for k in ("ms_median", "ms_min", "ms_max")},
        "covered_px": {"type": "integer", "minimum": 1},
    },
    "required": [field.name for field in fields(StageTime)],
}
SCHEMA = {
    "properties": {
        "machine": {"required": ["cpu", "cores", "system", "load"]},
        "versions": {"required": ["python", "poseviewer", "numpy", "numba", "opengl", "gpu"]},
        "rows": {"type": "array", "minItems": 1, "items": ROW},
        "paper": {"required": ["source", "render_ms", "loss_ms"]},
    },
    "required": ["machine", "versions", "rows", "fits", "maps", "paper", "notes"],
}
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
    data = json.loads(report.as_json_bytes())
    jsonschema.validate(data, SCHEMA)
    stages = {letter: {r["stage"] for r in data["rows"] if r["path"] == letter} for letter in "ade"}
    assert stages == STAGES
    for row in report.rows:
        assert 0.0 <= row.ms_min <= row.ms_median <= row.ms_max
        assert row.threads == (report.machine["cores"] if row.path == "e" else 1)
    assert [fit["method"] for fit in report.fits] == ["default", "paper"]
    assert all(fit["evaluations"] > 1 for fit in report.fits)
    (maps,) = report.maps
    assert (maps["maps"], maps["points"]) == (15, 15 * MAP_SIZE**2)
    text = report.as_markdown()
    for words in ("| a  pyrender", "software, all cores", "machine of 2010", "numba", "15 maps of"):
        assert words in text, words


def test_stages_add_up_to_the_total(work):
    """To more only where rasterising alone took longer than rasterising and summing."""
    times = {row.stage: row.ms_median for row in time_paths(work, "d", 2)}
    assert times["total"] > 0.0
    parts = times["draw"] + times["sum"] + times["loss"]
    assert parts == pytest.approx(times["total"], rel=0.5)


def test_the_paths_find_the_same_losses(work):
    require_opengl()
    plain = make_renderer(work.renderer.mesh, "opengl")
    for pose in work.poses:
        found = lighting_loss(moments_of_images(plain.render(pose), work.photo))
        fused = lighting_loss(work.renderer.moments(pose, work.photo))
        assert found == pytest.approx(fused, abs=0.02)


def test_a_gpu_is_timed(work, monkeypatch):
    require_gpu(monkeypatch)
    assert [(row.path, row.stage) for row in time_paths(work, "f", 1)] == [("f", "total")]


def test_rows_go_to_a_file_that_can_be_written_alone(tmp_path, capsys):
    assert cli.main(["bench", "--quick", "--json", str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert "is a folder" in printed.err
    assert printed.err.count("\n") == 1  # nothing about the work


@pytest.mark.slow
def test_without_opengl_path_a_is_left_out(tmp_path):
    """EGL without any driver, as on a machine without Mesa."""
    blind = {**os.environ, "PYOPENGL_PLATFORM": "egl", "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    rows = tmp_path / "rows.json"
    done = subprocess.run(
        [sys.executable, "-m", "poseviewer.cli.main", "bench", "--quick", "--json", str(rows)],
        env=blind,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Path a is left out" in done.stdout
    assert {row["path"] for row in json.loads(rows.read_bytes())["rows"]} == {"d", "e"}
