"""The stages of a search, coarse to fine, and running them.

A coarse pyramid level shows the same valleys at a fraction of the cost: its minimum lies within one
of its pixels of the photo's. CMA-ES searches the coarsest level and then the photo itself with a
lighter model; quadratic models of the loss end the search on the finest level. Alternatively, a
restarted simplex searches the three levels. By the paper's loss, the simplex searches the photo
alone, with edges proportional to the parameters' values.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from poseviewer.fit.problem import FitProblem, pose_loss, with_min_coverage
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import level_pose
from poseviewer.optimise import cma_es, quadratic, simplex_restarts
from poseviewer.optimise.cma_es import CmaOptions
from poseviewer.optimise.protocol import Minimiser, State
from poseviewer.optimise.quadratic import QuadraticOptions
from poseviewer.optimise.restart_options import RestartOptions
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, coarsest_level, lighter_level, with_structure
from poseviewer.vehicle.chart import VehicleChart

MIN_LEVEL_PIXELS = 5000
"""Pixels of the model at the start on the coarsest level: coarser levels have side valleys."""
MIN_STRUCTURE_PIXELS = 2000
"""``MIN_LEVEL_PIXELS`` with classes and edges, whose valleys are wider than those of shades."""
COARSE_POPULATION = CmaOptions(min_sigma=0.04)
"""CMA-ES on the coarsest level; ends early, as the minimum is up to 5 % beside the photo's."""
FINE_POPULATION = CmaOptions(sigma=0.06, population=16, generations=24, min_sigma=2e-3)
"""CMA-ES on the photo itself, as wide as the coarse level can be wrong."""
LAST_MODELS = QuadraticOptions(sampling_radius=2.0, contour_level=0.6)
"""Quadratic models after CMA-ES: their least gain moves the model a twentieth of a pixel."""
REFINING_MODELS = QuadraticOptions(sampling_radius=1.0, contour_level=0.3)
"""Quadratic models on the fine photo, whose minimum is a pixel away at most."""
COARSE_SIMPLEX = RestartOptions(
    step=0.2, multi_starts=4, multi_start_step=0.2, multi_start_x_tolerance=0.05,
    multi_start_f_tolerance=0.5, x_tolerance=0.02, f_tolerance=0.1, least_gain=0.1,
)  # fmt: skip
"""Simplex on the coarsest level, as wide as CMA-ES reaches."""
LIGHT_SIMPLEX = RestartOptions(
    step=0.05, multi_starts=0, x_tolerance=4e-3, f_tolerance=0.03, least_gain=0.05
)
"""Simplex on the photo itself, as wide as the coarse level can be wrong."""
FINE_SIMPLEX = RestartOptions(
    step=0.015, multi_starts=0, x_tolerance=1.5e-3, f_tolerance=0.01, least_gain=0.02
)
"""Simplex on the fine photo, whose minimum is a pixel away."""
MIN_VALUE = 0.05
"""Least value of a parameter for its edge, in its scale: some are 0 by chance."""
RESCORE_EVERY = 32
"""Evaluations after which the best point of a coarse level is scored on the photo."""
REFINE_TOLERANCE = 1.0
"""Loss on the photo by which a refined pose has left the valley: ten times the gap of minima."""


Options = TypeVar("Options")


@dataclass(frozen=True, slots=True, eq=False)
class Stage(Generic[Options]):
    """A pyramid level of each view's photo, and the minimiser that searches it."""

    levels: tuple[Level, ...]
    minimise: Minimiser[Options]
    options: Options
    """Options of the minimiser."""
    along_axes: bool = False
    """Whether the stage starts along the axes that the stage before found."""
    rescore_every: float = 0.0
    """Evaluations after which the best point is scored on the photo; infinite: at the end; 0: the
    level is the photo itself."""
    tolerance: float = 0.0
    """Loss above the best so far up to which a scored point is kept."""


StageMaker = Callable[[FitProblem, Renderer, FloatArray], tuple[Stage, ...]]
"""Function that makes the stages of a search from parameters (d,), the coarsest first."""


def make_stages(
    problem: FitProblem, renderer: Renderer, start: FloatArray | None = None
) -> tuple[Stage, ...]:
    """Make the stages of a search from parameters ``start`` (d,), by default the problem's."""
    at = problem.start if start is None else start
    poses = [(view.photo, renderer, view.chart.to_pose(at)) for view in problem.views]
    full = tuple(Level(1, view.photo, renderer) for view in problem.views)
    if _is_by_papers_simplex(problem):
        return (Stage(full, simplex_restarts.minimise, problem.settings.options),)
    loss = problem.loss
    min_pixels = MIN_STRUCTURE_PIXELS if loss.has_structure else MIN_LEVEL_PIXELS
    coarse = tuple(coarsest_level(*pose, min_pixels) for pose in poses)
    light = tuple(lighter_level(*pose) for pose in poses)
    least = tuple(c if c.factor > 1 else own for c, own in zip(coarse, light, strict=True))
    fine = tuple(Level(1, view.fine_photo, renderer) for view in problem.views if view.fine_photo)
    if problem.settings.searched_by == "simplex":
        first = Stage(least, simplex_restarts.minimise, COARSE_SIMPLEX, False, RESCORE_EVERY)
        if not fine:
            return first, Stage(full, simplex_restarts.minimise, LIGHT_SIMPLEX)
        return (
            first,
            Stage(light, simplex_restarts.minimise, LIGHT_SIMPLEX, False, RESCORE_EVERY),
            Stage(fine, simplex_restarts.minimise, FINE_SIMPLEX, False, math.inf, REFINE_TOLERANCE),
        )
    stages = tuple(
        Stage(levels, cma_es.minimise, options.in_unit(loss.unit), rescore_every=RESCORE_EVERY)
        for levels, options in ((least, COARSE_POPULATION), (light, FINE_POPULATION))
    )
    last, refining = (options.in_unit(loss.unit) for options in (LAST_MODELS, REFINING_MODELS))
    if not fine:
        return *stages, Stage(full, quadratic.minimise, last, along_axes=True)
    return (
        *stages,
        Stage(light, quadratic.minimise, last, True, RESCORE_EVERY),
        Stage(fine, quadratic.minimise, refining, True, math.inf, REFINE_TOLERANCE),
    )


def _is_by_papers_simplex(problem: FitProblem) -> bool:
    return problem.settings.searched_by == "simplex" and not problem.loss.has_structure


def _scales(problem: FitProblem, at: FloatArray) -> FloatArray:
    """(d,): unit of the first simplex or population about parameters (d,)."""
    scales = problem.chart.scales(at)
    if _is_by_papers_simplex(problem) and isinstance(problem.chart, VehicleChart):
        return np.maximum(np.abs(at), MIN_VALUE * scales)
    return scales


def fit_pose(
    problem: FitProblem,
    renderer: Renderer,
    threads: int = 1,
    before: FitProgress | None = None,
    *,
    seed: int | None = None,
    is_coarse: bool = False,
    make: StageMaker = make_stages,
) -> Iterator[FitProgress]:
    """Run the stages, and yield the progress after every evaluation; the last one is the outcome.

    Stop iterating to stop the search. But for ``Limits.seconds`` it is deterministic, on any number
    of threads: poses that a minimiser asks for together are evaluated in parallel.

    Args:
        problem: what to fit, with its start.
        renderer: renderer of the model.
        threads: number of threads.
        before: end of a search to continue, without the coarsest level and within the rest of the
            limits; None: begin at the problem's start.
        seed: seed of the minimisers; None: that of the settings.
        is_coarse: whether to search the coarsest level alone.
        make: maker of the stages.
    """
    if problem.photo.clipped:
        problem = with_min_coverage(problem, renderer)
    is_continued, before = before is not None, before or FitProgress.at_start(problem)
    stages = make(problem, renderer, before.parameters)
    if is_continued and problem.loss.has_structure:
        stages = stages[1:] or stages
    elif is_coarse and not is_continued:
        stages = stages[:1]
    run = _Run(renderer, threads, replace(before, problem=problem), seed)
    for stage, following in zip(stages, (*stages[1:], None), strict=True):
        for progress in run.search(stage, following):
            yield progress
            if progress.status is not Status.RUNNING:
                return


class _Run:
    """The best pose on the photo itself, and the evaluations so far."""

    def __init__(
        self, renderer: Renderer, threads: int, before: FitProgress, seed: int | None
    ) -> None:
        problem = self._problem = before.problem
        self._renderer, self._threads = renderer, threads
        self._seed = problem.settings.seed if seed is None else seed
        self._scorer, self._began = renderer, time.perf_counter() - before.seconds
        self._best = replace(before, loss=np.inf, verdict=None, covariance=None)
        self._evaluations, self._evaluations_before = 0, before.evaluations
        self._restart = before.restart
        scales = _scales(problem, before.parameters)[problem.free_indices]
        self._scale = self._axes = np.diag(scales)
        self._score: Callable[[], None] | None = None
        self._ready: Callable[[], FitProblem] | None = None

    def search(self, stage: Stage, following: Stage | None) -> Iterator[FitProgress]:
        """Search a stage's level, and make the photos of the ``following`` one meanwhile."""
        scored = None
        due = stage.rescore_every
        every = stage.rescore_every
        problem = self._on_level(stage) if self._ready is None else self._ready()
        renderers = self._renderers_of(stage)
        scale, restart = self._axes if stage.along_axes else self._scale, self._restart + 1
        self._restart = restart
        with RendererPool(renderers, self._threads) as pool:
            if following is not None:
                self._ready = pool.start(partial(self._on_level, following))
            start = self._best.parameters[problem.free_indices]
            if 0.0 < every < math.inf:
                scored = start
                self._begin_score(start, pool)
                self._take_score()
                yield self._progress(stage, State(start, np.inf, start[None], np.full(1, np.inf)))
            objective = partial(self._losses, problem, renderers, pool)
            for state in stage.minimise(objective, start, scale, stage.options, self._seed):
                self._restart = restart + state.restart
                self._axes = self._axes if state.axes is None else state.axes
                if not every:
                    self._keep(state.best, state.value)
                    ends = following is None or self._best.loss >= problem.worst_loss
                    yield self._progress(stage, state, state.converged and ends)
                    continue
                yield self._progress(stage, state)
                is_due = state.converged or self._evaluations >= due
                if is_due and (scored is None or not np.array_equal(state.best, scored)):
                    scored, due = state.best, self._evaluations + every
                    self._begin_score(scored, pool, stage.tolerance)
                    if not state.converged:
                        yield self._progress(stage, state)
                if state.converged:
                    self._take_score()
                    yield self._progress(stage, state, following is None)

    def _losses(
        self,
        problem: FitProblem,
        renderers: tuple[Renderer, ...],
        pool: RendererPool,
        points: Sequence[FloatArray],
    ) -> Iterator[float]:
        """Compute the losses of points on a stage's level."""
        loss, wanted = partial(pose_loss, problem), [problem.complete(point) for point in points]
        single = len(wanted) == 1
        for value in [loss(renderers, wanted[0])] if single else pool.map(loss, wanted):
            self._evaluations += 1
            yield value

    def _renderers_of(self, stage: Stage) -> tuple[Renderer, ...]:
        """Renderers of the levels; the third of four stages culls hidden faces."""
        renderers = tuple(level.renderer for level in stage.levels)
        if stage.along_axes and stage.rescore_every:
            factors = [level.photo.factor for level in stage.levels]
            poses = map(level_pose, self._problem.poses(self._best.parameters), factors)
            return tuple(own.cull(pose) for own, pose in zip(renderers, poses, strict=True))
        return renderers

    def _on_level(self, stage: Stage) -> FitProblem:
        """Return the problem on a stage's level of each photo."""
        photos = [level.photo for level in stage.levels]
        if self._problem.loss.has_structure and photos[0].structure is None:
            # Structure of the fine photo is made while the stage before runs.
            photos = [with_structure(photo, is_steep=True) for photo in photos]
        return self._problem.on(photos)

    def _begin_score(self, point: FloatArray, pool: RendererPool, tolerance: float = 0.0) -> None:
        """Start evaluating the loss on the photo itself, beside the search."""
        self._take_score()
        self._evaluations += 1
        if pool.threads > 1 and self._scorer is self._renderer:
            self._scorer = self._renderer.clone() or self._renderer
        parameters = self._problem.complete(point)
        loss = pool.start(partial(pose_loss, self._problem, self._scorer, parameters))
        self._score = lambda: self._keep(point, loss(), tolerance)

    def _take_score(self) -> None:
        """Wait for the score that was begun last, and keep its point if it is better."""
        score, self._score = self._score, None
        if score is not None:
            score()

    def _keep(self, point: FloatArray, loss: float, tolerance: float = 0.0) -> None:
        """Keep a point with its loss on the photo, unless the best one is better."""
        if self._best.start_loss == np.inf:
            self._best = replace(self._best, start_loss=loss)
        if loss < self._best.loss + tolerance:
            parameters = self._problem.complete(point)
            pose = self._problem.chart.to_pose(parameters)
            self._best = replace(self._best, parameters=parameters, pose=pose, loss=loss)

    def _progress(self, stage: Stage, state: State, is_over: bool = False) -> FitProgress:
        problem, limits = self._problem, self._problem.settings.limits
        seconds, status = time.perf_counter() - self._began, Status.RUNNING
        evaluations = self._evaluations + self._evaluations_before
        if evaluations >= limits.evaluations or seconds >= limits.seconds:
            self._take_score()  # no evaluation follows
            is_last = evaluations >= limits.evaluations
            status = Status.EVALUATIONS_SPENT if is_last else Status.SECONDS_SPENT
        if is_over:
            is_seen = self._best.loss < problem.worst_loss
            status = Status.CONVERGED if is_seen else Status.NOTHING_SEEN
        return replace(
            self._best,
            candidates=problem.complete(state.candidates),
            candidate_losses=state.candidate_losses,
            evaluations=evaluations,
            restart=self._restart,
            seconds=seconds,
            status=status,
            factor=stage.levels[0].factor,
        )
