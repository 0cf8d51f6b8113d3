"""A fit: numbers of a chart to a pose, to moments, to a loss; and the search over them."""

from __future__ import annotations

import enum
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.fit.chart_choice import choose_chart
from poseviewer.fit.loss import fewest_pixels, registration_loss, worst_registration_loss
from poseviewer.fit.near import FINEST_PIXELS, box_near, inside, working_factor
from poseviewer.fit.paper import paper_loss, paper_stages
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings, Limits, Method
from poseviewer.fit.stages import Scope, Stage, make_stages
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import Chart, OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.optimise.cma_es import CloudState, CmaOptions, evolve
from poseviewer.optimise.nelder_mead import SimplexState
from poseviewer.optimise.quadratic import QuadraticOptions, quadratic_descent
from poseviewer.optimise.restarts import RestartOptions, SearchState, restarted_simplex
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, smaller, structured, with_structure
from poseviewer.render.types import PhotoAttributes, Renderer

OfMany = Callable[[Sequence[FloatArray]], Iterator[float]]
Clouds = Iterator[CloudState]

JUDGED_EVERY = 32
"""After so many evaluations on a sketch, the best of them is judged on the photo."""
ASTRAY = 1.0
"""A search on a finer photo that ends where the loss on the photo is so much greater has left the
valley. On drawn photos the two ends differ by a tenth of it."""


class Status(enum.Enum):
    """How a search stands; the value is a sentence for the user, with what to try."""

    RUNNING = "Searching."
    CONVERGED = "Converged: restarting the search at its minimum no longer improves it."
    EVALUATIONS_SPENT = (
        "Stopped at the limit of evaluations: the best pose so far is kept; "
        "fit again from it, or raise --evaluations."
    )
    SECONDS_SPENT = (
        "Stopped at the time limit: the best pose so far is kept; "
        "fit again from it, or raise --seconds."
    )
    STOPPED = "Stopped by the user: the best pose so far is kept; fit again from it to go on."
    NOTHING_SEEN = (
        "No pose near the start shows enough of the model in the region: "
        "bring the start closer, or widen the region."
    )


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """All that a search needs but a renderer; nothing in it changes."""

    photo: PhotoAttributes
    chart: Chart
    start: FloatArray
    """(d,): the chart's numbers of the start pose."""
    free: tuple[bool, ...] = ()
    """(d,): which numbers the search may change; empty: all."""
    rules: RestartOptions = field(default_factory=RestartOptions)
    limits: Limits = field(default_factory=Limits)
    seed: int = 0
    method: Method = "default"
    """How poses are judged and searched for: ours, or as in ``fit.paper``."""
    finer: PhotoAttributes | None = None
    """The photo made less small, without structure: a search ends on it. None: on ``photo``."""
    scope: Scope = "usual"
    """How far about the start to look."""
    free_indices: NDArray[np.intp] = field(init=False, repr=False)
    """The indices of the free numbers."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen_array(self.start, (len(self.chart.names),)))
        if not self.free:
            object.__setattr__(self, "free", (True,) * len(self.start))
        if len(self.free) != len(self.start) or not any(self.free):
            raise ValueError("`free` must name each number of the chart, and free one at least")
        object.__setattr__(self, "free_indices", np.flatnonzero(self.free))

    @property
    def worst_loss(self) -> float:
        """What numbers cost that show nothing of the model, or stand for no pose."""
        return worst_registration_loss(self.photo)

    def complete(self, free_numbers: FloatArray) -> FloatArray:
        """(..., d): the start's numbers with the free ones replaced by (..., k)."""
        parameters = np.empty((*free_numbers.shape[:-1], len(self.start)))
        parameters[...] = self.start
        parameters[..., self.free_indices] = free_numbers
        return parameters


@dataclass(frozen=True, slots=True, eq=False)
class FitProgress:
    """A search after one more evaluation: the best so far, and where it is looking.

    ``numbers``, ``pose`` and the losses are judged on the photo itself, whatever the level that
    the simplex is on.
    """

    parameters: FloatArray
    """(d,): the best numbers, in the problem's chart."""
    pose: Pose
    loss: float
    start_loss: float
    simplex: FloatArray
    """(k + 1, d): the corners of the simplex, the best first."""
    simplex_losses: FloatArray
    """(k + 1,): on the simplex's level; infinite for corners not yet evaluated."""
    evaluations: int
    """On all levels."""
    restart: int
    seconds: float
    status: Status
    factor: int = 1
    """How many times smaller the photo is that the simplex is on."""
    verdict: Verdict | None = None
    """Of the last one of a ``judged_fit``: whether the pose is right."""


def pose_loss(problem: FitProblem, renderer: Renderer, parameters: FloatArray) -> float:
    """The loss at the chart's ``numbers`` (d,); numbers that stand for no pose cost the most."""
    return _loss(problem, problem.photo, renderer, parameters)


def _loss(
    problem: FitProblem, photo: PhotoAttributes, renderer: Renderer, parameters: FloatArray
) -> float:
    try:
        pose = problem.chart.to_pose(parameters)
    except OutsideChartError:
        return problem.worst_loss
    moments = renderer.moments(pose, photo)
    if problem.method == "paper":
        return paper_loss(moments, photo.clipped)
    return registration_loss(moments)


def fit_pose(problem: FitProblem, renderer: Renderer, threads: int = 1) -> Iterator[FitProgress]:
    """Search from the problem's start, coarse to fine; yields after every evaluation, the outcome
    last.

    To stop it, stop asking. Deterministic but for ``Limits.seconds``: also, poses that are judged
    on several ``threads`` at a time, where the search knows several, are the same ones.
    """
    for progress in _Search(problem, renderer, threads).run():
        yield progress
        if progress.status is not Status.RUNNING:
            return


def stages_of(problem: FitProblem, renderer: Renderer, start: Pose) -> tuple[Stage, ...]:
    """The stages that a search from ``start`` goes through."""
    if problem.method == "paper":
        return paper_stages(problem.photo, renderer, problem.rules)
    photo, rules = problem.photo, problem.rules
    return make_stages(photo, renderer, start, rules, problem.finer, problem.scope)


class _Search:
    """A search under way: what has been spent, and the best pose on the photo itself."""

    def __init__(self, problem: FitProblem, renderer: Renderer, threads: int) -> None:
        self._problem, self._threads = problem, threads
        self._photo = Level(1, problem.photo, renderer)
        self._began = time.perf_counter()
        self._evaluations, self._restart = 0, 0
        self._start_loss, self._loss = np.inf, np.inf
        self._best = problem.start[problem.free_indices]
        self._spans = problem.chart.scales(problem.start)[problem.free_indices]
        self._units = np.diag(self._spans)
        self._numbers, self._pose = problem.start, problem.chart.to_pose(problem.start)

    def run(self) -> Iterator[FitProgress]:
        """Progress after every evaluation, and once more at the end of every descent."""
        problem = self._problem
        renderer = self._photo.renderer
        stages = stages_of(problem, renderer, self._pose)
        for stage in stages:
            if stage.on == "a finer photo":
                yield from self._closer(stage)
            elif stage.on == "the photo":
                yield from self._on_the_photo(stage, stage is stages[-1])
            else:
                yield from self._coarsely(stage)
            self._restart += 1

    def _on_the_photo(self, stage: Stage, is_last: bool) -> Iterator[FitProgress]:
        for state in self._states(stage):
            self._consider(state.best, state.value)
            ends = is_last or self._loss >= self._problem.worst_loss
            yield self._progress(state.simplex, 1, state.finished and ends)

    def _coarsely(self, stage: Stage) -> Iterator[FitProgress]:
        """Losses of two levels cannot be compared: the best pose of this one is judged on the
        photo every now and then.
        """
        factor, judge = stage.level.factor, self._objective(self._photo)
        corners = np.tile(self._best, (len(self._best) + 1, 1))
        simplex = SimplexState(corners, np.full(len(corners), np.inf))
        judged, due = self._best, JUDGED_EVERY
        self._consider(judged, judge(judged))
        yield self._progress(simplex, factor)
        for state in self._states(stage):
            yield self._progress(state.simplex, factor)
            is_due = state.simplex.converged or self._evaluations >= due
            if is_due and not np.array_equal(state.best, judged):
                judged, due = state.best, self._evaluations + JUDGED_EVERY
                self._consider(judged, judge(judged))
                yield self._progress(state.simplex, factor)

    def _closer(self, stage: Stage) -> Iterator[FitProgress]:
        """On a finer photo, whose word counts: its least loss is taken, though on the photo it
        costs a little more. Where it costs much more the search has gone astray, and is forgotten.
        """
        # Only now, as most searches of a short limit never come here.
        level = replace(stage.level, photo=with_structure(stage.level.photo, is_steep=True))
        for state in self._states(replace(stage, level=level)):
            if state.finished:
                loss = self._objective(self._photo)(state.best)
                if loss <= self._loss + ASTRAY:
                    self._loss = np.inf
                    self._consider(state.best, loss)
            yield self._progress(state.simplex, 1, state.finished)

    def _states(self, stage: Stage) -> Iterator[SearchState]:
        problem, before, rules = self._problem, self._restart, stage.rules
        if not isinstance(rules, RestartOptions):
            with RendererPool(stage.level.renderer, self._threads) as pool:
                objective = self._of_many(stage.level.photo, pool)
                for cloud in self._clouds(rules, objective):
                    self._units = cloud.axes
                    best, value = cloud.vertices[0], float(cloud.values[0])
                    yield SearchState(best, value, cloud, before, cloud.converged)
            return
        search = self._best, self._units, rules, problem.seed
        for state in restarted_simplex(self._objective(stage.level), *search):
            self._restart = before + state.restart
            yield state

    def _clouds(self, rules: CmaOptions | QuadraticOptions, objective: OfMany) -> Clouds:
        best, seed = self._best, self._problem.seed
        if isinstance(rules, CmaOptions):
            return evolve(objective, best, self._spans, rules, seed)
        return quadratic_descent(objective, best, self._units, rules, seed)

    def _objective(self, level: Level) -> Callable[[FloatArray], float]:
        problem = self._problem

        def objective(free_numbers: FloatArray) -> float:
            self._evaluations += 1
            parameters = problem.complete(free_numbers)
            return _loss(problem, level.photo, level.renderer, parameters)

        return objective

    def _of_many(self, photo: PhotoAttributes, pool: RendererPool) -> OfMany:
        problem = self._problem

        def loss(renderer: Renderer, parameters: FloatArray) -> float:
            return _loss(problem, photo, renderer, parameters)

        def objective(points: Sequence[FloatArray]) -> Iterator[float]:
            for found in pool.map(loss, [problem.complete(point) for point in points]):
                self._evaluations += 1
                yield found

        return objective

    def _consider(self, free_numbers: FloatArray, loss: float) -> None:
        """Keep the numbers if there is nothing better; ``loss`` is on the photo."""
        if self._start_loss == np.inf:
            self._start_loss = loss
        if loss < self._loss:
            self._best, self._loss = free_numbers, loss
            self._numbers = self._problem.complete(free_numbers)
            self._pose = self._problem.chart.to_pose(self._numbers)

    def _progress(self, simplex: SimplexState, factor: int, finished: bool = False) -> FitProgress:
        seconds = time.perf_counter() - self._began
        return FitProgress(
            parameters=self._numbers,
            pose=self._pose,
            loss=self._loss,
            start_loss=self._start_loss,
            simplex=self._problem.complete(simplex.vertices),
            simplex_losses=simplex.values,
            evaluations=self._evaluations,
            restart=self._restart,
            seconds=seconds,
            status=self._status(seconds, finished),
            factor=factor,
        )

    def _status(self, seconds: float, finished: bool) -> Status:
        problem = self._problem
        if finished:
            seen = self._loss < problem.worst_loss
            return Status.CONVERGED if seen else Status.NOTHING_SEEN
        if self._evaluations >= problem.limits.evaluations:
            return Status.EVALUATIONS_SPENT
        if seconds >= problem.limits.seconds:
            return Status.SECONDS_SPENT
        return Status.RUNNING


LEAST_COLOUR = 0.02
"""Standard deviation, across the photo's own main line of colour, from which on it has colours:
5 grey levels of 255. Sensor noise has 1 or 2; the real photos we know have 10 and more."""


def make_photo_attributes(
    photo: Photo,
    mesh: Mesh,
    start: Pose,
    settings: FitSettings,
    mask: NDArray[np.float32] | None = None,
) -> PhotoAttributes:
    """F and P of a photo; ``mask`` (height, width) weighs its pixels.

    Raises:
        SettingsError: the region lies outside the photo, has no pixel near the start, or fewer
            than a fit needs.
    """
    plain = _plain_attributes(photo, mesh, start, settings, mask)
    return _as_compared(plain, photo.name, mesh, start, settings)


def _as_compared(
    plain: PhotoAttributes, name: str, mesh: Mesh, start: Pose, settings: FitSettings
) -> PhotoAttributes:
    found = plain
    if not plain.clipped and settings.method == "default":
        found = structured(plain, working_factor(mesh, start))
    wanted = fewest_pixels(found.photo_channels + found.model_channels)
    if np.count_nonzero(plain.weights) < wanted:
        raise SettingsError(
            f"{name}: {np.count_nonzero(plain.weights)} pixels count, and a fit needs at least "
            f"{wanted}; use a larger photo or region"
        )
    return found


def _finer(
    plain: PhotoAttributes, mesh: Mesh, start: Pose, settings: FitSettings
) -> PhotoAttributes | None:
    """What a search ends on, if that is finer than what it goes through."""
    if plain.clipped or settings.method == "paper":
        return None
    factor = working_factor(mesh, start, FINEST_PIXELS)
    if factor >= working_factor(mesh, start):
        return None
    return smaller(plain, factor)


def _plain_attributes(
    photo: Photo,
    mesh: Mesh,
    start: Pose,
    settings: FitSettings,
    mask: NDArray[np.float32] | None = None,
) -> PhotoAttributes:
    """F and P before the photo is made smaller and told apart."""
    weights = np.ones((photo.height, photo.width), np.float32) if mask is None else mask
    if photo.covered is not None:
        weights = weights * photo.covered
    if settings.region is not None:
        weights = weights * _rectangle(photo, settings.region)
    if settings.pixels == "near" and np.any(weights > 0.0):
        weights = weights * inside((photo.height, photo.width), box_near(mesh, start))
        if not np.any(weights > 0.0):
            raise SettingsError(
                "no pixel that counts lies near the start pose: bring the start onto the photo "
                "and the region, or use --pixels whole"
            )
    clipped = settings.pixels == "clip"
    coloured = not settings.grey and _has_colour(photo, weights)
    channels = photo.as_float() if coloured else photo.grey()[..., None]
    return PhotoAttributes(channels, weights, clipped, settings.colour_reflectance)


def make_problem(
    registration: Registration, settings: FitSettings, mask: NDArray[np.float32] | None = None
) -> tuple[FitProblem, str]:
    """The problem of fitting from the start pose, and a note on the chart ("" if none is due).

    Raises:
        SettingsError: the settings do not go with the photo or the model.
        SingularChartError: the wanted chart has no numbers at the start pose.
    """
    pose = registration.start
    chart, note = choose_chart(
        settings.chart, registration.mesh, registration.keypoints, pose, settings.free_focal
    )
    unknown = set(settings.lock) - set(chart.names)
    if unknown:
        raise SettingsError(
            f"--lock {sorted(unknown)[0]}: the {chart.name} chart has no such number; "
            f"it has {', '.join(chart.names)}"
        )
    free = tuple(name not in settings.lock for name in chart.names)
    if not any(free):
        raise SettingsError("--lock holds every number of the chart; leave one free at least")
    mesh = registration.mesh
    plain = _plain_attributes(registration.photo, mesh, pose, settings, mask)
    problem = FitProblem(
        _as_compared(plain, registration.photo.name, mesh, pose, settings),
        chart,
        chart.from_pose(pose),
        free,
        settings.rules,
        settings.limits,
        settings.seed,
        settings.method,
        _finer(plain, mesh, pose, settings),
    )
    return problem, note


def shown_attributes(photo: PhotoAttributes) -> PhotoAttributes:
    """The attributes by which a pose is shown relit: the model's own pixels, and all its colours.

    The search may look at less, or at more, than what the light on the model is best judged by.
    """
    coloured = photo.channels.shape[2] == 3
    return replace(photo, clipped=True, colour_reflectance=coloured, structure=None)


def _has_colour(photo: Photo, weights: NDArray[np.float32]) -> bool:
    """Whether the colours of the pixels that count leave a line in RGB by more than noise.

    The loss takes every channel for as good as any other, whatever its range: beside a grey scene
    it would weigh the noise of its colours.
    """
    if photo.pixels.shape[2] == 1:
        return False
    colours = photo.pixels[weights > 0.0] / np.iinfo(photo.pixels.dtype).max
    if len(colours) < 2:
        return False
    variances = np.linalg.eigvalsh(np.cov(colours.T))
    return bool(variances[1] > LEAST_COLOUR**2)


def _rectangle(photo: Photo, region: Rectangle) -> NDArray[np.float32]:
    left, top, width, height = region
    found = inside((photo.height, photo.width), (left, top, left + width, top + height))
    if not found.any():
        raise SettingsError(
            f"--region {left},{top},{width},{height} has no pixel in the photo of "
            f"{photo.width}x{photo.height} px; give left,top,width,height in px"
        )
    return found
