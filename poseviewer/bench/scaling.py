"""What an evaluation's time grows with: triangles, covered pixels, and the photo's size."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter

from poseviewer.bench.case import Case, Demo, make_model, place
from poseviewer.bench.paths import make_paths
from poseviewer.bench.timing import Row, measure

Size = tuple[int, int]

TRIANGLES, COVERED, PHOTO = "triangles", "covered pixels", "photo size"
"""The three series."""


@dataclass(frozen=True, slots=True)
class ScalingPlan:
    """Where to measure; what does not vary is as in the main case."""

    triangles: tuple[int, ...] = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
    covered_px: tuple[int, ...] = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)
    sizes: tuple[Size, ...] = (
        (640, 480),
        (1280, 960),
        (2048, 1536),
        (2880, 2160),
        (4032, 3024),
        (6000, 4000),
    )
    usual_triangles: int = 50_000
    usual_covered_px: int = 48_600
    usual_size: Size = (640, 480)
    large_size: Size = (2000, 1500)
    """Of the photo in which the covered pixels vary: it must have room for them."""
    letters: str = "ad"
    rounds: int = 8
    rounds_limit_s: float = 6.0
    """Of each case; three rounds are made in any case, unless they take twice as long."""

    @property
    def points(self) -> int:
        """How many cases there are, of all series."""
        return len(self.triangles) + len(self.covered_px) + len(self.sizes)


@dataclass(frozen=True, slots=True)
class ScalingRow:
    """A row of one series, at its number ``x`` of triangles, or of pixels."""

    series: str
    x: int
    row: Row


def measure_scaling(
    demo: Demo,
    plan: ScalingPlan,
    available: str,
    tell: Callable[[str], None],
    until: float = math.inf,
) -> tuple[list[ScalingRow], int]:
    """The rows of all three series, of those of the plan's paths that are ``available``.

    Once it is ``until`` by ``perf_counter``, no further point is begun; also returns how many are
    left out.
    """
    letters = "".join(letter for letter in plan.letters if letter in available)
    rows, done = [], 0
    cases = _cases(demo, plan)
    while perf_counter() < until:
        series, case = next(cases, (None, None))
        if series is None or case is None:
            break
        x = {
            TRIANGLES: len(case.mesh.faces),
            COVERED: case.covered_px,
            PHOTO: case.width * case.height,
        }[series]
        tell(f"scaling with {series}: {x:,}")
        paths = make_paths(case, letters, 1)
        found = measure(case, paths, plan.rounds, plan.rounds_limit_s)
        rows += [ScalingRow(series, x, row) for row in found]
        done += 1
        for path in paths:
            path.close()
    return rows, plan.points - done


def _cases(demo: Demo, plan: ScalingPlan) -> Iterator[tuple[str, Case]]:
    share = plan.usual_covered_px / _pixels(plan.usual_size)
    for triangles in plan.triangles:
        yield TRIANGLES, place(demo, make_model(demo, triangles), *plan.usual_size, share)
    model = make_model(demo, plan.usual_triangles)
    for covered in plan.covered_px:
        yield COVERED, place(demo, model, *plan.large_size, covered / _pixels(plan.large_size))
    for size in plan.sizes:
        yield PHOTO, place(demo, model, *size, plan.usual_covered_px / _pixels(size))


def _pixels(size: Size) -> int:
    return size[0] * size[1]
