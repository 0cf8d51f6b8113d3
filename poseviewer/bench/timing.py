"""Times of several paths, taken in turn so that what disturbs the machine hits all alike."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from poseviewer.bench.case import Case
from poseviewer.bench.paths import Path

SLOW_S = 3.0
"""A path whose first run took longer is warm after it."""
LEAST_ROUNDS = 3
BURST_S, LONGEST_BURST = 0.15, 8
"""A path's turn lasts about so long, and so many runs at most."""
QUICK_S = 0.25
"""A path whose run takes less begins each turn with one that does not count."""


@dataclass(frozen=True, slots=True)
class Row:
    """The time of one stage of one path, ms."""

    path: str
    """A letter, ``a`` to ``e``."""
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
    """As the model really has."""
    covered_px: int
    """Pixels of the photo that show the model at its true pose."""


def measure(case: Case, paths: Sequence[Path], rounds: int, limit_s: float = math.inf) -> list[Row]:
    """A row for each stage of each path, from so many ``rounds`` of turns.

    After ``limit_s`` seconds no further round is begun, once there were ``LEAST_ROUNDS``; after
    twice as many, once there was one.

    The turn of a quick path begins with a run that does not count: it brings back into the
    processor's caches what the other paths have pushed out, as it is in a search.
    """
    samples: dict[tuple[int, str], list[float]] = defaultdict(list)
    warm_s = [_warm(path) for path in paths]
    began = perf_counter()
    for turn in range(rounds):
        limit = limit_s if turn >= LEAST_ROUNDS else 2.0 * limit_s
        if turn and perf_counter() - began > limit:
            break
        for i, (path, took) in enumerate(zip(paths, warm_s, strict=True)):
            burst = int(np.clip(BURST_S / max(took, 1e-9), 1, LONGEST_BURST))
            if took < QUICK_S:
                path.run(turn * burst)
            for k in range(burst):
                for stage, seconds in path.run(turn * burst + k + 1).items():
                    samples[i, stage].append(1e3 * seconds)
    return [_row(case, paths[i], stage, times) for (i, stage), times in samples.items()]


def _warm(path: Path) -> float:
    """Warm the path up; seconds that a run takes, once its buffers are there."""
    took = _seconds(path, 0)
    if took > SLOW_S:
        return took
    took = _seconds(path, 1)
    return min(took, _seconds(path, 2)) if took < QUICK_S else took


def _seconds(path: Path, k: int) -> float:
    began = perf_counter()
    path.run(k)
    return perf_counter() - began


def _row(case: Case, path: Path, stage: str, times: Sequence[float]) -> Row:
    return Row(
        path.letter,
        case.triangles,
        case.width,
        case.height,
        path.threads,
        stage,
        float(np.median(times)),
        min(times),
        max(times),
        len(times),
        len(case.mesh.faces),
        case.covered_px,
    )
