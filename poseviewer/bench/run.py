"""One run of the benchmark: every figure in it is from the same machine and the same minutes."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import product
from pathlib import Path
from time import perf_counter

from poseviewer.bench.paths import StageTime, measure
from poseviewer.bench.searches import (
    FitTime,
    MapsTime,
    time_first_maps,
    time_fit,
    time_maps,
    time_method,
)
from poseviewer.bench.workload import (
    Demo,
    Model,
    Size,
    Workload,
    load_demo,
    make_model,
    make_workload,
)
from poseviewer.render.gpu.device import gpu_adapter_name
from poseviewer.render.opengl.context import opengl_renderer_name, opengl_unavailable_reason
from poseviewer.render.pool import processors
from poseviewer.render.software.renderer import SoftwareRenderer

Tell = Callable[[str], None]
PACKAGES = ("poseviewer", "numpy", "numba", "scipy", "pyrender")
MAIN_TRIANGLES, MAIN_SIZE = 50_000, (640, 480)
"""The workload by which paths are compared, and whose maps are made."""
FIT_TIMES = 3
"""How often a fit by the default method is timed, where no limit ends it; the report has the
median."""
TRIANGLES, COVERED, PHOTO = "triangles", "covered pixels", "photo size"
"""What an evaluation's time grows with: the three series of the scaling."""


@dataclass(frozen=True, slots=True)
class ScalingOptions:
    """Where the scaling is measured; what does not vary is as in the main workload."""

    triangles: tuple[int, ...] = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
    covered_px: tuple[int, ...] = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
    sizes: tuple[Size, ...] = (
        *((640, 480), (1280, 960), (2048, 1536)),
        *((2880, 2160), (4032, 3024), (6000, 4000)),
    )
    usual_triangles: int = 50_000
    usual_covered_px: int = 48_600
    usual_size: Size = (640, 480)
    large_size: Size = (2000, 1500)
    """Of the photo in which the covered pixels vary: it must have room for them."""
    letters: str = "ad"
    rounds: int = 8
    rounds_limit_s: float = 6.0
    """Of each point; three rounds are made in any case, unless they take twice as long."""

    @property
    def points(self) -> int:
        """How many there are, of all series."""
        return len(self.triangles) + len(self.covered_px) + len(self.sizes)


@dataclass(frozen=True, slots=True)
class ScalingTime:
    """The time of a stage in one series, at its number ``x`` of triangles, or of pixels."""

    series: str
    x: int
    row: StageTime


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """What to measure, and for how long."""

    triangles: tuple[int, ...] = (5_000, 50_000, 500_000)
    sizes: tuple[Size, ...] = ((640, 480), (1920, 1080))
    rounds: int = 12
    rounds_limit_s: float = 15.0
    """Of each workload; three rounds are made in any case, unless they take twice as long."""
    fit_limit_s: float = 30.0
    plain_fit_limit_s: float = 90.0
    map_size: int | None = 41
    """None: the first sheet is all."""
    exact_maps: bool = True
    """Whether the model draws all of their points, too."""
    maps_limit_s: float = 30.0
    scaling: ScalingOptions | None = field(default_factory=ScalingOptions)
    limit_s: float = 500.0
    """From the run's begin: after half of it no further workload is begun, and after all of it no
    further point of the scaling; the report says what is left out."""


QUICK = BenchOptions(
    triangles=(MAIN_TRIANGLES,),
    sizes=(MAIN_SIZE,),
    rounds=6,
    rounds_limit_s=4.0,
    fit_limit_s=3.0,
    plain_fit_limit_s=2.0,
    exact_maps=False,
    maps_limit_s=12.0,
    scaling=None,
)
"""The main workload alone; searches are cut short where they take longer."""


@dataclass(frozen=True, slots=True)
class BenchReport:
    """All that one run found."""

    machine: dict[str, str | int | float | None]
    """Processor, cores, system, and mean load over the minute before."""
    versions: dict[str, str | None]
    """Of Python and the packages that do the work; ``opengl`` and ``gpu``, the adapter of path f,
    are None where there is none."""
    rows: tuple[StageTime, ...]
    fits: tuple[FitTime, ...]
    maps: tuple[MapsTime, ...]
    scaling: tuple[ScalingTime, ...]
    notes: tuple[str, ...]
    """What could not be measured, in sentences."""


def run_bench(options: BenchOptions, tell: Tell) -> BenchReport:
    """Measure what the options say; ``tell`` hears, before each part, what comes."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    machine = {"cpu": _cpu(), "cores": processors(), "system": platform.system(), "load": load}
    versions: dict[str, str | None] = {"python": platform.python_version()}
    versions |= {name: version(name) for name in PACKAGES} | {"opengl": opengl_renderer_name()}
    versions["gpu"] = gpu = gpu_adapter_name()
    reason = opengl_unavailable_reason()
    notes = [f"Paths a and b are left out: {reason}"] if reason else []
    letters = ("cde" if reason else "abcde") + ("f" if gpu else "")
    began = perf_counter()
    tell("loading the demo")
    demo = load_demo()
    rows, main, left_out = _measure_workloads(demo, options, letters, tell)
    tell("making the first maps")
    maps = [time_first_maps(main, processors(), options.maps_limit_s)]
    if options.map_size:
        tell(f"making maps of {options.map_size}x{options.map_size}")
        maps += [
            time_maps(main, processors(), options.map_size, options.maps_limit_s, light=light)
            for light in ((False, True) if options.exact_maps else (True,))
        ]
    fits = _time_fits(demo, options, letters, tell)
    scaling: list[ScalingTime] = []
    if options.scaling:
        scaling, missing = _measure_scaling(
            demo, options.scaling, letters, tell, began + options.limit_s
        )
        if missing:
            left_out.append(
                f"{missing} of {options.scaling.points} points of the scaling are left out: the "
                f"limit of {options.limit_s:g} s was reached; run again on a machine that is less "
                "busy."
            )
    return BenchReport(
        machine, versions, tuple(rows), tuple(fits), tuple(maps), tuple(scaling),
        (*notes, *left_out),
    )  # fmt: skip


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _measure_workloads(
    demo: Demo, options: BenchOptions, letters: str, tell: Tell
) -> tuple[list[StageTime], Workload, list[str]]:
    """All stages; the main workload, or the first where it is left out; what was left out."""
    rows: list[StageTime] = []
    works: dict[tuple[int, Size], Workload] = {}
    left_out: list[str] = []
    models: dict[int, Model] = {}
    until = perf_counter() + 0.5 * options.limit_s
    for size, triangles in product(options.sizes, options.triangles):
        name = f"{triangles:,} triangles, {size[0]}x{size[1]}"
        if works and perf_counter() > until:
            left_out.append(
                f"{name} is left out: half of the limit of {options.limit_s:g} s was over."
            )
            continue
        tell(f"timing the paths: {name}")
        if triangles not in models:
            models[triangles] = make_model(demo, triangles)
        work = works[triangles, size] = make_workload(demo, models[triangles], size)
        rows += measure(work, letters, processors(), options.rounds, options.rounds_limit_s)
    return rows, works.get((MAIN_TRIANGLES, MAIN_SIZE), next(iter(works.values()))), left_out


def _time_fits(demo: Demo, options: BenchOptions, letters: str, tell: Tell) -> list[FitTime]:
    limit_s, fits = options.fit_limit_s, []
    for letter, most_s in (("d", limit_s), ("e", limit_s), ("a", options.plain_fit_limit_s)):
        if letter in letters:
            tell(f"searching on path {letter}, for {most_s:.0f} s at most")
            fits.append(time_fit(demo, letter, most_s))
    tell(f"fitting by both methods, for {limit_s:.0f} s at most each")
    renderer = SoftwareRenderer(demo.registration.mesh)
    for free in (False, True):
        found: list[FitTime] = []
        while len(found) < FIT_TIMES and not (found and found[-1].cut_short):
            one = time_method(demo, renderer, "default", processors(), limit_s, free_focal=free)
            found.append(one)
        fits.append(sorted(found, key=lambda fit: fit.seconds)[len(found) // 2])
    fits.append(time_method(demo, renderer, "paper", 1, limit_s))  # it uses one thread
    return fits


def _measure_scaling(
    demo: Demo, options: ScalingOptions, available: str, tell: Tell, until: float
) -> tuple[list[ScalingTime], int]:
    """All three series, until it is ``until`` by ``perf_counter``; how many points are left out."""
    letters = "".join(letter for letter in options.letters if letter in available)
    rows: list[ScalingTime] = []
    done = 0
    works = _scaling_workloads(demo, options)
    while perf_counter() < until and (point := next(works, None)):
        series, work = point
        x = {
            TRIANGLES: len(work.model.mesh.faces),
            COVERED: work.covered_px,
            PHOTO: work.width * work.height,
        }[series]
        tell(f"scaling with {series}: {x:,}")
        found = measure(work, letters, 1, options.rounds, options.rounds_limit_s)
        rows += [ScalingTime(series, x, row) for row in found]
        done += 1
    return rows, options.points - done


def _scaling_workloads(demo: Demo, options: ScalingOptions) -> Iterator[tuple[str, Workload]]:
    def work(model: Model, size: Size, covered_px: int) -> Workload:
        return make_workload(demo, model, size, covered_px / (size[0] * size[1]))

    for triangles in options.triangles:
        model = make_model(demo, triangles)
        yield TRIANGLES, work(model, options.usual_size, options.usual_covered_px)
    model = make_model(demo, options.usual_triangles)
    for covered_px in options.covered_px:
        yield COVERED, work(model, options.large_size, covered_px)
    for size in options.sizes:
        yield PHOTO, work(model, size, options.usual_covered_px)
