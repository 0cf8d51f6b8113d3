"""The benchmark runs every path for real, and says of each what it says it does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from poseviewer import cli
from poseviewer.evaluation.bench import report as reports
from poseviewer.evaluation.bench.case import Case, load_demo, make_case
from poseviewer.evaluation.bench.models import in_triangles
from poseviewer.evaluation.bench.paths import make_paths
from poseviewer.evaluation.bench.picture import make_sheet
from poseviewer.evaluation.bench.run import Plan, Report, run_bench
from poseviewer.evaluation.bench.scaling import COVERED, PHOTO, TRIANGLES, ScalingPlan
from poseviewer.evaluation.bench.searches import time_maps
from poseviewer.evaluation.bench.spread import Spread
from poseviewer.evaluation.bench.timing import Row
from poseviewer.figures.bench_sheet import make_bench_sheet
from poseviewer.figures.save import save_figure
from poseviewer.fit.pose_fit import pose_loss
from tests.opengl import require_opengl

STAGES = {
    "a": {"render", "moments", "loss", "total", "evaluation", "search"},
    "b": {"render", "moments", "loss", "total", "evaluation", "search"},
    "c": {"render", "moments", "loss", "total", "evaluation", "search"},
    "d": {"rasterise", "moments", "loss", "total", "evaluation", "search"},
    "e": {"rasterise", "moments and loss", "total", "evaluation", "search"},
}
TINY_SCALING = ScalingPlan(
    triangles=(5_000, 100_000),
    covered_px=(500, 2_000),
    sizes=((160, 120), (320, 240)),
    usual_triangles=5_000,
    usual_covered_px=2_000,
    usual_size=(160, 120),
    large_size=(160, 120),
    rounds=1,
)
TINY = Plan(
    triangles=(5_000,),
    sizes=((160, 120), (200, 100)),
    rounds=2,
    fit_limit_s=0.2,
    plain_fit_limit_s=0.2,
    map_size=3,
    scaling=TINY_SCALING,
)
ROW = {
    "type": "object",
    "properties": {
        "path": {"enum": list("abcde")},
        "stage": {"type": "string"},
        **{k: {"type": "integer", "minimum": 1} for k in ("triangles", "width", "height")},
        **{k: {"type": "integer", "minimum": 1} for k in ("threads", "runs", "faces")},
        **{k: {"type": "number", "minimum": 0} for k in ("ms_median", "ms_min", "ms_max")},
        "covered_px": {"type": "integer", "minimum": 1},
    },
    "required": [field.name for field in fields(Row)],
}
SCHEMA = {
    "type": "object",
    "properties": {
        "machine": {"type": "object", "required": ["cpu", "cores", "system", "load"]},
        "versions": {
            "type": "object",
            "required": ["python", "poseviewer", "numpy", "numba", "opengl"],
        },
        "rows": {"type": "array", "minItems": 1, "items": ROW},
        "scaling": {"type": "array", "items": {**ROW, "required": [*ROW["required"], "x"]}},
        "paper": {"type": "object", "required": ["source", "render_ms", "loss_ms"]},
    },
    "required": ["machine", "versions", "rows", "fits", "maps", "scaling", "paper", "notes"],
}


@pytest.fixture(scope="module")
def demo():
    return load_demo()


@pytest.fixture(scope="module")
def case(demo) -> Case:
    return make_case(demo, 5_000, 320, 240)


@pytest.fixture(scope="module")
def told() -> list[str]:
    return []


@pytest.fixture(scope="module")
def report(told) -> Report:
    require_opengl()
    return run_bench(TINY, told.append)


def test_every_path_has_all_its_stages_in_every_case(report):
    assert report.notes == ()
    for width, height in TINY.sizes:
        rows = [r for r in report.rows if (r.width, r.height) == (width, height)]
        found = {letter: {r.stage for r in rows if r.path == letter} for letter in STAGES}
        assert found == STAGES
        assert len(rows) == sum(map(len, STAGES.values()))  # each once
    for row in report.rows:
        assert 0.0 <= row.ms_min <= row.ms_median <= row.ms_max
        assert row.threads == (report.machine["cores"] if row.path == "e" else 1)
        assert row.runs >= TINY.rounds
        share = row.covered_px / (row.width * row.height)
        assert share == pytest.approx(48_600 / (640 * 480), rel=0.05)


def test_stages_add_up_to_the_total(case):
    for letter in ("c", "d"):
        (path,) = make_paths(case, letter, 1)
        stages = path.run(0)
        parts = sum(s for name, s in stages.items() if name in ("render", "moments", "loss"))
        parts += stages.get("rasterise", 0.0)
        # More only where rasterising alone took longer than rasterising and summing.
        assert parts >= 0.999 * stages["total"]


def test_the_json_is_as_described(report):
    data = json.loads(reports.as_json_bytes(report))
    jsonschema.validate(data, SCHEMA)
    assert len(data["rows"]) == len(report.rows)
    assert data["paper"]["render_ms"] == 170.0


def test_searches_and_maps_are_real_ones(report):
    assert [fit.path for fit in report.fits] == ["d", "a"]
    for fit in report.fits:
        assert fit.cut_short
        assert fit.evaluations >= 1
    first, whole = report.maps
    assert (first.maps, first.size, first.evaluations) == (15, 9, 15 * 81)
    assert (whole.maps, whole.size, whole.evaluations) == (15, TINY.map_size, 15 * 9)


def test_maps_cut_short_say_so(case):
    maps = time_maps(case, 2, 41, limit_s=0.0)
    assert 0 < maps.evaluations < maps.wanted == 15 * 41 * 41


def test_the_scaling_varies_one_thing_at_a_time(report):
    plan = TINY_SCALING
    for series, count in (
        (TRIANGLES, len(plan.triangles)),
        (COVERED, len(plan.covered_px)),
        (PHOTO, len(plan.sizes)),
    ):
        points = [p for p in report.scaling if (p.series, p.row.stage) == (series, "total")]
        assert {p.row.path for p in points} == set(plan.letters)
        fused = [p for p in points if p.row.path == "d"]
        assert len(fused) == count
        x = np.array([p.x for p in fused])
        assert (np.diff(x) > 0).all()
        if series != COVERED:
            covered = [p.row.covered_px for p in fused]
            assert covered == pytest.approx([plan.usual_covered_px] * count, rel=0.05)
        if series != TRIANGLES:
            assert len({p.row.faces for p in fused}) == 1


def test_the_table_names_all_paths_and_the_paper(report):
    for markdown in (False, True):
        text = reports.as_text(report, markdown)
        for words in ("pyrender", "fused, all cores", "machine of 2010", "numba", "cut at 0 s"):
            assert words in text, words
    assert "| a  plain" in reports.as_text(report, markdown=True)


def test_the_plot_shows_all_paths_and_series(report, tmp_path):
    sheet = make_sheet(report)
    assert len(sheet.bars) == len(STAGES) + 1
    assert [len(panel.curves) for panel in sheet.panels] == [4, 4, 2]
    figure = make_bench_sheet(sheet)
    assert len(figure.axes) == 1 + 3
    save_figure(tmp_path / "bench.png", figure)
    assert (tmp_path / "bench.png").stat().st_size > 10_000


def test_all_paths_find_the_same_losses(case):
    """What is timed is the same thing on each: the plain one rounds attributes to 8 bits."""
    require_opengl()
    for path in make_paths(case, "abc", 1):
        renderer = path.renderer  # pyright: ignore[reportAttributeAccessIssue]
        tolerance = 0.01 if path.letter == "a" else 1e-3
        for problem in (case.paper, case.usual):
            for numbers in case.numbers:
                fused = pose_loss(problem, case.renderer, numbers)
                assert pose_loss(problem, renderer, numbers) == pytest.approx(fused, abs=tolerance)
        path.close()


def test_the_plain_path_sees_the_same_model(case):
    require_opengl()
    from poseviewer.evaluation.bench.plain import PlainRenderer

    renderer = PlainRenderer(case.mesh)
    for pose in case.poses[:3]:
        plain, exact = renderer.render(pose), case.renderer.render(pose)
        both = plain.mask & exact.mask
        assert both.sum() > 0.99 * (plain.mask | exact.mask).sum()
        assert np.median(np.abs(plain.normals - exact.normals)[both]) < 0.05
        grey = exact.reflectance @ np.array([0.299, 0.587, 0.114], np.float32)
        assert np.median(np.abs(plain.reflectance[..., 0] - grey)[both]) < 0.01
    renderer.close()


def test_spread_work_keeps_its_order_and_its_renderers_apart(case):
    taken: list[int] = []

    def task(renderer, item):
        assert id(renderer) not in taken, "a renderer for two at once"
        taken.append(id(renderer))
        covered = int(renderer.covers(case.poses[item % 8]).sum())
        taken.remove(id(renderer))
        return item, covered

    with Spread(case.renderer, 3) as spread:
        found = spread.map(task, range(40))
    assert found == [(i, int(case.renderer.covers(case.poses[i % 8]).sum())) for i in range(40)]


@pytest.mark.parametrize("triangles", [1_000, 20_000, 200_000])
def test_models_have_about_the_triangles_wanted(demo, triangles):
    mesh = in_triangles(demo.registration.mesh, triangles)
    assert len(mesh.faces) == pytest.approx(triangles, rel=0.1)
    assert mesh.bounds == pytest.approx(demo.registration.mesh.bounds, abs=0.1)
    assert np.ptp(mesh.colours, axis=0).min() > 0.1


@pytest.mark.parametrize(
    ("option", "name", "words"),
    [
        ("--json", "no/such/rows.json", "no folder"),
        ("--json", ".", "is a folder"),
        ("--plot", "no/such/bench.png", "no folder"),
        ("--plot", "bench.gif", "use .png"),
    ],
)
def test_files_that_cannot_be_written_are_said_before_the_work(
    option, name, words, tmp_path, capsys
):
    assert cli.main(["bench", "--quick", option, str(tmp_path / name)]) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert printed.err.count("\n") == 1  # nothing about the work
    assert printed.out == ""


def test_without_opengl_its_paths_are_left_out(tmp_path):
    """EGL without any driver, which is what a machine without Mesa has."""
    blind = {**os.environ, "PYOPENGL_PLATFORM": "egl", "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    code = (
        "from poseviewer.evaluation.bench.run import Plan, run_bench\n"
        "from poseviewer.evaluation.bench.report import as_text\n"
        "plan = Plan((5000,), ((160, 120),), 1, fit_limit_s=0.1, map_size=3, scaling=None)\n"
        "print(as_text(run_bench(plan, lambda line: None)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=blind,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Paths a and b are left out" in done.stdout
    assert "OpenGL: none" in done.stdout
    assert "software, fused, one thread" in done.stdout
    assert "our OpenGL renderer" not in done.stdout
