"""Whole searches and whole maps, timed as they run in use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from math import inf
from time import perf_counter
from typing import TypeVar

import numpy as np

from poseviewer.bench.workload import Demo, Workload, lit_problem
from poseviewer.fit.landscape import QUICK_SIZES, Pair, free_pairs, landscape, quick_level
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.search import until_focal_settles
from poseviewer.fit.settings import FitSettings, Limits, Method
from poseviewer.fit.stages import make_stages
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.pool import CHUNK, RendererPool, processors
from poseviewer.render.pyramid.levels import Level, lighter_level
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.render.types import Renderer

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class FitTime:
    """A search from the demo's start, 8 % off in each parameter."""

    method: str
    """What is minimised: ``lit`` colours, which all paths can compute; else a ``--method``."""
    path: str
    threads: int
    seconds: float
    """Of the search alone."""
    model_s: float
    """Of simplifying the model for the coarse level before it, once for each model."""
    evaluations: int
    coarse_evaluations: int
    """Those on a coarser level than the photo."""
    factor: int
    """How many times smaller than the photo the coarsest level is; 1: there is none."""
    faces: int
    """Triangles of the model."""
    status: str
    loss: float
    error_percent: float
    """How far off the pose found is, as a share of the model's size in the photo."""
    limit_s: float
    cut_short: bool
    """Whether the limit ended it."""
    free_focal: bool = False
    """Whether the focal length was searched for too, as a seventh number."""

    @property
    def end(self) -> str:
        """How it ended, in words."""
        how = self.status.lower().replace("_", " ")
        if self.cut_short:
            how = f"cut short by the limit of {self.limit_s:g} s"
        return f"{how}, {self.error_percent:.2f} % off"


@dataclass(frozen=True, slots=True)
class MapsTime:
    """The maps of all pairs of a pose's parameters."""

    maps: int
    size: int
    """Points a side."""
    factor: int
    """How many times smaller than the photo the level was that they were made on."""
    seconds: float
    evaluations: int
    """Poses that were evaluated; maps share the points at which they cross."""
    points: int
    """Losses of the maps that were known at the end, of ``wanted``."""
    wanted: int
    threads: int
    triangles: int
    width: int
    height: int
    limit_s: float | None
    """None: there was none."""
    error: float | None = None
    """How good they are, as ``Slice.error``, where a lighter model drew most of their points."""

    @property
    def cut_short(self) -> bool:
        """Whether the limit ended them."""
        return self.points < self.wanted

    @property
    def end(self) -> str:
        """How it ended, in words."""
        if not self.cut_short:
            good = f", good to {self.error:.1%} of their range" if self.error else ""
            return f"complete, {self.points:,} points{good}"
        share = f"{self.points / self.wanted:.0%} of {self.wanted:,} points"
        return f"cut short by the limit of {self.limit_s:g} s, {share}"


def time_fit(demo: Demo, letter: str, limit_s: float) -> FitTime:
    """Search from the demo's start on path ``a``, ``d`` or ``e``, for ``limit_s`` seconds at most.

    It is the default's search on all, coarse level and simplified models included. On path a every
    evaluation of it is pyrender's; on path e poses that are known together go to all cores.
    """
    problem = lit_problem(demo.registration, Limits(seconds=limit_s))
    if letter != "a":
        threads = processors() if letter == "e" else 1
        renderer = SoftwareRenderer(demo.registration.mesh)
        return _time_fit(demo, problem, renderer, "lit", letter, threads)
    # Importing it makes the OpenGL context, which must not happen before it is wanted.
    from poseviewer.bench.plain import PlainRenderer

    with closing(PlainRenderer(demo.registration.mesh)) as plain:
        return _time_fit(demo, problem, plain, "lit", letter, 1)


def time_method(
    demo: Demo,
    renderer: SoftwareRenderer,
    method: Method,
    threads: int,
    limit_s: float,
    *,
    free_focal: bool = False,
) -> FitTime:
    """What ``fit --method`` does on the demo, without the verdict and what follows from it;
    ``renderer`` is of its model.
    """
    settings = FitSettings(method=method, free_focal=free_focal, limits=Limits(seconds=limit_s))
    problem, _ = make_problem(demo.registration, settings)
    path = "d" if threads == 1 else "e"
    found = _time_fit(demo, problem, renderer, method, path, threads)
    return replace(found, free_focal=free_focal)


def _time_fit(
    demo: Demo, problem: FitProblem, renderer: Renderer, method: str, letter: str, threads: int
) -> FitTime:
    start = problem.chart.to_pose(problem.start)
    renderer.moments(start, problem.photo)
    began = perf_counter()
    stages = make_stages(problem, renderer)  # simplifies the model, which is then kept
    model_s = perf_counter() - began
    for stage in stages:
        stage.level.renderer.moments(start, stage.level.photo)
    coarse, before = 0, 0
    end: FitProgress | None = None
    for end in until_focal_settles(problem, renderer, threads):
        coarse += (end.evaluations - before) * (end.factor > 1)
        before = end.evaluations
    assert end is not None  # a search yields at least once
    return FitTime(
        method=method,
        path=letter,
        threads=threads,
        seconds=end.seconds,
        model_s=model_s,
        evaluations=end.evaluations,
        coarse_evaluations=coarse,
        factor=stages[0].level.factor,
        faces=len(demo.registration.mesh.faces),
        status=end.status.name,
        loss=end.loss,
        error_percent=pose_error(demo.registration.mesh, end.pose, demo.truth).percent,
        limit_s=problem.limits.seconds,
        cut_short=end.status is Status.SECONDS_SPENT,
    )


def time_first_maps(work: Workload, threads: int | None, limit_s: float = inf) -> MapsTime:
    """The first whole sheet that the app shows: small maps, on the level that it takes."""
    level = quick_level(work.usual, work.poses[0], work.model.renderer)
    return _time_maps(work, level, threads, QUICK_SIZES[-1], limit_s)


def time_maps(
    work: Workload, threads: int | None, size: int, limit_s: float = inf, *, light: bool = False
) -> MapsTime:
    """Maps of ``size`` points a side, of the search's usual loss, about the first pose; with a
    ``light`` model, as the app makes them.
    """
    level = Level(1, work.usual.photo, work.model.renderer)
    if not light:
        return _time_maps(work, level, threads, size, limit_s)
    lighter = lighter_level(work.usual.photo, work.model.renderer, work.poses[0])
    pool = _CountingPool(lighter.renderer, threads)
    with pool:
        return _time_maps(work, level, threads, size, limit_s, pool)


class _CountingPool(RendererPool):
    evaluations = 0

    def map(
        self,
        function: Callable[[Renderer, Item], Result],
        items: Sequence[Item],
        at_a_time: int = CHUNK,
    ) -> Iterator[Result]:
        for result in super().map(function, items, at_a_time):
            self.evaluations += 1
            yield result


def _time_maps(
    work: Workload,
    level: Level,
    threads: int | None,
    size: int,
    limit_s: float,
    light: _CountingPool | None = None,
) -> MapsTime:
    problem = replace(work.usual, photo=level.photo)
    known: dict[Pair, int] = {}
    error: float | None = None
    pool = _CountingPool(level.renderer, threads)
    with pool:
        # Each thread's first image of a size takes its buffers.
        pool.moments_of(work.poses[:1] * (2 * CHUNK * pool.threads), problem.photo)
        pool.evaluations = 0
        if light is not None:
            light.moments_of(work.poses[:1] * (2 * CHUNK * light.threads), problem.photo)
            light.evaluations = 0
        began = perf_counter()
        for piece in landscape(problem, pool, work.parameters[0], size=size, light=light):
            error = piece.error
            known[piece.first, piece.second] = int(np.isfinite(piece.losses).sum())
            if perf_counter() - began > limit_s:
                break
        seconds = perf_counter() - began
    pairs = len(free_pairs(problem))
    return MapsTime(
        maps=pairs,
        size=size,
        factor=level.factor,
        seconds=seconds,
        evaluations=pool.evaluations + (light.evaluations if light is not None else 0),
        points=sum(known.values()),
        wanted=pairs * size * size,
        threads=pool.threads,
        triangles=work.model.triangles,
        width=work.width,
        height=work.height,
        limit_s=None if limit_s == inf else limit_s,
        error=error,
    )
