"""Covariance matrix adaptation, for landscapes of many side valleys.

Hansen, *The CMA Evolution Strategy: A Tutorial* (arXiv 1604.00772), with its default parameters and
positive weights.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.state import Objective, State


@dataclass(frozen=True, slots=True)
class CmaOptions:
    """Spread and size of the population, and when it is done. Lengths are in units of the scale."""

    sigma: float = 0.12
    """Standard deviation of the first population."""
    population: int = 32
    generations: int = 60
    nearness: float = 3.0
    """Weight of a quadratic penalty on the distance from the start."""
    least_sigma: float = 3e-3
    """The search ends when the greatest standard deviation is below this."""


def minimise(
    objective: Objective, x0: FloatArray, scale: FloatArray, options: CmaOptions, seed: int = 0
) -> Iterator[State]:
    """Search about ``x0``; a whole generation is asked for at once. Values include the cost of the
    distance; ``axes`` are the distribution's, each as long as its standard deviation.
    """
    distribution = _Distribution(len(x0), options, np.random.default_rng(seed))
    state: State | None = None
    for generation in range(options.generations + 1):
        offsets = distribution.ask() if generation else np.zeros((1, len(x0)))
        points = np.array([x0 + scale @ offset for offset in offsets])
        losses, axes = np.full(len(points), np.inf), scale @ distribution.axes
        for i, loss in enumerate(objective(list(points))):
            losses[i] = loss + options.nearness * float(offsets[i] @ offsets[i])
            order = np.argsort(losses)[: len(x0) + 1]
            near, values = points[order], losses[order]
            state = State(near[0], float(values[0]), near, values, axes).since(state)
            yield state
        if generation:
            distribution.tell(offsets[np.argsort(losses)])
            if distribution.sigma < options.least_sigma:
                break
    assert state is not None  # the start was evaluated
    yield replace(state, axes=scale @ distribution.axes, converged=True)


class _Distribution:
    """N(mean, sigma^2 C), in units of the scale about the start."""

    def __init__(self, size: int, options: CmaOptions, random: np.random.Generator) -> None:
        self._random, self._population, self._size = random, options.population, size
        self._mean, self._covariance = np.zeros(size), np.eye(size)
        self._step = options.sigma
        self._path, self._step_path = np.zeros(size), np.zeros(size)
        self._axes, self._lengths = np.eye(size), np.ones(size)
        self._generation = 0
        better = options.population // 2
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
    def sigma(self) -> float:
        """The greatest standard deviation."""
        return float(self._step * self._lengths.max())

    @property
    def axes(self) -> FloatArray:
        """(d, d): the columns are the principal axes, each as long as its standard deviation."""
        return self._step * self._axes * self._lengths

    def ask(self) -> FloatArray:
        """A population (n, d)."""
        standard = self._random.normal(size=(self._population, self._size))
        return self._mean + self._step * (standard * self._lengths) @ self._axes.T

    def tell(self, ranked: FloatArray) -> None:
        """Adapt to a population (n, d), the best first."""
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
        self._adapt_covariance(steps, mean_step, steady)
        self._step *= float(np.exp(rate / self._damping * (length / self._expected - 1)))

    def _adapt_covariance(self, steps: FloatArray, mean_step: FloatArray, steady: float) -> None:
        """By the path of the mean (rank one) and by the better half (rank mu)."""
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
