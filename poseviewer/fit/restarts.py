"""Where to start again: the simplex rebuilt at the minimum it found, until nothing improves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.fit.simplex import SimplexState, axis_simplex, downhill_simplex
from poseviewer.geometry.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class RestartRules:
    """How wide to look, how finely, and when to give up."""

    step: float = 0.05
    """Edge of the first simplex, in units of each number's span."""
    x_tolerance: float = 1e-4
    """A simplex is done when it is this small, in units of each number's span ..."""
    f_tolerance: float = 1e-6
    """... and its losses differ by no more than this."""
    least_gain: float = 1e-5
    """A restart that gains less than this has not improved anything."""
    patience: int = 2
    """So many restarts without improvement end the search."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """The search after one more evaluation."""

    best: FloatArray
    """(d,): the best point so far, over all restarts."""
    value: float
    simplex: SimplexState
    restart: int
    """0 for the first descent."""
    finished: bool = False


def restarted_simplex(
    objective: Callable[[FloatArray], float],
    start: FloatArray,
    spans: FloatArray,
    rules: RestartRules,
    seed: int,
) -> Iterator[SearchState]:
    """Descend, rebuild the simplex at the minimum with random directions, descend again.

    The same objective, start (d,), spans (d,), rules and seed give the same search. The first
    simplex has its edges along the axes; later ones along random orthogonal directions, since a
    descent that got stuck did so in a simplex that had gone flat.
    """
    random = np.random.default_rng(seed)
    best, value = np.array(start, dtype=float), np.inf
    simplex = axis_simplex(best, rules.step * spans)
    failures, restart = 0, 0
    while True:
        before = value
        state: SearchState | None = None
        for inner in downhill_simplex(
            objective,
            simplex,
            x_tolerance=rules.x_tolerance * spans,
            f_tolerance=rules.f_tolerance,
        ):
            if inner.values[0] < value:
                best, value = inner.vertices[0], float(inner.values[0])
            state = SearchState(best, value, inner, restart)
            if not inner.converged:
                yield state
        failures = 0 if before - value > rules.least_gain else failures + 1
        assert state is not None  # a descent evaluates its corners at least
        yield replace(state, finished=failures >= rules.patience)
        if failures >= rules.patience:
            return
        restart += 1
        simplex = _turned_simplex(best, rules.step * spans, random)


def _turned_simplex(
    centre: FloatArray, steps: FloatArray, random: np.random.Generator
) -> FloatArray:
    """(d + 1, d): edges along random orthogonal directions of the space scaled by ``steps``."""
    turn, upper = np.linalg.qr(random.normal(size=(len(steps), len(steps))))
    turn = turn * np.sign(np.diag(upper))
    return np.vstack([centre, centre + turn.T * steps])
