"""The end of a search: quadratic models of the loss about its least value.

Near its minimum the loss is a quadratic function of the numbers, but for what the pixels make of
it: triangles' edges move over pixel centres, and the loss jumps by some hundredths. A simplex
compares single values, so these jumps lead it astray, and its points must be judged one after the
other. A quadratic function fitted to more points than it has coefficients evens them out, and its
points can be judged several at a time (cf. M. Powell, *The NEWUOA software for unconstrained
optimization without derivatives*, 2006, who interpolates).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.cma_es import CloudState

SPARE = 1.6
"""Points of the first round for each coefficient; as many as there are coefficients follow in each
other round: earlier ones nearby count too."""
FARTHEST = 1.1
"""Points that a model is fitted to, in reaches; a step of the search is no longer either."""
LEAST_SHRINKAGE = 0.3
"""Of the reach in one round, along any axis."""
FLATTEST = 1e-2
"""Curvatures below this share of the greatest are not told from none."""


@dataclass(frozen=True, slots=True)
class QuadraticOptions:
    """How far about the best place points are drawn, and when the search is done."""

    reach: float
    """Of the first points, in units that the search is told."""
    rise: float
    """Later points reach to where the model rises by so much above its least value."""
    rounds: int = 6
    """At most so many models are made."""
    least_gain: float = 0.02
    """A round that finds nothing better by more than this has gained nothing. Of two places no
    farther apart in loss the one that the model says is taken."""
    patience: int = 2
    """So many rounds in a row that gain nothing end the search."""


def quadratic_descent(
    objective: Callable[[Sequence[FloatArray]], Iterator[float]],
    start: FloatArray,
    units: FloatArray,
    rules: QuadraticOptions,
    seed: int,
) -> Iterator[CloudState]:
    """Search from ``start`` (d,) along ``units`` (d, d), columns; yields after every evaluation,
    and once more at the end (``converged``), with the place that is taken first.

    ``objective`` gives the losses of points, in their order: all of a round are asked for at once.
    The same arguments give the same search.
    """
    random = np.random.default_rng(seed)
    size = len(start)
    coefficients = (size + 1) * (size + 2) // 2
    points, losses = np.empty((0, size)), np.empty(0)
    axes, centre = np.array(rules.reach * units, dtype=float), np.array(start, dtype=float)
    taken, before, failures = np.inf, np.inf, 0

    def judge(wanted: list[FloatArray]) -> Iterator[CloudState]:
        nonlocal points, losses
        for point, loss in zip(wanted, objective(wanted), strict=True):
            points, losses = np.vstack([points, point]), np.append(losses, loss)
            yield _state(points, losses, axes)

    for turn in range(rules.rounds):
        offsets = _in_ball(coefficients, turn, size, random)
        yield from judge([centre + axes @ offset for offset in offsets])
        places = np.asarray(np.linalg.solve(axes, (points - centre).T).T, dtype=float)
        model = _fit(places, losses, coefficients)
        yield from judge([centre + axes @ model.step])
        best = int(np.argmin(losses))
        said = losses[-1] <= losses[best] + rules.least_gain
        centre, taken = (points[-1], losses[-1]) if said else (points[best], losses[best])
        axes = axes @ (model.directions * model.shrinkage(rules.rise))
        failures = 0 if before - losses[best] > rules.least_gain else failures + 1
        if failures >= rules.patience:
            break
        before = losses[best]
    last = _state(points, losses, axes)
    corners, values = last.vertices.copy(), last.values.copy()
    corners[0], values[0] = centre, taken
    yield CloudState(corners, values, converged=True, axes=axes)


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """A quadratic function, in reaches about the centre."""

    step: FloatArray
    """(d,): to its least value, as far as it is trusted."""
    directions: FloatArray
    """(d, d): columns, the axes of its curvature."""
    curvatures: FloatArray
    """(d,): along them; positive."""

    def shrinkage(self, rise: float) -> FloatArray:
        """(d,): how far it takes to rise so much, in reaches."""
        return np.clip(np.sqrt(2.0 * rise / self.curvatures), LEAST_SHRINKAGE, 1.0)


def _in_ball(
    coefficients: int, turn: int, size: int, random: np.random.Generator
) -> Iterator[FloatArray]:
    """The points of a round, evenly in the unit ball; the first round begins with its centre."""
    count = coefficients
    if turn == 0:
        yield np.zeros(size)
        count = round(SPARE * coefficients)
    directions = random.normal(size=(count, size))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    yield from directions * random.uniform(size=(count, 1)) ** (1.0 / size)


def _fit(offsets: FloatArray, losses: FloatArray, coefficients: int) -> _Model:
    """By least squares to the losses of the nearest of ``offsets`` (n, d); the nearer the more."""
    size = offsets.shape[1]
    far = np.linalg.norm(offsets, axis=1)
    count = max(coefficients + size + 2, int(np.count_nonzero(far < FARTHEST)))
    near = np.argsort(far, kind="stable")[:count]
    z, weight = offsets[near], np.exp(-0.25 * far[near] ** 2)
    rows, columns = np.triu_indices(size)
    terms = np.hstack([np.ones((len(z), 1)), z, z[:, rows] * z[:, columns]])
    found, *_ = np.linalg.lstsq(weight[:, None] * terms, weight * losses[near], rcond=None)
    slope, curvature = found[1 : size + 1], np.zeros((size, size))
    curvature[rows, columns] = found[size + 1 :]
    values, directions = np.linalg.eigh(curvature + curvature.T)
    values = np.maximum(np.abs(values), FLATTEST * np.abs(values).max() + 1e-300)
    step = -directions @ ((directions.T @ slope) / values)
    length = float(np.linalg.norm(step))
    return _Model(step * min(1.0, FARTHEST / max(length, 1e-300)), directions, values)


def _state(points: FloatArray, losses: FloatArray, axes: FloatArray) -> CloudState:
    """The d + 1 best places so far; while there are fewer, the last one stands for the others."""
    size = points.shape[1]
    order = np.argsort(losses, kind="stable")[: size + 1]
    corners, values = points[order], losses[order]
    missing = size + 1 - len(order)
    if missing:
        corners = np.vstack([corners, np.tile(corners[-1], (missing, 1))])
        values = np.append(values, np.full(missing, np.inf))
    return CloudState(corners, values, axes=axes)
