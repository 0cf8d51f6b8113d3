"""Whether anything grows with work: ``python -m tests.measure.soak``.

Evaluations at poses all about the photo, then short fits, each with a problem of its own, as the
app makes them, then searches of photos and models that are opened from their files and closed.
Prints resident memory, threads and open files at intervals; exit code 1 if they grew, or a loss was
not finite.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import math
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import poseviewer
from poseviewer.bench.workload import Workload, load_demo, make_model, make_workload
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.fit.settings import METHODS, FitSettings, Limits
from poseviewer.fit.stages import fit_pose
from poseviewer.render.types import PhotoAttributes, Renderer
from tests.meshes import make_bumpy, make_painted
from tests.scene import make_scene_of

MOST_GROWTH_MB = 5.0
SAMPLES, WARM_SAMPLES = 20, 2
"""So many looks at the memory in each part; growth counts from this look on."""
FIT_EVALUATIONS = 60
WIDTH, HEIGHT, TRIANGLES = 320, 240, 5_000
SPREAD = 0.5
"""The poses lie within this share of each number's span: many partly or wholly out of view."""


def main() -> int:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--evaluations", type=int, default=100_000)
    parser.add_argument("--fits", type=int, default=1_000)
    parser.add_argument("--searches", type=int, default=500)
    options = parser.parse_args()
    demo = load_demo()
    case = make_workload(demo, make_model(demo, TRIANGLES), (WIDTH, HEIGHT))
    grown = [
        _watch("evaluations", options.evaluations, evaluations(case.usual, case.model.renderer)),
        _watch("fits", options.fits, fits(case)),
    ]
    with tempfile.TemporaryDirectory() as made:
        grown.append(_watch("searches", options.searches, searches(Path(made))))
    return int(max(grown) > MOST_GROWTH_MB)


def evaluations(problem: FitProblem, renderer: Renderer) -> Iterator[float]:
    """Losses at random poses, without end."""
    random = np.random.default_rng(0)
    scales = problem.chart.scales(problem.start)
    while True:
        offset = random.uniform(-SPREAD, SPREAD, len(scales)) * random.uniform()
        yield _finite(pose_loss(problem, renderer, problem.start + offset * scales))


def fits(case: Workload, evaluations: int = FIT_EVALUATIONS) -> Iterator[float]:
    """Losses that short fits end in, from random starts, without end."""
    random = np.random.default_rng(1)
    scales = case.usual.chart.scales(case.usual.start)
    while True:
        start = case.usual.start + random.uniform(-0.1, 0.1, len(scales)) * scales
        photo = case.usual.photo
        own = PhotoAttributes(np.array(photo.channels), np.array(photo.weights), photo.clipped)
        problem = replace(
            case.usual, photo=own, start=start, limits=Limits(evaluations=evaluations)
        )
        *_, end = fit_pose(problem, case.model.renderer)
        yield _finite(end.loss)


def searches(folder: Path, evaluations: int = FIT_EVALUATIONS) -> Iterator[float]:
    """Losses that short searches of files end in, each opened anew, of two models in turn, without
    end.
    """
    scenes = []
    for name, mesh in (("bumpy", make_bumpy(3)), ("painted", make_painted())):
        (folder / name).mkdir()
        scenes.append(make_scene_of(mesh, folder / name))
    for number, scene in enumerate(itertools.cycle(scenes)):
        limits = Limits(evaluations=evaluations)
        settings = FitSettings(tuple(METHODS)[number // 2 % 2], seed=number, limits=limits)
        case = poseviewer.load(scene.photo, scene.model, scene.start, settings)
        yield [_finite(progress.loss) for progress in case.search(threads=2)][-1]


def _finite(loss: float) -> float:
    if not math.isfinite(loss):
        raise AssertionError(f"a loss of {loss}")
    return loss


def growth(
    work: Iterator[float], count: int, size: Callable[[], float], say: Callable[[int, float], None]
) -> float:
    """How much ``size`` has grown after ``count`` pieces of work, once warmed up."""
    warm = 0.0
    for sample in range(1, SAMPLES + 1):
        for _ in range(count // SAMPLES):
            next(work)
        gc.collect()
        now = size()
        say(sample * (count // SAMPLES), now)
        if sample == WARM_SAMPLES:
            warm = now
    return size() - warm


def _watch(what: str, count: int, work: Iterator[float]) -> float:
    held = list[tuple[int, int]]()

    def say(done: int, mb: float) -> None:
        folders = (Path("/proc/self") / name for name in ("task", "fd"))
        threads, files = (len(list(folder.iterdir())) for folder in folders)
        held.append((threads, files))
        print(f"{done:8,} {what}: {mb:7.1f} MB, {threads} threads, {files} files", flush=True)

    grown = growth(work, count, resident_mb, say)
    print(f"{what}: grown by {grown:+.2f} MB since the first tenth", flush=True)
    for now, warm in zip(held[-1], held[WARM_SAMPLES], strict=True):
        if now > warm:
            raise AssertionError(f"{what}: {held[WARM_SAMPLES]} became {held[-1]}: threads, files")
    return grown


def resident_mb() -> float:
    """Resident memory of this process, in units of 10^6 bytes (Linux)."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) * 1024 / 1e6


if __name__ == "__main__":
    sys.exit(main())
