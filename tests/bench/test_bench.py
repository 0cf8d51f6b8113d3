"""The benchmark runs every path for real, and says of each what it says it does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from poseviewer.bench import paths
from poseviewer.bench import report as reports
from poseviewer.bench.paths import StageTime, make_path
from poseviewer.bench.run import (
    COVERED,
    PHOTO,
    TRIANGLES,
    BenchOptions,
    BenchReport,
    ScalingOptions,
    run_bench,
)
from poseviewer.bench.searches import time_first_maps, time_fit, time_maps
from poseviewer.bench.workload import Workload, in_triangles, load_demo, make_model, make_workload
from poseviewer.cli import main as cli
from poseviewer.figures.bench_sheet import make_bench_sheet
from poseviewer.figures.save import save_figure
from poseviewer.fit.landscape import QUICK_PIXELS, quick_level
from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.problem import pose_loss
from poseviewer.render.gpu.device import gpu_adapter_name, gpu_device
from poseviewer.render.moments import moments_of_images
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.render.types import AttributeImage
from tests.gpu import require_gpu
from tests.opengl import require_opengl

STAGES = {
    "a": {"render", "moments", "loss", "total", "evaluation", "search"},
    "b": {"render", "moments", "loss", "total", "evaluation", "search"},
    "c": {"render", "moments", "loss", "total", "evaluation", "search"},
    "d": {"rasterise", "moments", "loss", "total", "evaluation", "search"},
    "e": {"rasterise", "moments and loss", "total", "evaluation", "search"},
}
TINY_SCALING = ScalingOptions(
    triangles=(5_000, 100_000),
    covered_px=(500, 2_000),
    sizes=((160, 120), (320, 240)),
    usual_triangles=5_000,
    usual_covered_px=2_000,
    usual_size=(160, 120),
    large_size=(160, 120),
    rounds=1,
)
MAP_SIZE = 3
TINY = BenchOptions(
    triangles=(5_000,),
    sizes=((160, 120), (200, 100)),
    rounds=2,
    fit_limit_s=0.2,
    plain_fit_limit_s=0.2,
    map_size=MAP_SIZE,
    scaling=TINY_SCALING,
)
ROW = {
    "type": "object",
    "properties": {
        "path": {"enum": list("abcdef")},
        "stage": {"type": "string"},
        **{k: {"type": "integer", "minimum": 1} for k in ("triangles", "width", "height")},
        **{k: {"type": "integer", "minimum": 1} for k in ("threads", "runs", "faces")},
        **{k: {"type": "number", "minimum": 0} for k in ("ms_median", "ms_min", "ms_max")},
        "covered_px": {"type": "integer", "minimum": 1},
    },
    "required": [field.name for field in fields(StageTime)],
}
SCHEMA = {
    "type": "object",
    "properties": {
        "machine": {"type": "object", "required": ["cpu", "cores", "system", "load"]},
        "versions": {
            "type": "object",
            "required": ["python", "poseviewer", "numpy", "numba", "opengl", "gpu"],
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
def work(demo) -> Workload:
    return make_workload(demo, make_model(demo, 5_000), (320, 240))


@pytest.fixture(scope="module")
def report() -> BenchReport:
    require_opengl()
    return run_bench(TINY, lambda _: None)


@pytest.mark.slow
def test_every_path_has_all_its_stages_in_every_workload(report):
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


def test_stages_add_up_to_the_total(work):
    for letter in ("c", "d"):
        path = make_path(work, letter, 1)
        stages = path.run(0)
        parts = sum(s for name, s in stages.items() if name in ("render", "moments", "loss"))
        parts += stages.get("rasterise", 0.0)
        # More only where rasterising alone took longer than rasterising and summing.
        assert parts >= 0.999 * stages["total"]


@pytest.mark.slow
def test_the_json_is_as_described(report):
    data = json.loads(reports.as_json_bytes(report))
    jsonschema.validate(data, SCHEMA)
    assert len(data["rows"]) == len(report.rows)
    assert data["paper"]["render_ms"] == 170.0


@pytest.mark.slow
def test_searches_and_maps_are_real_ones(report):
    assert [fit.method for fit in report.fits] == [
        "lit",
        "lit",
        "lit",
        "default",
        "default",
        "paper",
    ]
    assert [fit.free_focal for fit in report.fits] == [False, False, False, False, True, False]
    assert [fit.path for fit in report.fits[:3]] == ["d", "e", "a"]
    assert report.fits[3].factor == report.fits[4].factor > report.fits[5].factor == 1
    for fit in report.fits:
        assert fit.cut_short
        assert fit.evaluations >= 1
    first, whole, _ = report.maps
    for maps, size in ((first, 9), (whole, MAP_SIZE)):
        assert (maps.maps, maps.size, maps.points) == (15, size, 15 * size * size)
        # Maps cross on the axes of six numbers, and all in the centre.
        assert maps.evaluations == 15 * (size - 1) ** 2 + 6 * (size - 1) + 1
        assert not maps.cut_short


@pytest.mark.slow
def test_maps_by_a_lighter_model_say_how_good_they_are(work):
    maps = time_maps(work, 2, 41, light=True)
    assert maps.error is not None
    assert 0.0 < maps.error < 0.2
    assert maps.evaluations < maps.points == maps.wanted
    assert f"good to {maps.error:.1%}" in maps.end


def test_maps_cut_short_say_so(work):
    maps = time_maps(work, 2, 41, limit_s=0.0)
    assert 0 < maps.points < maps.wanted == 15 * 41 * 41
    assert maps.evaluations > 0
    assert "cut short by the limit of 0 s" in maps.end


def test_the_first_maps_are_those_of_the_app(work):
    """At the level that the app takes, and with the numbers that it shows."""
    level = quick_level(work.usual, work.poses[0], work.model.renderer)
    maps = time_first_maps(work, 2)
    assert maps.factor == level.factor > 1
    assert work.covered_px / level.factor**2 >= QUICK_PIXELS > work.covered_px / level.factor**2 / 4


@pytest.mark.slow
def test_a_search_on_the_plain_path_is_pyrenders_alone(demo, monkeypatch):
    """Also on its coarse level: the software renderer draws and sums nothing of it."""
    require_opengl()

    def used(*_):
        raise AssertionError("the fused kernel, in a search on the plain path")

    for name in ("moments", "render", "covers"):
        monkeypatch.setattr(SoftwareRenderer, name, used)
    fit = time_fit(demo, "a", limit_s=1.0)
    assert fit.factor > 1
    assert 1 <= fit.coarse_evaluations <= fit.evaluations
    assert fit.cut_short
    assert fit.end.startswith("cut short by the limit of 1 s")


def test_the_plain_path_simplifies_its_model_as_the_fused_one_does(work):
    require_opengl()
    from poseviewer.bench.plain import PlainRenderer

    renderer = PlainRenderer(work.model.mesh)
    smaller = renderer.reduced(2_048)
    assert renderer.reduced(2_048) is smaller
    assert renderer.reduced(len(work.model.mesh.faces)) is renderer
    pose = work.poses[0]
    whole, coarse = renderer.covers(pose), smaller.covers(pose)
    fused = SoftwareRenderer(simplify(work.model.mesh, 2_048)).covers(pose)
    assert (coarse ^ fused).sum() < 0.01 * fused.sum() < (whole ^ coarse).sum()
    renderer.close()


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_table_names_all_paths_and_the_paper(report):
    for markdown in (False, True):
        text = reports.as_text(report, markdown)
        for words in (
            "pyrender",
            "fused, all cores",
            "machine of 2010",
            "numba",
            "cut short by the limit of 0.2 s",
        ):
            assert words in text, words
    assert "| a  plain" in reports.as_text(report, markdown=True)


@pytest.mark.slow
def test_the_plot_shows_all_paths_and_series(report, tmp_path):
    sheet = reports.make_sheet(report)
    assert len(sheet.bars) == len(STAGES) + 1
    assert [len(panel.curves) for panel in sheet.panels] == [4, 4, 2]
    figure = make_bench_sheet(sheet)
    assert len(figure.axes) == 1 + 3
    save_figure(tmp_path / "bench.png", figure)
    assert (tmp_path / "bench.png").stat().st_size > 10_000


@pytest.mark.parametrize("letter", ["a", "b", "c"])
def test_all_paths_find_the_same_losses(work, letter):
    """What is timed is the same thing on each, but for what the path cannot help; see ``alike``."""
    require_opengl()
    path = make_path(work, letter, 1)
    renderer = path.renderer
    for problem in (work.paper, work.usual):
        for parameters, pose in zip(work.parameters, work.poses, strict=True):
            found = pose_loss(problem, renderer, parameters)
            assert found == pytest.approx(
                pose_loss(problem, work.model.renderer, parameters), abs=0.02
            )
            image = alike(letter, work.model.renderer.render(pose), renderer.render(pose))
            expected = lighting_loss(moments_of_images(image, problem.photo))
            tolerance = 0.007 if letter == "a" else 1e-4
            assert found == pytest.approx(expected, abs=tolerance)
    path.close()


@pytest.mark.slow
def test_the_gpus_path_is_timed_in_batches_and_marked(demo, monkeypatch):
    require_gpu(monkeypatch)
    monkeypatch.setattr(paths, "BATCHES", (1, 2, 5))
    monkeypatch.setattr(reports, "BATCHES", (1, 2, 5))
    small = make_workload(demo, make_model(demo, 2_000), (160, 120))
    rows = paths.measure(small, "df", 1, rounds=1)
    stages = {"batch of 1", "batch of 2", "total", "evaluation", "search"}
    if not gpu_device().is_software:
        stages.add("batch of 5")
    assert {row.stage for row in rows if row.path == "f"} == stages
    versions = {"gpu": gpu_adapter_name(), "opengl": None}
    machine = {"cpu": "", "cores": 1, "load": None}
    text = reports.as_text(BenchReport(machine, versions, tuple(rows), (), (), (), ()))
    assert "batch of 2" in text
    assert str(versions["gpu"]) in text
    path = make_path(small, "f", 1)
    for problem in (small.paper, small.usual):
        losses = [pose_loss(problem, path.renderer, at) for at in small.parameters[:3]]
        software = [pose_loss(problem, small.model.renderer, at) for at in small.parameters[:3]]
        assert losses == pytest.approx(software, abs=1e-4)


def alike(letter: str, exact: AttributeImage, found: AttributeImage) -> AttributeImage:
    """The exact picture, with what path a or b shows otherwise by its nature.

    Path a, besides rounding to 8 bits, blends normals without bringing them to unit length, and
    leaves them on the front's side. In path b another of two faces in one place may be seen.
    """
    if letter == "a":
        length = np.sum(found.normals * exact.normals, axis=-1, keepdims=True)
        assert (length[exact.mask] < 0.0).mean() < 0.02
        return replace(exact, normals=exact.normals * length)
    other = (found.face_ids != exact.face_ids)[..., None]
    assert other.mean() < 1e-3
    return AttributeImage(
        found.face_ids,
        np.where(other, found.reflectance, exact.reflectance),
        np.where(other, found.normals, exact.normals),
    )


def test_the_plain_path_sees_the_same_model(work):
    require_opengl()
    from poseviewer.bench.plain import PlainRenderer

    renderer = PlainRenderer(work.model.mesh)
    for pose in work.poses[:3]:
        plain, exact = renderer.render(pose), work.model.renderer.render(pose)
        both = plain.mask & exact.mask
        assert both.sum() > 0.99 * (plain.mask | exact.mask).sum()
        assert np.median(np.abs(plain.normals - exact.normals)[both]) < 0.05
        grey = exact.reflectance @ np.array([0.299, 0.587, 0.114], np.float32)
        assert np.median(np.abs(plain.reflectance[..., 0] - grey)[both]) < 0.01
    renderer.close()


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


@pytest.mark.slow
def test_what_is_left_out_is_said_without_opengl_and_beyond_the_limit(tmp_path):
    """EGL without any driver, which is what a machine without Mesa has."""
    blind = {**os.environ, "PYOPENGL_PLATFORM": "egl", "__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    code = (
        "from poseviewer.bench.run import BenchOptions, run_bench\n"
        "from poseviewer.bench.report import as_text\n"
        "options = BenchOptions((5000,), ((160, 120), (200, 100)), 1,\n"
        "    fit_limit_s=0.1, map_size=None, limit_s=1e-9)\n"
        "print(as_text(run_bench(options, lambda line: None)))"
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
    for words in (
        "Paths a and b are left out",
        "OpenGL: none",
        "software, fused, one thread",
        "5,000 triangles, 160x120",  # one workload is measured in any case
        "5,000 triangles, 200x100 is left out",
        "20 of 20 points of the scaling are left out",
    ):
        assert words in done.stdout, words
    assert "our OpenGL renderer" not in done.stdout
