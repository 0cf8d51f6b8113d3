"""Whether memory grows with work: ``python -m tests.measure.memory``.

Evaluations at poses all about the photo, then short fits, each with a problem of its own, as the
app makes them. Prints the resident memory at intervals; exit code 1 if it grew.
"""

from __future__ import annotations

import argparse
import gc
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseviewer.bench.workload import Workload, load_demo, make_model, make_workload
from poseviewer.fit.problem import FitProblem, pose_loss
from poseviewer.fit.settings import Limits
from poseviewer.fit.stages import fit_pose
from poseviewer.render.types import PhotoAttributes, Renderer

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
    options = parser.parse_args()
    demo = load_demo()
    case = make_workload(demo, make_model(demo, TRIANGLES), (WIDTH, HEIGHT))
    grown = [
        _watch("evaluations", options.evaluations, evaluations(case.usual, case.model.renderer)),
        _watch("fits", options.fits, fits(case)),
    ]
    return int(max(grown) > MOST_GROWTH_MB)


def evaluations(problem: FitProblem, renderer: Renderer) -> Iterator[float]:
    """Losses at random poses, without end."""
    random = np.random.default_rng(0)
    scales = problem.chart.scales(problem.start)
    while True:
        offset = random.uniform(-SPREAD, SPREAD, len(scales)) * random.uniform()
        yield pose_loss(problem, renderer, problem.start + offset * scales)


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
        yield end.loss


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
    grown = growth(
        work,
        count,
        resident_mb,
        lambda done, mb: print(f"{done:8,} {what}: {mb:7.1f} MB", flush=True),
    )
    print(f"{what}: grown by {grown:+.2f} MB since the first tenth", flush=True)
    return grown


def resident_mb() -> float:
    """Resident memory of this process, in units of 10^6 bytes (Linux)."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) * 1024 / 1e6


if __name__ == "__main__":
    sys.exit(main())
