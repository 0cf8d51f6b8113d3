"""The end of a search: quadratic models of the loss about its minimum.

There the loss is quadratic but for small jumps where edges of triangles cross pixel centres, which
mislead a simplex. Least squares over more points than coefficients evens them out, and its points
can be evaluated in parallel (cf. M. Powell, *The NEWUOA software*, 2006).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.state import Objective, State

OVERSAMPLING = 1.6
"""Points of the first round for each coefficient; later rounds draw one each."""
TRUST_RADIUS = 1.1
"""Points that a model is fitted to, and its step, are no farther away, in reaches."""
MIN_SHRINKAGE = 0.3
"""Least factor by which the reach shrinks in one round, along any axis."""
MIN_CURVATURE = 1e-2
"""Least curvature as a share of the greatest; smaller ones cannot be told from none."""


@dataclass(frozen=True, slots=True)
class QuadraticOptions:
    """Reach of the samples about the best point, and when the search is done."""

    reach: float
    """Reach of the first samples, in units of the scale."""
    rise: float
    """Later samples reach to where the model rises by this above its minimum."""
    rounds: int = 6
    """Greatest number of models."""
    least_gain: float = 0.02
    """A round that gains less has not improved anything. Of two points no farther apart in loss the
    model's minimum is taken."""
    patience: int = 2
    """Number of rounds in a row without improvement that ends the search."""
    growth: float = 1.0
    """Greatest factor by which the reach grows in one round, along any axis."""


def minimise(
    objective: Objective,
    x0: FloatArray,
    scale: FloatArray,
    options: QuadraticOptions,
    seed: int = 0,
) -> Iterator[State]:
    """Fit models about ``x0`` and step to their minima; a round's samples are asked for at once.

    The best point of the last state is the one that is taken: not always that of the least loss.
    """
    random = np.random.default_rng(seed)
    size = len(x0)
    coefficients = (size + 1) * (size + 2) // 2
    points, losses = np.empty((0, size)), np.empty(0)
    axes, centre = np.array(options.reach * scale, dtype=float), np.array(x0, dtype=float)
    taken, before, failures = np.inf, np.inf, 0

    def evaluate(samples: Sequence[FloatArray]) -> Iterator[State]:
        nonlocal points, losses
        for point, loss in zip(samples, objective(samples), strict=True):
            points, losses = np.vstack([points, point]), np.append(losses, loss)
            yield state()

    def state() -> State:
        order = np.argsort(losses, kind="stable")[: size + 1]
        value = float(losses[order[0]])
        return State(points[order[0]], value, points[order], losses[order], axes)

    for turn in range(options.rounds):
        if turn == 0:
            first = _in_ball(round(OVERSAMPLING * coefficients), size, random)
            offsets = np.vstack([np.zeros(size), first])
        else:
            offsets = _in_ball(coefficients, size, random)
        yield from evaluate([centre + axes @ offset for offset in offsets])
        offsets = np.asarray(np.linalg.solve(axes, (points - centre).T).T, dtype=float)
        step, directions, curvatures = _fit(offsets, losses, coefficients)
        yield from evaluate([centre + axes @ step])
        best = int(np.argmin(losses))
        is_minimum = losses[-1] <= losses[best] + options.least_gain
        centre, taken = (points[-1], losses[-1]) if is_minimum else (points[best], losses[best])
        rises = np.sqrt(2.0 * options.rise / curvatures)
        axes = axes @ (directions * np.clip(rises, MIN_SHRINKAGE, options.growth))
        failures = 0 if before - losses[best] > options.least_gain else failures + 1
        if failures >= options.patience:
            break
        before = losses[best]
    yield replace(state(), best=centre, value=float(taken), converged=True)


def _in_ball(count: int, size: int, random: np.random.Generator) -> FloatArray:
    """(n, d): evenly in the unit ball."""
    directions = random.normal(size=(count, size))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * random.uniform(size=(count, 1)) ** (1.0 / size)


def _fit(
    offsets: FloatArray, losses: FloatArray, coefficients: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step to the minimum, axes (columns) and curvatures of a model weighted by nearness."""
    size = offsets.shape[1]
    far = np.linalg.norm(offsets, axis=1)
    count = max(coefficients + size + 2, int(np.count_nonzero(far < TRUST_RADIUS)))
    near = np.argsort(far, kind="stable")[:count]
    z, weight = offsets[near], np.exp(-0.25 * far[near] ** 2)
    rows, columns = np.triu_indices(size)
    terms = np.hstack([np.ones((len(z), 1)), z, z[:, rows] * z[:, columns]])
    found, *_ = np.linalg.lstsq(weight[:, None] * terms, weight * losses[near], rcond=None)
    slope, hessian = found[1 : size + 1], np.zeros((size, size))
    hessian[rows, columns] = found[size + 1 :]
    curvatures, directions = np.linalg.eigh(hessian + hessian.T)
    curvatures = np.abs(curvatures)
    curvatures = np.maximum(curvatures, MIN_CURVATURE * curvatures.max() + 1e-300)
    step = -directions @ ((directions.T @ slope) / curvatures)
    length = float(np.linalg.norm(step))
    return step * min(1.0, TRUST_RADIUS / max(length, 1e-300)), directions, curvatures
