"""Whole searches and whole maps, timed as they run in use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.bench.case import Case, Demo, lit_problem
from poseviewer.fit.landscape import QUICK_SIZES, Pair, free_pairs, landscape, quick_level
from poseviewer.fit.problem import (
    FitProblem,
    FitProgress,
    Status,
    fit_pose,
    make_problem,
    stages_of,
)
from poseviewer.fit.settings import FitSettings, Limits, Method
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.pool import CHUNK, RendererPool, processors
from poseviewer.render.pyramid.levels import Level
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.render.types import AttributeImage, Moments, PhotoAttributes, Renderer

NO_LIMIT = float("inf")


@dataclass(frozen=True, slots=True)
class FitTime:
    """A search from the demo's start, 8 % off in each of its numbers."""

    method: str
    """What is searched for: ``lit`` colours, which all paths can compute; else a ``--method``."""
    path: str
    threads: int
    seconds: float
    """Of the search alone."""
    model_s: float
    """What simplifying the model for the coarse level took before it, once for each model."""
    evaluations: int
    coarse_evaluations: int
    """How many of them were while the search was on the coarse level of the photo."""
    factor: int
    """How many times smaller than the photo that level is; 1: there is none."""
    faces: int
    """Triangles of the model."""
    status: str
    loss: float
    error_percent: float
    """How far off the pose found is, as a share of the model's size in the photo."""
    limit_s: float
    cut_short: bool
    """Whether the limit ended it."""

    @property
    def end(self) -> str:
        """How it ended, in words."""
        how = self.status.lower().replace("_", " ")
        if self.cut_short:
            how = f"cut short by the limit of {self.limit_s:g} s"
        return f"{how}, {self.error_percent:.2f} % off"


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
    """Poses that were judged; maps share the points at which they cross."""
    points: int
    """Losses of the maps that were known at the end, of ``wanted``."""
    wanted: int
    threads: int
    triangles: int
    width: int
    height: int
    limit_s: float | None
    """None: there was none."""

    @property
    def cut_short(self) -> bool:
        """Whether the limit ended them."""
        return self.points < self.wanted

    @property
    def end(self) -> str:
        """How it ended, in words."""
        if not self.cut_short:
            return f"complete, {self.points:,} points"
        share = self.points / self.wanted
        return (
            f"cut short by the limit of {self.limit_s:g} s, {share:.0%} of {self.wanted:,} points"
        )


def time_fit(demo: Demo, letter: str, limit_s: float) -> FitTime:
    """Search from the demo's start on path ``a``, ``d`` or ``e``, for ``limit_s`` seconds at most.

    It is the default's search on all, coarse level and simplified models included; on path a every
    evaluation of it is pyrender's, on path e poses that are known together are judged on all cores.
    """
    problem = lit_problem(demo.registration, Limits(seconds=limit_s))
    renderer, close = _search_renderer(demo, letter)
    try:
        threads = processors() if letter == "e" else 1
        return _timed(demo, problem, renderer, ("lit", letter, threads))
    finally:
        close()


def time_method(
    demo: Demo, renderer: SoftwareRenderer, method: Method, threads: int, limit_s: float
) -> FitTime:
    """What ``fit --method`` does on the demo; ``renderer`` is of its model."""
    settings = FitSettings(method=method, limits=Limits(seconds=limit_s))
    problem, _ = make_problem(demo.registration, settings)
    return _timed(demo, problem, renderer, (method, "d" if threads == 1 else "e", threads))


def _timed(
    demo: Demo, problem: FitProblem, renderer: Renderer, name: tuple[str, str, int]
) -> FitTime:
    """The search that is called (method, path, threads)."""
    model_s, coarsest = _ready(problem, renderer)
    coarse, end = _run(problem, renderer, name[2])
    limit_s = problem.limits.seconds
    return FitTime(
        method=name[0],
        path=name[1],
        threads=name[2],
        seconds=end.seconds,
        model_s=model_s,
        evaluations=end.evaluations,
        coarse_evaluations=coarse,
        factor=coarsest.factor,
        faces=len(demo.registration.mesh.faces),
        status=end.status.name,
        loss=end.loss,
        error_percent=pose_error(demo.registration.mesh, end.pose, demo.truth).percent,
        limit_s=limit_s,
        cut_short=end.status is Status.SECONDS_SPENT,
    )


def _ready(problem: FitProblem, renderer: Renderer) -> tuple[float, Level]:
    """Simplify the model, which is then kept, and warm up: seconds, and the coarsest level."""
    start = problem.chart.to_pose(problem.start)
    renderer.moments(start, problem.photo)
    began = perf_counter()
    stages = stages_of(problem, renderer, start)
    seconds = perf_counter() - began
    for stage in stages:
        stage.level.renderer.moments(start, stage.level.photo)
    return seconds, stages[0].level


def _run(problem: FitProblem, renderer: Renderer, threads: int) -> tuple[int, FitProgress]:
    """Evaluations while it was on the coarse level, and the end."""
    coarse, before, end = 0, 0, None
    for end in fit_pose(problem, renderer, threads):
        coarse += (end.evaluations - before) * (end.factor > 1)
        before = end.evaluations
    assert end is not None  # a search yields at least once
    return coarse, end


def _search_renderer(demo: Demo, letter: str) -> tuple[Renderer, Callable[[], None]]:
    if letter in ("d", "e"):
        return SoftwareRenderer(demo.registration.mesh), lambda: None
    # Importing it makes the OpenGL context, which must not happen before it is wanted.
    from poseviewer.bench.plain import PlainRenderer

    renderer = PlainRenderer(demo.registration.mesh)
    return renderer, renderer.close


def time_first_maps(case: Case, threads: int | None, limit_s: float = NO_LIMIT) -> MapsTime:
    """The first whole sheet that the app shows: small maps, on the level that it takes."""
    level = quick_level(case.usual, case.poses[0], case.renderer)
    return _time_on(case, level, threads, QUICK_SIZES[-1], limit_s)


def time_maps(case: Case, threads: int | None, size: int, limit_s: float = NO_LIMIT) -> MapsTime:
    """Maps of ``size`` points a side, of the search's usual loss, about the first pose."""
    return _time_on(case, Level(1, case.usual.photo, case.renderer), threads, size, limit_s)


def _time_on(case: Case, level: Level, threads: int | None, size: int, limit_s: float) -> MapsTime:
    problem = replace(case.usual, photo=level.photo)
    counted = _Counted(level.renderer, [])
    with RendererPool(counted, threads) as pool:
        # Each thread's first picture of a size takes its buffers.
        poses = case.poses[:1] * (2 * CHUNK * pool.threads)
        pool.moments_of(poses, problem.photo)
        counted.calls.clear()
        began = perf_counter()
        points = _known(problem, pool, case, size, began + limit_s)
        seconds = perf_counter() - began
    pairs = len(free_pairs(problem))
    return MapsTime(
        maps=pairs,
        size=size,
        factor=level.factor,
        seconds=seconds,
        evaluations=len(counted.calls),
        points=points,
        wanted=pairs * size * size,
        threads=pool.threads,
        triangles=case.triangles,
        width=case.width,
        height=case.height,
        limit_s=None if limit_s == NO_LIMIT else limit_s,
    )


def _known(problem: FitProblem, pool: RendererPool, case: Case, size: int, end: float) -> int:
    """How many losses of all maps are known when they are complete, or the time is up."""
    known: dict[Pair, int] = {}
    for piece in landscape(problem, pool, case.parameters[0], size=size):
        known[piece.first, piece.second] = int(np.isfinite(piece.losses).sum())
        if perf_counter() > end:
            break
    return sum(known.values())


@dataclass(frozen=True, slots=True)
class _Counted:
    """A renderer whose evaluations are counted, those of its clones among them."""

    renderer: Any
    calls: list[None]
    """One for each evaluation: adding to a list is safe from several threads."""

    def clone(self) -> _Counted:
        return _Counted(self.renderer.clone(), self.calls)

    def render(self, pose: Pose) -> AttributeImage:
        return self.renderer.render(pose)

    def covers(self, pose: Pose) -> NDArray[np.bool_]:
        return self.renderer.covers(pose)

    def moments(self, pose: Pose, photo: PhotoAttributes) -> Moments:
        self.calls.append(None)
        return self.renderer.moments(pose, photo)
