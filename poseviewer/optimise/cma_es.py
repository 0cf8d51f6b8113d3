"""Covariance matrix adaptation: a search that finds its way among many side valleys.

Hansen, *The CMA Evolution Strategy: A Tutorial* (arXiv 1604.00772), with its default parameters: a
cloud of points is drawn from a normal distribution, whose mean and covariance then follow the
better half of them. A simplex sees what is around it; the cloud sees the shape of the landscape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.nelder_mead import SimplexState


@dataclass(frozen=True, slots=True)
class CmaOptions:
    """How wide the cloud is at first, how many points it has, and when it is done."""

    width: float = 0.12
    """Standard deviation at the start, in units of each number's span."""
    points: int = 32
    """Of a generation."""
    generations: int = 60
    nearness: float = 3.0
    """What the square of the distance from the start costs, in the same units, while the cloud
    moves: of two places that look alike the nearer one is meant."""
    least_width: float = 3e-3
    """The search is done when the cloud is this narrow in every direction, in the same units."""


@dataclass(frozen=True, slots=True, eq=False)
class CloudState(SimplexState):
    """The search after one more evaluation: the d + 1 best points of the generation so far, the
    best of all first.
    """

    axes: FloatArray = field(kw_only=True)
    """(d, d): the columns are the principal axes of the cloud that the points are drawn from, each
    as long as its standard deviation, in the numbers' own units. A cloud that has settled has the
    shape of the valley it lies in."""


def evolve(
    objective: Callable[[Sequence[FloatArray]], Iterator[float]],
    start: FloatArray,
    scales: FloatArray,
    rules: CmaOptions,
    seed: int,
) -> Iterator[CloudState]:
    """Search from ``start`` (d,); yields after every evaluation, and once more at the end
    (``converged``).

    ``objective`` gives the losses of points, in their order: a whole generation is asked for at
    once, so that several can be judged at a time. The same arguments give the same search.
    """
    size = len(start)
    cloud = _Cloud(size, rules, np.random.default_rng(seed))

    def judged(offsets: FloatArray) -> Iterator[float]:
        losses = objective([start + scales * offset for offset in offsets])
        for offset, loss in zip(offsets, losses, strict=True):
            yield loss + rules.nearness * float(offset @ offset)

    (value,) = judged(np.zeros((1, size)))
    best = start
    corners = np.tile(start, (size + 1, 1))
    values = np.full(size + 1, np.inf)
    values[0] = value
    axes = scales[:, None] * cloud.axes
    yield CloudState(corners.copy(), values.copy(), axes=axes)
    for _ in range(rules.generations):
        offsets = cloud.draw()
        losses = np.full(len(offsets), np.inf)
        for index, loss in enumerate(judged(offsets)):
            losses[index] = loss
            if loss < value:
                best, value = start + scales * offsets[index], loss
            order = np.argsort(losses)[:size]
            corners[0], corners[1:] = best, start + scales * offsets[order]
            values[0], values[1:] = value, losses[order]
            yield CloudState(corners.copy(), values.copy(), axes=axes)
        cloud.follow(offsets[np.argsort(losses)])
        axes = scales[:, None] * cloud.axes
        if cloud.width < rules.least_width:
            break
    yield CloudState(corners.copy(), values.copy(), converged=True, axes=axes)


class _Cloud:
    """The normal distribution: N(mean, width^2 C), in units of the spans about the start."""

    def __init__(self, size: int, rules: CmaOptions, random: np.random.Generator) -> None:
        self._random, self._points, self._size = random, rules.points, size
        self._mean, self._covariance = np.zeros(size), np.eye(size)
        self._step = rules.width
        self._path, self._step_path = np.zeros(size), np.zeros(size)
        self._axes, self._lengths = np.eye(size), np.ones(size)
        self._generation = 0
        better = rules.points // 2
        weights = np.log(better + 0.5) - np.log(np.arange(1, better + 1))
        self._weights = weights / weights.sum()
        mass = self._mass = 1.0 / float(np.sum(self._weights**2))
        self._path_rate = (4 + mass / size) / (size + 4 + 2 * mass / size)
        self._step_rate = (mass + 2) / (size + mass + 5)
        self._one_rate = 2 / ((size + 1.3) ** 2 + mass)
        self._many_rate = min(
            1 - self._one_rate, 2 * (mass - 2 + 1 / mass) / ((size + 2) ** 2 + mass)
        )
        damping = 2 * max(0.0, np.sqrt((mass - 1) / (size + 1)) - 1)
        self._damping = 1 + damping + self._step_rate
        # The mean length of a standard normal vector.
        self._expected = np.sqrt(size) * (1 - 1 / (4 * size) + 1 / (21 * size**2))

    @property
    def width(self) -> float:
        """The greatest standard deviation."""
        return float(self._step * self._lengths.max())

    @property
    def axes(self) -> FloatArray:
        """(d, d): the columns are the principal axes, each as long as its standard deviation."""
        return self._step * self._axes * self._lengths

    def draw(self) -> FloatArray:
        """(points, d)."""
        standard = self._random.normal(size=(self._points, self._size))
        return self._mean + self._step * (standard * self._lengths) @ self._axes.T

    def follow(self, ranked: FloatArray) -> None:
        """Adapt to a generation (points, d), the best first."""
        self._generation += 1
        steps = (ranked[: len(self._weights)] - self._mean) / self._step
        mean_step = self._weights @ steps
        self._mean = self._mean + self._step * mean_step
        rate = self._step_rate
        whitened = self._axes @ ((self._axes.T @ mean_step) / self._lengths)
        self._step_path = (1 - rate) * self._step_path
        self._step_path = self._step_path + np.sqrt(rate * (2 - rate) * self._mass) * whitened
        length = float(np.linalg.norm(self._step_path))
        fresh = np.sqrt(1 - (1 - rate) ** (2 * self._generation))
        steady = float(length / fresh < (1.4 + 2 / (self._size + 1)) * self._expected)
        self._learn(steps, mean_step, steady)
        self._step *= float(np.exp(rate / self._damping * (length / self._expected - 1)))

    def _learn(self, steps: FloatArray, mean_step: FloatArray, steady: float) -> None:
        """The covariance, by the path of the mean (rank one) and by the better half (rank mu)."""
        rate, one, many = self._path_rate, self._one_rate, self._many_rate
        self._path = (1 - rate) * self._path
        self._path = self._path + steady * np.sqrt(rate * (2 - rate) * self._mass) * mean_step
        lost = (1 - steady) * rate * (2 - rate)
        self._covariance = (
            (1 - one - many + one * lost) * self._covariance
            + one * np.outer(self._path, self._path)
            + many * (steps.T * self._weights) @ steps
        )
        values, self._axes = np.linalg.eigh(self._covariance)
        self._lengths = np.sqrt(np.maximum(values, 1e-20))
