"""The downhill simplex of Nelder and Mead (1965).

Moves and their order are scipy's (``minimize(method="Nelder-Mead")``, not adaptive): from the same
simplex both visit the same points. This one can be stopped after any evaluation.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.protocol import Objective, State

REFLECTION = 1.0
"""rho: step through the centroid, in distances of the worst vertex from it."""
EXPANSION = 2.0
"""chi: factor of a step that leads downhill."""
CONTRACTION = 0.5
"""psi: factor of a step that does not."""
SHRINKAGE = 0.5
"""sigma: factor by which all edges shrink."""


@dataclass(frozen=True, slots=True, eq=False)
class NelderMeadOptions:
    """Distances from the best vertex within which all others have converged."""

    x_tolerance: FloatArray | float
    """Tolerance of each coordinate, or one for all."""
    f_tolerance: float


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """A descent of limited length."""

    edge: FloatArray | float
    """Edges of its simplex as columns (d, e), or the length of d edges along the axes."""
    evaluations: int
    """Number of evaluations after that of the start, at most."""
    tolerances: NelderMeadOptions = NelderMeadOptions(x_tolerance=2e-3, f_tolerance=1e-3)
    """End before: a minimum nearer than this counts as the same."""

    def run(self, loss: Callable[[FloatArray], float], start: FloatArray) -> State:
        """Return the last state of the descent from a point (d,)."""
        edges = self.edge if isinstance(self.edge, np.ndarray) else self.edge * np.eye(len(start))
        states = minimise(partial(map, loss), start, edges, self.tolerances)
        *_, last = islice(states, self.evaluations + 1)
        return last


def minimise(
    objective: Objective,
    x0: FloatArray,
    scale: FloatArray,
    options: NelderMeadOptions,
    seed: int = 0,
) -> Iterator[State]:
    """Descend from the simplex of a point and d edges.

    Args:
        objective: function that returns the losses of points.
        x0: (d,), the first vertex.
        scale: (d, d), whose columns are the edges.
        options: tolerances.
        seed: unused, as nothing is random.
    """
    del seed
    simplex = np.vstack([x0, x0 + scale.T])
    losses = np.full(len(simplex), np.inf)
    for i, loss in enumerate(objective(list(simplex))):
        losses[i] = loss
        yield _state(simplex, losses)
    while True:
        order = np.argsort(losses, kind="stable")
        simplex, losses = simplex[order], losses[order]
        is_small = np.all(np.abs(simplex[1:] - simplex[0]) <= options.x_tolerance)
        if is_small and np.max(np.abs(losses[1:] - losses[0])) <= options.f_tolerance:
            yield _state(simplex, losses, converged=True)
            return
        for _ in _move(objective, simplex, losses):
            yield _state(simplex, losses)


def _move(objective: Objective, simplex: FloatArray, losses: FloatArray) -> Iterator[None]:
    """Replace the worst vertex, or shrink, in place; yields after every evaluation."""
    centroid = simplex[:-1].sum(axis=0) / (len(simplex) - 1)

    def try_at(factor: float) -> tuple[FloatArray, float]:
        point = (1.0 + factor) * centroid - factor * simplex[-1]
        (loss,) = objective([point])
        return point, loss

    point, loss = reflected, reflected_loss = try_at(REFLECTION)
    yield
    if loss < losses[0]:
        point, loss = try_at(REFLECTION * EXPANSION)
        yield
        if loss >= reflected_loss:
            point, loss = reflected, reflected_loss
    elif loss >= losses[-2]:
        is_outside = loss < losses[-1]
        limit = reflected_loss if is_outside else losses[-1]
        point, loss = try_at(CONTRACTION * REFLECTION if is_outside else -CONTRACTION)
        yield
        if loss > limit or (loss == limit and not is_outside):
            simplex[1:] = simplex[0] + SHRINKAGE * (simplex[1:] - simplex[0])
            losses[1:] = np.inf
            for i, shrunk_loss in enumerate(objective(list(simplex[1:])), start=1):
                losses[i] = shrunk_loss
                yield
            return
    simplex[-1], losses[-1] = point, loss


def _state(simplex: FloatArray, losses: FloatArray, converged: bool = False) -> State:
    order = np.argsort(losses, kind="stable")
    simplex, losses = simplex[order], losses[order]
    return State(simplex[0], float(losses[0]), simplex, losses, converged=converged)
