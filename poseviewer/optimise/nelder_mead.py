"""The downhill simplex of Nelder and Mead (1965), as a generator that can be stopped anywhere.

Moves and their order are scipy's (``minimize(method="Nelder-Mead")``, not adaptive): from the same
simplex both visit the same points. Ours yields after every evaluation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.arrays import FloatArray

REFLECTION, EXPANSION, CONTRACTION, SHRINKAGE = 1.0, 2.0, 0.5, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SimplexState:
    """The search after one more evaluation."""

    vertices: FloatArray
    """(d + 1, d), the best first."""
    values: FloatArray
    """(d + 1,), ascending; infinite where not yet evaluated."""
    converged: bool = False


def axis_simplex(start: FloatArray, steps: FloatArray) -> FloatArray:
    """(d + 1, d): ``start`` (d,) and its neighbours at ``steps`` (d,), signed, along each axis."""
    return np.vstack([start, start + np.diag(steps)])


def downhill_simplex(
    objective: Callable[[FloatArray], float],
    vertices: FloatArray,
    *,
    x_tolerance: FloatArray | float,
    f_tolerance: float,
) -> Iterator[SimplexState]:
    """Minimise ``objective`` from the simplex ``vertices`` (d + 1, d).

    Yields after every evaluation. The last state is ``converged``: all corners are within
    ``x_tolerance`` (for each number, or one for all) and ``f_tolerance`` of the best one.
    """
    simplex = np.array(vertices, dtype=float)
    values = np.full(len(simplex), np.inf)
    for i, corner in enumerate(simplex):
        values[i] = objective(corner)
        yield _sorted_state(simplex, values)
    order = np.argsort(values, kind="stable")
    simplex, values = simplex[order], values[order]
    while not _has_converged(simplex, values, x_tolerance, f_tolerance):
        for _ in _one_move(objective, simplex, values):
            yield _sorted_state(simplex, values)
        order = np.argsort(values, kind="stable")
        simplex, values = simplex[order], values[order]
    yield SimplexState(simplex.copy(), values.copy(), converged=True)


def _one_move(
    objective: Callable[[FloatArray], float], simplex: FloatArray, values: FloatArray
) -> Iterator[None]:
    """Replace the worst corner, or shrink, in place; yields after every evaluation."""
    centre = simplex[:-1].sum(axis=0) / (len(simplex) - 1)

    def try_at(factor: float) -> tuple[FloatArray, float]:
        point = (1.0 + factor) * centre - factor * simplex[-1]
        return point, objective(point)

    point, value = reflected, reflected_value = try_at(REFLECTION)
    yield
    if value < values[0]:
        point, value = try_at(REFLECTION * EXPANSION)
        yield
        if value >= reflected_value:
            point, value = reflected, reflected_value
    elif value >= values[-2]:
        outside = value < values[-1]
        limit = reflected_value if outside else values[-1]
        point, value = try_at(CONTRACTION * REFLECTION if outside else -CONTRACTION)
        yield
        if value > limit or (value == limit and not outside):
            yield from _shrink(objective, simplex, values)
            return
    simplex[-1], values[-1] = point, value


def _shrink(
    objective: Callable[[FloatArray], float], simplex: FloatArray, values: FloatArray
) -> Iterator[None]:
    for i in range(1, len(simplex)):
        simplex[i] = simplex[0] + SHRINKAGE * (simplex[i] - simplex[0])
        values[i] = objective(simplex[i])
        yield


def _has_converged(
    simplex: FloatArray, values: FloatArray, x_tolerance: FloatArray | float, f_tolerance: float
) -> bool:
    close = np.all(np.abs(simplex[1:] - simplex[0]) <= x_tolerance)
    return bool(close and np.max(np.abs(values[1:] - values[0])) <= f_tolerance)


def _sorted_state(simplex: FloatArray, values: FloatArray) -> SimplexState:
    order = np.argsort(values, kind="stable")
    return SimplexState(simplex[order], values[order])
