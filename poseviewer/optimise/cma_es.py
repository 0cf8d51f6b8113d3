"""Covariance matrix adaptation, for landscapes of many side valleys.

Symbols and numbers of equations are those of N. Hansen, *The CMA Evolution Strategy: A Tutorial*
(arXiv 1604.00772), whose default parameters are taken, without negative weights.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.protocol import Objective, State


@dataclass(frozen=True, slots=True)
class CmaOptions:
    """Spread and size of the population, and when the search ends, in units of the scale."""

    sigma: float = 0.12
    """Standard deviation of the first population."""
    population: int = 32
    """lambda, the points of a generation."""
    generations: int = 60
    prior_weight: float = 3.0
    """Weight of a quadratic penalty on the distance from the start."""
    min_sigma: float = 3e-3
    """The search ends when the largest standard deviation is below this."""

    def in_unit(self, unit: float) -> CmaOptions:
        """Return the options for losses ``unit`` times as large."""
        return replace(self, prior_weight=unit * self.prior_weight)


def minimise(
    objective: Objective, x0: FloatArray, scale: FloatArray, options: CmaOptions, seed: int = 0
) -> Iterator[State]:
    """Search about ``x0``; a whole generation is asked for at once.

    Values of states include the penalty; their axes are those of the distribution, each as long as
    its standard deviation.

    Args:
        objective: function that returns the losses of points.
        x0: (d,), the start.
        scale: (d, d), whose columns are the directions and units of the options' lengths.
        options: options of the population.
        seed: seed of the random numbers.
    """
    distribution = _Distribution(len(x0), options, np.random.default_rng(seed))
    state: State | None = None
    for generation in range(options.generations + 1):
        offsets = distribution.ask() if generation else np.zeros((1, len(x0)))
        points = np.array([x0 + scale @ offset for offset in offsets])
        losses, axes = np.full(len(points), np.inf), scale @ distribution.axes
        for i, loss in enumerate(objective(list(points))):
            losses[i] = loss + options.prior_weight * float(offsets[i] @ offsets[i])
            order = np.argsort(losses)[: len(x0) + 1]
            best, values = points[order], losses[order]
            state = State(best[0], float(values[0]), best, values, axes).since(state)
            yield state
        if generation:
            distribution.tell(offsets[np.argsort(losses)])
            if distribution.max_sigma < options.min_sigma:
                break
    assert state is not None  # the start was evaluated
    yield replace(state, axes=scale @ distribution.axes, converged=True)


class _Distribution:
    """N(m, sigma^2 C), in units of the scale about the start."""

    def __init__(self, n: int, options: CmaOptions, random: np.random.Generator) -> None:
        self._random, self._n = random, n
        self._lambda, self._sigma = options.population, options.sigma
        self._m, self._C = np.zeros(n), np.eye(n)
        self._B, self._D = np.eye(n), np.ones(n)  # C = B D^2 B^T
        self._p_c, self._p_sigma = np.zeros(n), np.zeros(n)
        self._g = 0
        mu = options.population // 2
        weights = np.log(mu + 0.5) - np.log(np.arange(1, mu + 1))  # (49)
        self._w = weights / weights.sum()  # (53)
        mu_eff = self._mu_eff = 1.0 / float(np.sum(self._w**2))  # (8)
        self._c_sigma = (mu_eff + 2) / (n + mu_eff + 5)  # (55)
        excess = 2 * max(0.0, np.sqrt((mu_eff - 1) / (n + 1)) - 1)
        self._d_sigma = 1 + excess + self._c_sigma  # (55)
        self._c_c = (4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n)  # (56)
        self._c_1 = 2 / ((n + 1.3) ** 2 + mu_eff)  # (57)
        c_mu = 2 * (mu_eff - 2 + 1 / mu_eff) / ((n + 2) ** 2 + mu_eff)
        self._c_mu = min(1 - self._c_1, c_mu)  # (58)
        self._chi_n = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))  # E||N(0, I)||

    @property
    def max_sigma(self) -> float:
        """Largest standard deviation along any direction."""
        return float(self._sigma * self._D.max())

    @property
    def axes(self) -> FloatArray:
        """(d, d): principal axes as columns, each as long as its standard deviation."""
        return self._sigma * self._B * self._D

    def ask(self) -> FloatArray:
        """Draw a population (lambda, d)."""
        z = self._random.normal(size=(self._lambda, self._n))  # (38)
        return self._m + self._sigma * (z * self._D) @ self._B.T  # (39), (40)

    def tell(self, ranked: FloatArray) -> None:
        """Adapt to a population (lambda, d), the best first."""
        self._g += 1
        y = (ranked[: len(self._w)] - self._m) / self._sigma
        y_w = self._w @ y  # (41)
        self._m = self._m + self._sigma * y_w  # (42)
        c_sigma = self._c_sigma
        whitened = self._B @ ((self._B.T @ y_w) / self._D)  # C^(-1/2) y_w
        self._p_sigma = (1 - c_sigma) * self._p_sigma
        self._p_sigma = self._p_sigma + np.sqrt(c_sigma * (2 - c_sigma) * self._mu_eff) * whitened
        length = float(np.linalg.norm(self._p_sigma))  # of (43)
        unbiased = length / np.sqrt(1 - (1 - c_sigma) ** (2 * self._g))
        h_sigma = float(unbiased < (1.4 + 2 / (self._n + 1)) * self._chi_n)
        self._adapt_covariance(y, y_w, h_sigma)
        self._sigma *= float(np.exp(c_sigma / self._d_sigma * (length / self._chi_n - 1)))  # (44)

    def _adapt_covariance(self, y: FloatArray, y_w: FloatArray, h_sigma: float) -> None:
        """Adapt C to the path of the mean (rank one) and to the better half (rank mu)."""
        c_c, c_1 = self._c_c, self._c_1
        self._p_c = (1 - c_c) * self._p_c
        self._p_c = self._p_c + h_sigma * np.sqrt(c_c * (2 - c_c) * self._mu_eff) * y_w  # (45)
        delta = (1 - h_sigma) * c_c * (2 - c_c)
        self._C = (
            (1 - c_1 - self._c_mu + c_1 * delta) * self._C
            + c_1 * np.outer(self._p_c, self._p_c)
            + self._c_mu * (y.T * self._w) @ y
        )  # (47)
        variances, self._B = np.linalg.eigh(self._C)
        self._D = np.sqrt(np.maximum(variances, 1e-20))
