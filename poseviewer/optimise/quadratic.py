"""The end of a search: quadratic models of the loss about its minimum.

There the loss is quadratic but for small jumps where edges of triangles cross pixel centres, which
mislead a simplex. Least squares over more points than coefficients evens them out, and its points
can be evaluated in parallel (cf. M. Powell, *The NEWUOA software*, 2006).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.protocol import Objective, State

OVERSAMPLING = 1.6
"""Points of the first round for each coefficient; later rounds draw one each."""
TRUST_RADIUS = 1.1
"""Longest step, and distance of the points that a model is fitted to, in sampling radii."""
MIN_SHRINKAGE = 0.3
"""Smallest factor by which a sampling radius shrinks in one round, along any axis."""
SLACK = 0.1
"""Rise of the loss at a step's end, of the contour's level, at most: losses have small jumps."""
MIN_CURVATURE = 1e-2
"""Smallest curvature as a share of the largest; smaller ones cannot be told from none."""


@dataclass(frozen=True, slots=True)
class QuadraticOptions:
    """Spread of the samples about the best point, and when the search ends."""

    sampling_radius: float
    """Radius of the first samples, in units of the scale."""
    contour_level: float
    """Loss above the model's minimum of the contour that later samples fill."""
    rounds: int = 6
    """Largest number of models."""
    min_gain: float = 0.02
    """Gain in loss below which a round has not improved anything, and two points are alike: then
    the model's minimum is taken."""
    patience: int = 2
    """Number of rounds in a row without improvement that ends the search."""
    growth: float = 1.0
    """Largest factor by which a sampling radius grows in one round, along any axis."""

    def in_unit(self, unit: float) -> QuadraticOptions:
        """Return the options for losses ``unit`` times as large."""
        level, gain = unit * self.contour_level, unit * self.min_gain
        return replace(self, contour_level=level, min_gain=gain)


def minimise(
    objective: Objective,
    x0: FloatArray,
    scale: FloatArray,
    options: QuadraticOptions,
    seed: int = 0,
) -> Iterator[State]:
    """Fit models about ``x0`` and step to their minima; a round's samples are asked for at once.

    The best point of the last state is the one to take: not always that of the least loss.

    Args:
        objective: function that returns the losses of points.
        x0: (d,), the start.
        scale: (d, d), whose columns are the directions and units of the sampling radius.
        options: options of the samples.
        seed: seed of the random numbers.
    """
    random = np.random.default_rng(seed)
    size = len(x0)
    coefficients = (size + 1) * (size + 2) // 2
    points, losses = np.empty((0, size)), np.empty(0)
    axes, centre = np.array(options.sampling_radius * scale, dtype=float), np.array(x0, dtype=float)
    value = best_before = np.inf
    failures = 0

    def evaluate(samples: Sequence[FloatArray]) -> Iterator[State]:
        nonlocal points, losses
        for point, loss in zip(samples, objective(samples), strict=True):
            points, losses = np.vstack([points, point]), np.append(losses, loss)
            yield state()

    def state() -> State:
        order = np.argsort(losses, kind="stable")[: size + 1]
        least = float(losses[order[0]])
        return State(points[order[0]], least, points[order], losses[order], axes)

    for round_index in range(options.rounds):
        if round_index == 0:
            samples = _draw_in_ball(round(OVERSAMPLING * coefficients), size, random)
            offsets = np.vstack([np.zeros(size), samples])
        else:
            offsets = _draw_in_ball(coefficients, size, random)
        yield from evaluate([centre + axes @ offset for offset in offsets])
        offsets = np.asarray(np.linalg.solve(axes, (points - centre).T).T, dtype=float)
        step, directions, curvatures = _fit_model(offsets, losses, coefficients)
        yield from evaluate([centre + axes @ step])
        best = int(np.argmin(losses))
        is_minimum = losses[-1] <= losses[best] + options.min_gain
        centre, value = (points[-1], losses[-1]) if is_minimum else (points[best], losses[best])
        radii = np.sqrt(2.0 * options.contour_level / curvatures)
        axes = axes @ (directions * np.clip(radii, MIN_SHRINKAGE, options.growth))
        failures = 0 if best_before - losses[best] > options.min_gain else failures + 1
        if failures >= options.patience:
            break
        best_before = losses[best]
    yield replace(state(), best=centre, value=float(value), converged=True)


def step_along(
    objective: Objective, x0: FloatArray, axes: FloatArray, level: float
) -> State | None:
    """Step to the minimum near ``x0`` of a loss whose principal axes are known, by few points.

    Two points on each axis tell its slope and curvature. The state's axes are scaled anew.

    Args:
        objective: function that returns the losses of points.
        x0: (d,), the start.
        axes: (d, d), whose columns are principal axes, as long as to the contour of ``level``.
        level: loss above the minimum of that contour.

    Returns:
        The end; None where the minimum is farther off than the points, or the loss has none.
    """
    offsets = np.vstack([np.zeros(len(x0)), np.eye(len(x0)), -np.eye(len(x0))])
    points = x0 + offsets @ axes.T
    losses = np.array(list(objective(list(points))))
    if not np.isfinite(losses).all():
        return None
    here, ahead, behind = losses[0], *np.reshape(losses[1:], (2, len(x0)))
    curvatures = ahead + behind - 2.0 * here
    if curvatures.min() <= MIN_CURVATURE * curvatures.max():
        return None
    step = 0.5 * (behind - ahead) / curvatures
    end = x0 + axes @ step
    (value,) = objective([end])
    if np.linalg.norm(step) > 1.0 or not value <= here + SLACK * level:
        return None
    radii = np.sqrt(2.0 * level / curvatures)
    return State(end, value, end[None], np.array([value]), axes * radii, converged=True)


def _draw_in_ball(count: int, size: int, random: np.random.Generator) -> FloatArray:
    """Draw points (count, size) evenly in the unit ball."""
    directions = random.normal(size=(count, size))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * random.uniform(size=(count, 1)) ** (1.0 / size)


def _fit_model(
    offsets: FloatArray, losses: FloatArray, coefficients: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a model to the nearest points; returns step, axes (columns) and curvatures."""
    size = offsets.shape[1]
    distances = np.linalg.norm(offsets, axis=1)
    count = max(coefficients + size + 2, int(np.count_nonzero(distances < TRUST_RADIUS)))
    nearest = np.argsort(distances, kind="stable")[:count]
    z, weight = offsets[nearest], np.exp(-0.25 * distances[nearest] ** 2)
    rows, columns = np.triu_indices(size)
    terms = np.hstack([np.ones((len(z), 1)), z, z[:, rows] * z[:, columns]])
    solution, *_ = np.linalg.lstsq(weight[:, None] * terms, weight * losses[nearest], rcond=None)
    slope, hessian = solution[1 : size + 1], np.zeros((size, size))
    hessian[rows, columns] = solution[size + 1 :]
    curvatures, directions = np.linalg.eigh(hessian + hessian.T)
    curvatures = np.abs(curvatures)
    curvatures = np.maximum(curvatures, MIN_CURVATURE * curvatures.max() + 1e-300)
    step = -directions @ ((directions.T @ slope) / curvatures)
    length = float(np.linalg.norm(step))
    return step * min(1.0, TRUST_RADIUS / max(length, 1e-300)), directions, curvatures
