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
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import numpy as np

from poseviewer.errors import RendererUnavailableError
from poseviewer.figures.text_table import Table
from poseviewer.files.demo import demo_case
from poseviewer.files.pose import load_pose
from poseviewer.fit.landscape import Slice, landscape
from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.problem import make_problem
from poseviewer.fit.progress import Status
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

Tell = Callable[[str], None]
Seconds = dict[str, float]
"""The time of each stage of a path."""
PACKAGES = ("poseviewer", "numpy", "numba", "scipy", "pyrender")
PATHS = {
    "a": "pyrender, read back, NumPy",
    "d": "software, one thread",
    "e": "software, all cores",
    "f": "GPU, many poses at once",
}
COLUMNS = {
    "draw": ("render", "rasterise"),
    "sum": ("moments", "moments and loss"),
    "loss": ("loss",),
    "total": ("total",),
}
"""Columns of the table of paths, and the stages that stand in each."""
POSES = 8
JITTER = 0.01
"""Greatest distance of a measured pose from the true one, as a share of each parameter's scale."""
BURST = 4
"""Counted runs of a path before the next path's turn."""
GPU_POSES = 512
"""Poses of one submission to a GPU."""
MAIN_TRIANGLES, FEW_TRIANGLES = 50_000, 5_000
WIDTHS = (640, 960)
"""Widths of the photo, px."""
MAP_SIZE = 41
PAPER = {
    "source": "Jayawardena, Hutter and Brewer, measured on their machine of 2010 (C and OpenGL)",
    "render_ms": 170.0,
    "loss_ms": 40.0,
    "pose": "about a minute",
}


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """The bundled demo with its true pose."""

    registration: Registration
    truth: Pose

    @classmethod
    def load(cls) -> Demo:
        """Read the demo's files."""
        files = demo_case()
        registration = load_registration(files.photo, files.model, files.start)
        photo = registration.photo
        return cls(registration, load_pose(files.truth, photo.width, photo.height).pose)


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
class FitTime:
    """A search from the demo's start, 8 % off in each parameter, without the verdict."""

    method: Method
    threads: int
    seconds: float
    evaluations: int
    faces: int
    status: str
    loss: float
    error_percent: float
    """Distance of the end from the true pose, as a share of the model's size in the photo."""
    limit_s: float
    cut_short: bool
    """Whether the limit ended it."""
    end: str
    """How it ended, in words."""


@dataclass(frozen=True, slots=True)
class MapsTime:
    """Maps about the demo's true pose, of all pairs of its parameters, as the app makes them."""

    maps: int
    size: int
    """Points a side."""
    threads: int
    seconds: float
    points: int
    error: float | None
    """See ``Slice.error``."""


@dataclass(frozen=True, slots=True)
class SpeedReport:
    """All that one run measured."""

    machine: dict[str, str | int | float | None]
    """Processor, cores, system, and mean load over the minute before."""
    versions: dict[str, str | None]
    """Versions of Python and packages; the adapters ``opengl`` and ``gpu``, None where there are
    none."""
    rows: tuple[StageTime, ...]
    fits: tuple[FitTime, ...]
    maps: tuple[MapsTime, ...]
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
        tables = (table.as_markdown() for table in (*self._path_tables(), self._whole_table()))
        return "\n\n".join([f"{header}\n{packages}.", *tables, *self.notes])

    def _path_tables(self) -> Iterator[Table]:
        columns = ("path", *COLUMNS, "least to most", "a / this")
        for key in dict.fromkeys((r.triangles, r.width, r.height) for r in self.rows):
            same = [row for row in self.rows if (row.triangles, row.width, row.height) == key]
            rows, plain = [], 0.0
            for letter in dict.fromkeys(row.path for row in same):
                of = {row.stage: row for row in same if row.path == letter}
                total = of["total"]
                plain = total.ms_median if letter == "a" else plain
                rows.append((
                    f"{letter}  {PATHS[letter]}",
                    *("".join(f"{of[name].ms_median:.3g}" for name in stages if name in of)
                      for stages in COLUMNS.values()),
                    f"{total.ms_min:.3g} to {total.ms_max:.3g}",
                    f"{plain / total.ms_median:.1f}" if plain else "-",
                ))  # fmt: skip
            render, loss = PAPER["render_ms"], PAPER["loss_ms"]
            paper = f"{render:.0f}", "", f"{loss:.0f}", f"{render + loss:.0f}", "-", "-"
            rows.append(("the paper's own, on its machine of 2010", *paper))
            yield Table(
                f"One evaluation, ms: {key[0]:,} triangles, {key[1]}x{key[2]}, "
                f"{same[0].covered_px:,} covered pixels; medians",
                columns,
                tuple(rows),
            )

    def _whole_table(self) -> Table:
        rows = [
            (
                f"fit of the demo, --method {fit.method}, {_cores(fit.threads)}",
                f"{fit.seconds:.3g}",
                f"{fit.evaluations:,} evaluations, {fit.end}",
            )
            for fit in self.fits
        ]
        for maps in self.maps:
            name = f"{maps.maps} maps of {maps.size}x{maps.size}, {_cores(maps.threads)}"
            good = "" if maps.error is None else f", good to {maps.error:.1%} of their range"
            rows.append((name, f"{maps.seconds:.3g}", f"{maps.points:,} points{good}"))
        return Table("Searches and maps", ("what", "seconds", "end"), tuple(rows))


def _cores(count: int) -> str:
    return "1 core" if count == 1 else f"{count} cores"


def measure_speed(quick: bool, tell: Tell, map_size: int = MAP_SIZE) -> SpeedReport:
    """Measure; ``tell`` hears, before each part, what comes. ``quick``: one workload alone, and
    fits are cut short.
    """
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    machine = {"cpu": _cpu(), "cores": processors(), "system": platform.system(), "load": load}
    versions: dict[str, str | None] = {"python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES}
    versions |= {"opengl": opengl_renderer_name(), "gpu": _gpu_name()}
    letters = "a" * bool(versions["opengl"]) + "de" + "f" * bool(versions["gpu"])
    demo, rows = Demo.load(), []
    for triangles in (MAIN_TRIANGLES,) if quick else (MAIN_TRIANGLES, FEW_TRIANGLES):
        renderer = SoftwareRenderer(simplify(demo.registration.mesh, triangles))
        for width in WIDTHS[:1] if quick else WIDTHS:
            tell(f"timing the paths: {triangles:,} triangles, {width} px")
            work = make_workload(demo, renderer, triangles, width)
            rows += time_paths(work, letters, 4 if quick else 12)
    tell(f"making maps of {map_size}x{map_size}")
    maps = time_maps(demo, map_size)
    fits = []
    for method in METHODS:
        limit_s = 3.0 if quick else 30.0
        tell(f"fitting by --method {method}, for {limit_s:.0f} s at most")
        fits.append(time_fit(demo, method, limit_s))
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


def make_workload(demo: Demo, renderer: SoftwareRenderer, triangles: int, width: int) -> Workload:
    """The ``renderer``'s model, of about ``triangles``, before the demo's photo of that width."""
    photo = demo.registration.photo
    truth = demo.truth.scaled(width / photo.width)
    width, height = truth.camera.width, truth.camera.height
    grey = photo.as_rgb8(width, height) @ (GREY_WEIGHTS / 255.0)
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
    stages = {"render": drawn - began, "moments": summed - drawn, "loss": end - summed}
    return stages | {"total": end - began}


def _fused(work: Workload, k: int) -> Seconds:
    """``covers``, at another pose, stands for rasterising; the rest is moments."""
    began = perf_counter()
    moments = work.renderer.moments(work.poses[k % POSES], work.photo)
    summed = perf_counter()
    lighting_loss(moments)
    end = perf_counter()
    work.renderer.covers(work.poses[(k + 2) % POSES])
    draw = perf_counter() - end
    stages = {"rasterise": draw, "moments": max(summed - began - draw, 0.0), "loss": end - summed}
    return stages | {"total": end - began}


def _together(work: Workload, pool: RendererPool, count: int, k: int) -> Seconds:
    """Seconds for one of ``count`` poses; where each thread has its share, of its parts too."""
    poses = [work.poses[(k + i) % POSES] for i in range(count)]

    def each(task: Callable[[Renderer, Pose], object]) -> float:
        began = perf_counter()
        list(pool.map(task, poses))
        return (perf_counter() - began) / count

    total = each(lambda one, pose: lighting_loss(one.moments(pose, work.photo)))
    if pool.threads == 1:
        return {"total": total}
    draw = each(lambda one, pose: one.covers(pose).size)
    return {"rasterise": draw, "moments and loss": max(total - draw, 0.0), "total": total}


def time_fit(demo: Demo, method: Method, limit_s: float) -> FitTime:
    """Time what ``fit --method`` does on the demo, without the verdict."""
    mesh = demo.registration.mesh
    settings = FitSettings(method=method, limits=Limits(seconds=limit_s))
    problem, _ = make_problem(demo.registration, settings)
    renderer, threads = SoftwareRenderer(mesh), 1 if method == "paper" else processors()
    make_stages(problem, renderer)  # simplifies the model, which is then kept
    *_, end = until_focal_settles(problem, renderer, threads)
    error = pose_error(mesh, end.pose, demo.truth).percent
    cut_short = end.status is Status.SECONDS_SPENT
    how = f"cut short by the limit of {limit_s:g} s" if cut_short else end.status.name.lower()
    return FitTime(
        method=method,
        threads=threads,
        seconds=end.seconds,
        evaluations=end.evaluations,
        faces=len(mesh.faces),
        status=end.status.name,
        loss=end.loss,
        error_percent=error,
        limit_s=limit_s,
        cut_short=cut_short,
        end=f"{how.replace('_', ' ')}, {error:.2f} % off",
    )


def time_maps(demo: Demo, size: int) -> MapsTime:
    """Time the maps of ``size`` points a side about the demo's true pose, on all cores."""
    registration = replace(demo.registration, start=demo.truth)
    problem, _ = make_problem(registration, FitSettings())
    renderer = SoftwareRenderer(registration.mesh)
    known: dict[tuple[int, int], Slice] = {}
    with RendererPool(renderer) as pool:
        # A thread's first picture of a size takes its buffers.
        pool.moments_of([demo.truth] * (2 * CHUNK * pool.threads), problem.photo)
        began = perf_counter()
        for piece in landscape(problem, pool, problem.start, size=size, smooth=True):
            known[piece.first, piece.second] = piece
        seconds = perf_counter() - began
    points, error = sum(piece.losses.size for piece in known.values()), piece.error
    return MapsTime(len(known), size, pool.threads, seconds, points, error)
