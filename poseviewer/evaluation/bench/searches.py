"""Whole searches and whole maps, timed as they run in use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from poseviewer.evaluation.bench.case import Case, Demo
from poseviewer.evaluation.bench.spread import Spread
from poseviewer.evaluation.pose_error import pose_error
from poseviewer.fit.landscape import Pair, free_pairs, landscape
from poseviewer.fit.pose_fit import FitProblem, FitProgress, Limits, Status, fit_pose
from poseviewer.registration import FitSettings, make_problem
from poseviewer.render.attributes import Renderer
from poseviewer.render.levels import LevelRenderer, coarser
from poseviewer.render.software import SoftwareRenderer

FIRST_FACTOR = 4
"""The app's first maps are those of the photo this many times smaller along each side, where it
has pixels enough for that."""
FIRST_SIDE_PX = 240


@dataclass(frozen=True, slots=True)
class FitTime:
    """The default search from the demo's start, 8 % off in each of its numbers."""

    path: str
    seconds: float
    evaluations: int
    status: str
    loss: float
    error_percent: float
    """How far off the pose found is, as a share of the model's size in the photo."""
    limit_s: float

    @property
    def cut_short(self) -> bool:
        """Whether the limit ended it."""
        return self.status == Status.SECONDS_SPENT.name


@dataclass(frozen=True, slots=True)
class MapsTime:
    """The maps of all pairs of a pose's numbers."""

    maps: int
    size: int
    """Points along each side of a map."""
    factor: int
    """How many times smaller than the photo the picture was that they were made from."""
    seconds: float
    evaluations: int
    """Losses that were found, of ``wanted``."""
    wanted: int
    threads: int
    triangles: int
    width: int
    height: int


def time_fit(demo: Demo, letter: str, limit_s: float) -> FitTime:
    """Search from the demo's start on path ``a`` or ``d``, for ``limit_s`` seconds at most."""
    settings = FitSettings(limits=Limits(seconds=limit_s))
    problem, _ = make_problem(demo.registration, settings)
    renderer, close = _search_renderer(demo, letter)
    renderer.moments(demo.truth, problem.photo)
    end = _last(problem, renderer)
    close()
    error = pose_error(demo.registration.mesh, end.pose, demo.truth).percent
    return FitTime(letter, end.seconds, end.evaluations, end.status.name, end.loss, error, limit_s)


def _last(problem: FitProblem, renderer: Renderer) -> FitProgress:
    *_, end = fit_pose(problem, renderer)
    return end


def _search_renderer(demo: Demo, letter: str) -> tuple[Renderer, Callable[[], None]]:
    if letter == "d":
        return SoftwareRenderer(demo.registration.mesh), lambda: None
    # Importing it makes the OpenGL context, which must not happen before it is wanted.
    from poseviewer.evaluation.bench.plain import PlainRenderer

    renderer = PlainRenderer(demo.registration.mesh)
    return renderer, renderer.close


def time_first_maps(case: Case, threads: int, size: int = 9, limit_s: float = np.inf) -> MapsTime:
    """The first sheet that the app shows at rest: small maps, of a smaller picture."""
    longer = max(case.width, case.height)
    factor = min(max(longer // FIRST_SIDE_PX, 1), FIRST_FACTOR)
    return time_maps(case, threads, size, factor, limit_s)


def time_maps(
    case: Case, threads: int, size: int, factor: int = 1, limit_s: float = np.inf
) -> MapsTime:
    """Maps of ``size`` points a side, of the search's usual loss, about the first pose.

    Each pair's map goes to a core that is free.
    """
    problem, level = case.usual, 1.0 / factor
    if factor > 1:
        problem = replace(problem, photo=coarser(problem.photo, factor))
    pairs = free_pairs(problem)
    with Spread(case.renderer, threads) as spread:
        spread.map(lambda r, _: r.covers(case.poses[0].scaled(level)), range(2 * threads))
        began = perf_counter()

        def one_map(renderer: SoftwareRenderer, pair: Pair) -> int:
            drawn = renderer if factor == 1 else LevelRenderer(renderer, factor)
            return _known(problem, drawn, case, pair, size, began + limit_s)

        known = sum(spread.map(one_map, pairs))
        seconds = perf_counter() - began
    return MapsTime(
        len(pairs),
        size,
        factor,
        seconds,
        known,
        len(pairs) * size * size,
        threads,
        case.triangles,
        case.width,
        case.height,
    )


def _known(
    problem: FitProblem, renderer: Renderer, case: Case, pair: Pair, size: int, end: float
) -> int:
    """How many losses of the map are known when it is complete, or the time is up."""
    known = 0
    for piece in landscape(problem, renderer, case.numbers[0], size=size, pairs=[pair]):
        known = int(np.isfinite(piece.losses).sum())
        if perf_counter() > end:
            break
    return known
