"""Speed of this machine: evaluations on each path, a fit by each method, fifteen maps.

The paths from a pose to its loss are a: pyrender's picture, read back and summed by NumPy, as the
paper did it; d: the software renderer, which draws and sums in one kernel, on one thread; e: the
same on all cores; f: the GPU, many poses in one submission.
"""

from __future__ import annotations

import json
import os
import platform
from collections import defaultdict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from poseviewer.errors import RendererUnavailableError
from poseviewer.figures.text_table import Table
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.landscape import landscape
from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.problem import make_problem
from poseviewer.fit.registration import Registration
from poseviewer.fit.search import until_focal_settles
from poseviewer.fit.settings import METHODS, FitSettings, Limits, Method
from poseviewer.fit.stages import make_stages
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.photo import GREY_WEIGHTS
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.moments import moments_of_images
from poseviewer.render.opengl import opengl_renderer_name
from poseviewer.render.pool import CHUNK, RendererPool, processors
from poseviewer.render.pyramid.simplified import simplify
from poseviewer.render.renderers import make_renderer
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.render.types import PhotoAttributes, Renderer
from poseviewer.starts.registration import load_registration

Seconds = dict[str, float]
"""The time of each stage of a path."""
PACKAGES = ("poseviewer", "numpy", "numba", "scipy", "pyrender")
PATHS = {
    "a": "pyrender, read back, NumPy",
    "d": "software, one thread",
    "e": "software, all cores",
    "f": "GPU, many poses at once",
}
STAGES = ("draw", "sum", "loss", "total")
POSES = 8
JITTER = 0.01
"""Greatest distance of a measured pose from the true one, as a share of each parameter's scale."""
BURST = 4
"""Counted runs of a path before the next path's turn."""
GPU_POSES = 512
"""Poses of one submission to a GPU."""
TRIANGLES, WIDTH_PX, MAP_SIZE = 50_000, 640, 41
PAPER = {
    "source": "Jayawardena, Hutter and Brewer, measured on their machine of 2010 (C and OpenGL)",
    "render_ms": 170.0,
    "loss_ms": 40.0,
    "pose": "about a minute",
}


@dataclass(frozen=True, slots=True, eq=False)
class Workload:
    """The demo's model in some number of triangles, poses about the true one, and the photo."""

    triangles: int
    renderer: SoftwareRenderer
    poses: tuple[Pose, ...]
    photo: PhotoAttributes
    """Grey, clipped to the model: what the paper compares."""
    covered_px: int
    """At the true pose."""


@dataclass(frozen=True, slots=True)
class StageTime:
    """The time of one stage of one path, ms."""

    path: str
    """A letter of ``PATHS``."""
    triangles: int
    """As asked for."""
    width: int
    height: int
    threads: int
    stage: str
    ms_median: float
    ms_min: float
    ms_max: float
    runs: int
    faces: int
    """Triangles that the model really has."""
    covered_px: int
    """Pixels of the photo that show the model at its true pose."""


@dataclass(frozen=True, slots=True)
class SpeedReport:
    """All that one run measured."""

    machine: dict[str, str | int | float | None]
    """Processor, cores, system, and mean load over the minute before."""
    versions: dict[str, str | None]
    """Versions of Python and packages; the adapters ``opengl`` and ``gpu``, None where there are
    none."""
    rows: tuple[StageTime, ...]
    fits: tuple[dict[str, Any], ...]
    maps: tuple[dict[str, Any], ...]
    notes: tuple[str, ...]
    """What could not be measured, in sentences."""

    def as_json_bytes(self) -> bytes:
        """Encode all of it as a JSON file."""
        return (json.dumps({**asdict(self), "paper": PAPER}, indent=1) + "\n").encode()

    def as_markdown(self) -> str:
        """Machine, versions and tables."""
        adapters = {"opengl": "OpenGL", "gpu": "GPU"}
        load = self.machine["load"]
        busy = "" if load is None else f", load {load:.1f} at the start"
        drawn_by = "; ".join(f"{n}: {self.versions[k] or 'none'}" for k, n in adapters.items())
        packages = ", ".join(f"{k} {v}" for k, v in self.versions.items() if k not in adapters)
        header = f"{self.machine['cpu']}, {self.machine['cores']} cores{busy}; {drawn_by}."
        tables = (table.as_markdown() for table in (path_table(self.rows), self._whole_table()))
        return "\n\n".join([f"{header}\n{packages}.", *tables, *self.notes])

    def _whole_table(self) -> Table:
        rows = [
            (
                f"fit of the demo, --method {fit['method']}, {_cores(fit['threads'])}",
                f"{fit['seconds']:.3g}",
                f"{fit['evaluations']:,} evaluations, {fit['end']}",
            )
            for fit in self.fits
        ]
        for maps in self.maps:
            name = f"{maps['maps']} maps of {maps['size']}x{maps['size']}"
            name = f"{name}, {_cores(maps['threads'])}"
            good = "" if maps["error"] is None else f", good to {maps['error']:.1%} of their range"
            rows.append((name, f"{maps['seconds']:.3g}", f"{maps['points']:,} points{good}"))
        return Table("Searches and maps", ("what", "seconds", "end"), tuple(rows))


def path_table(times: Sequence[StageTime]) -> Table:
    """Tabulate a row for each path of one workload, and one for the paper's own figures."""
    rows, plain = [], 0.0
    for letter in dict.fromkeys(row.path for row in times):
        of = {row.stage: row for row in times if row.path == letter}
        total = of["total"]
        plain = total.ms_median if letter == "a" else plain
        rows.append((
            f"{letter}  {PATHS[letter]}",
            *(f"{of[stage].ms_median:.3g}" if stage in of else "" for stage in STAGES),
            f"{total.ms_min:.3g} to {total.ms_max:.3g}",
            f"{plain / total.ms_median:.1f}" if plain else "-",
        ))  # fmt: skip
    render, loss, one = PAPER["render_ms"], PAPER["loss_ms"], times[0]
    paper = f"{render:.0f}", "", f"{loss:.0f}", f"{render + loss:.0f}", "-", "-"
    rows.append(("the paper's own, on its machine of 2010", *paper))
    return Table(
        f"One evaluation, ms: {one.triangles:,} triangles, {one.width}x{one.height}, "
        f"{one.covered_px:,} covered pixels; medians",
        ("path", *STAGES, "least to most", "a / this"),
        tuple(rows),
    )


def _cores(count: int) -> str:
    return "1 core" if count == 1 else f"{count} cores"


def demo_with_truth() -> tuple[Registration, Pose]:
    """Load the bundled demo, and its true pose."""
    files = demo_case()
    registration = load_registration(files.photo, files.model, files.start)
    photo = registration.photo
    return registration, load_pose(files.truth, photo.width, photo.height).pose


def measure_speed(
    quick: bool, tell: Callable[[str], None], map_size: int = MAP_SIZE
) -> SpeedReport:
    """Measure; ``tell`` hears, before each part, what comes. ``quick``: fewer runs, and fits are
    cut short.
    """
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    machine = {"cpu": _cpu(), "cores": processors(), "system": platform.system(), "load": load}
    versions: dict[str, str | None] = {"python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES}
    versions |= {"opengl": opengl_renderer_name(), "gpu": _gpu_name()}
    letters = "a" * bool(versions["opengl"]) + "de" + "f" * bool(versions["gpu"])
    demo, truth = demo_with_truth()
    tell(f"timing the paths: {TRIANGLES:,} triangles, {WIDTH_PX} px")
    work = make_workload(demo, truth, TRIANGLES, WIDTH_PX)
    rows = time_paths(work, letters, 4 if quick else 12)
    tell(f"making maps of {map_size}x{map_size}")
    maps, fits = time_maps(demo, truth, map_size), []
    for method in METHODS:
        limit_s = 3.0 if quick else 30.0
        tell(f"fitting by --method {method}, for {limit_s:.0f} s at most")
        fits.append(time_fit(demo, truth, method, limit_s))
    notes = () if versions["opengl"] else ("Path a is left out: there is no OpenGL here.",)
    return SpeedReport(machine, versions, tuple(rows), tuple(fits), (maps,), notes)


def _cpu() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _gpu_name() -> str | None:
    from poseviewer.render.gpu.device import gpu_device

    with suppress(RendererUnavailableError):
        return gpu_device().name
    return None


def make_workload(demo: Registration, truth: Pose, triangles: int, width: int) -> Workload:
    """Simplify the demo's model to about ``triangles``, and its photo to a width."""
    renderer = SoftwareRenderer(simplify(demo.mesh, triangles))
    truth = truth.scaled(width / demo.photo.width)
    width, height = truth.camera.width, truth.camera.height
    grey = demo.photo.as_rgb8(width, height) @ (GREY_WEIGHTS / 255.0)
    channels = grey[..., None].astype(np.float32)
    chart = FreeBodyChart.near(renderer.mesh, truth)
    middle = chart.from_pose(truth)
    offsets = np.random.default_rng(0).uniform(-JITTER, JITTER, (POSES, len(middle)))
    poses = tuple(chart.to_pose(middle + offset * chart.scales(middle)) for offset in offsets)
    compared = PhotoAttributes(channels, np.ones((height, width), np.float32))
    return Workload(triangles, renderer, poses, compared, int(renderer.covers(truth).sum()))


def time_paths(work: Workload, letters: str, rounds: int) -> list[StageTime]:
    """The times of the stages of some paths, taken in turn: what disturbs the machine hits all.

    Each turn begins with a run that does not count: it brings back into the processor's caches what
    other paths have pushed out.
    """
    samples: dict[tuple[str, int, str], list[float]] = defaultdict(list)
    with RendererPool(work.renderer) as pool:
        paths = [(letter, *_make_path(work, letter, pool)) for letter in letters]
        for turn in range(rounds):
            for letter, threads, run in paths:
                for k in range(BURST + 1):
                    for stage, seconds in run(turn * BURST + k).items():
                        if k:
                            samples[letter, threads, stage].append(1e3 * seconds)
    height, width = work.photo.weights.shape
    return [
        StageTime(
            path=letter,
            triangles=work.triangles,
            width=width,
            height=height,
            threads=threads,
            stage=stage,
            ms_median=float(np.median(times)),
            ms_min=min(times),
            ms_max=max(times),
            runs=len(times),
            faces=len(work.renderer.mesh.faces),
            covered_px=work.covered_px,
        )
        for (letter, threads, stage), times in samples.items()
    ]


def _make_path(
    work: Workload, letter: str, pool: RendererPool
) -> tuple[int, Callable[[int], Seconds]]:
    """Number of threads, and what goes the path at the workload's pose of a number."""
    mesh = work.renderer.mesh
    if letter == "a":
        return 1, partial(_by_pictures, work, make_renderer(mesh, "opengl"))
    if letter == "d":
        return 1, partial(_fused, work)
    if letter == "e":
        return pool.threads, partial(_together, work, pool, CHUNK * pool.threads)
    from poseviewer.render.gpu.renderer import GpuRenderer

    renderer = GpuRenderer(mesh)
    count = 1 if renderer.device.is_software else GPU_POSES
    return 1, partial(_together, work, RendererPool(renderer), count)


def _by_pictures(work: Workload, renderer: Renderer, k: int) -> Seconds:
    began = perf_counter()
    image = renderer.render(work.poses[k % POSES])
    drawn = perf_counter()
    moments = moments_of_images(image, work.photo)
    summed = perf_counter()
    lighting_loss(moments)
    end = perf_counter()
    stages = {"draw": drawn - began, "sum": summed - drawn, "loss": end - summed}
    return stages | {"total": end - began}


def _fused(work: Workload, k: int) -> Seconds:
    """``covers``, at another pose, stands for drawing; the rest is the sum."""
    began = perf_counter()
    moments = work.renderer.moments(work.poses[k % POSES], work.photo)
    summed = perf_counter()
    lighting_loss(moments)
    end = perf_counter()
    work.renderer.covers(work.poses[(k + 2) % POSES])
    draw = perf_counter() - end
    stages = {"draw": draw, "sum": max(summed - began - draw, 0.0), "loss": end - summed}
    return stages | {"total": end - began}


def _together(work: Workload, pool: RendererPool, count: int, k: int) -> Seconds:
    """Seconds for one of ``count`` poses, from pose to loss."""
    poses = [work.poses[(k + i) % POSES] for i in range(count)]
    began = perf_counter()
    list(pool.map(lambda one, pose: lighting_loss(one.moments(pose, work.photo)), poses))
    return {"total": (perf_counter() - began) / count}


def time_fit(demo: Registration, truth: Pose, method: Method, limit_s: float) -> dict[str, Any]:
    """Time what ``fit --method`` does from the demo's start, 8 % off in each parameter, without the
    verdict; ``error_percent`` is of the model's size in the photo.
    """
    problem, _ = make_problem(demo, FitSettings(method=method, limits=Limits(seconds=limit_s)))
    renderer, threads = SoftwareRenderer(demo.mesh), 1 if method == "paper" else processors()
    make_stages(problem, renderer)  # simplifies the model, which is then kept
    *_, end = until_focal_settles(problem, renderer, threads)
    error = pose_error(demo.mesh, end.pose, truth).percent
    return {
        "method": method,
        "threads": threads,
        "faces": len(demo.mesh.faces),
        "seconds": end.seconds,
        "evaluations": end.evaluations,
        "loss": end.loss,
        "status": end.status.name,
        "limit_s": limit_s,
        "error_percent": error,
        "end": f"{end.status.name.lower().replace('_', ' ')}, {error:.2f} % off",
    }


def time_maps(demo: Registration, truth: Pose, size: int) -> dict[str, Any]:
    """Time the maps, of ``size`` points a side, of all pairs of parameters about the demo's true
    pose, on all cores; ``error`` is that of ``Slice``.
    """
    problem, _ = make_problem(replace(demo, start=truth), FitSettings())
    with RendererPool(SoftwareRenderer(demo.mesh)) as pool:
        # A thread's first picture of a size takes its buffers.
        pool.moments_of([truth] * (2 * CHUNK * pool.threads), problem.photo)
        began = perf_counter()
        pieces = list(landscape(problem, pool, problem.start, size=size, smooth=True))
        seconds = perf_counter() - began
    known = {(piece.first, piece.second): piece.losses.size for piece in pieces}
    return {
        "maps": len(known),
        "size": size,
        "threads": pool.threads,
        "seconds": seconds,
        "points": sum(known.values()),
        "error": pieces[-1].error,
    }
