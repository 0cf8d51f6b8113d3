"""A fit: numbers of a chart to a pose, to moments, to a loss; and the search over them."""

from __future__ import annotations

import enum
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.restarts import RestartRules, SearchState, restarted_simplex
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import Chart, OutsideChartError
from poseviewer.render.attributes import Renderer
from poseviewer.render.moments import PhotoAttributes


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


@dataclass(frozen=True, slots=True)
class Limits:
    """When to stop a search that still improves."""

    evaluations: int = 20_000
    seconds: float = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class FitProblem:
    """All that a search needs but a renderer; nothing in it changes."""

    photo: PhotoAttributes
    chart: Chart
    start: FloatArray
    """(d,): the chart's numbers of the start pose."""
    free: tuple[bool, ...] = ()
    """(d,): which numbers the search may change; empty: all."""
    rules: RestartRules = field(default_factory=RestartRules)
    limits: Limits = field(default_factory=Limits)
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", frozen_array(self.start, (len(self.chart.names),)))
        if not self.free:
            object.__setattr__(self, "free", (True,) * len(self.start))
        if len(self.free) != len(self.start) or not any(self.free):
            raise ValueError("`free` must name each number of the chart, and free one at least")

    @property
    def free_indices(self) -> NDArray[np.intp]:
        """The indices of the free numbers."""
        return np.flatnonzero(self.free)

    def complete(self, free_numbers: FloatArray) -> FloatArray:
        """(d,): the start's numbers with the free ones replaced."""
        numbers = self.start.copy()
        numbers[self.free_indices] = free_numbers
        return numbers


@dataclass(frozen=True, slots=True, eq=False)
class FitProgress:
    """A search after one more evaluation: the best so far, and where it is looking."""

    numbers: FloatArray
    """(d,): the best numbers, in the problem's chart."""
    pose: Pose
    loss: float
    start_loss: float
    simplex: FloatArray
    """(k + 1, d): the corners of the simplex, the best first."""
    simplex_losses: FloatArray
    """(k + 1,): infinite for corners not yet evaluated."""
    evaluations: int
    restart: int
    seconds: float
    status: Status


def pose_loss(problem: FitProblem, renderer: Renderer, numbers: FloatArray) -> float:
    """The loss at the chart's ``numbers`` (d,); numbers that stand for no pose cost the most."""
    try:
        pose = problem.chart.to_pose(numbers)
    except OutsideChartError:
        return float(min(problem.photo.channels.shape[2], problem.photo.model_channels))
    return lighting_loss(renderer.moments(pose, problem.photo))


def fit_pose(problem: FitProblem, renderer: Renderer) -> Iterator[FitProgress]:
    """Search from the problem's start; yields after every evaluation, the outcome last.

    To stop it, stop asking. Deterministic but for ``Limits.seconds``.
    """
    indices = problem.free_indices
    spans = problem.chart.spans(problem.start)[indices]
    began = time.perf_counter()
    losses: list[float] = []

    def objective(free_numbers: FloatArray) -> float:
        losses.append(pose_loss(problem, renderer, problem.complete(free_numbers)))
        return losses[-1]

    reporter = _Reporter(problem)
    for state in restarted_simplex(
        objective, problem.start[indices], spans, problem.rules, problem.seed
    ):
        seconds = time.perf_counter() - began
        status = _status(problem, state, losses, seconds)
        yield reporter.progress(state, losses, seconds, status)
        if status is not Status.RUNNING:
            return


def _status(problem: FitProblem, state: SearchState, losses: list[float], seconds: float) -> Status:
    if state.finished:
        worst = float(min(problem.photo.channels.shape[2], problem.photo.model_channels))
        return Status.NOTHING_SEEN if state.value >= worst else Status.CONVERGED
    if len(losses) >= problem.limits.evaluations:
        return Status.EVALUATIONS_SPENT
    if seconds >= problem.limits.seconds:
        return Status.SECONDS_SPENT
    return Status.RUNNING


class _Reporter:
    """Turns states of the search into progress; works out the best pose only when it changes."""

    def __init__(self, problem: FitProblem) -> None:
        self._problem = problem
        self._best: FloatArray | None = None
        self._pose: Pose | None = None

    def progress(
        self, state: SearchState, losses: list[float], seconds: float, status: Status
    ) -> FitProgress:
        problem = self._problem
        if self._pose is None or self._best is None or not np.array_equal(state.best, self._best):
            self._best = state.best
            self._pose = problem.chart.to_pose(problem.complete(state.best))
        simplex = np.array([problem.complete(v) for v in state.simplex.vertices])
        return FitProgress(
            numbers=problem.complete(self._best),
            pose=self._pose,
            loss=state.value,
            start_loss=losses[0],
            simplex=simplex,
            simplex_losses=state.simplex.values,
            evaluations=len(losses),
            restart=state.restart,
            seconds=seconds,
            status=status,
        )
