"""Where to start again: the simplex rebuilt at the minimum it found, until nothing improves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise.nelder_mead import SimplexState, downhill_simplex


@dataclass(frozen=True, slots=True)
class RestartOptions:
    """How wide to look, how finely, and when to give up. Lengths are in units that the search is
    told: the numbers' spans, or what a search before it found of the landscape's shape.
    """

    step: float = 0.05
    """Edge of each new simplex."""
    scouts: int = 4
    """So many short descents start at the start, each with another simplex; the search goes on
    from the best of them. One alone often ends in a side valley."""
    scout_x_tolerance: float = 1e-2
    scout_f_tolerance: float = 1e-3
    x_tolerance: float = 5e-4
    """A simplex is done when it is this small ..."""
    f_tolerance: float = 2e-5
    """... and its losses differ by no more than this."""
    least_gain: float = 2e-4
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
    units: FloatArray,
    rules: RestartOptions,
    seed: int,
) -> Iterator[SearchState]:
    """Descend, rebuild the simplex at the minimum with random directions, descend again.

    Args:
        objective: of points (d,).
        start: (d,).
        units: (d, d): its columns are the directions along which the rules' lengths are measured,
            each as long as one unit; ``diag(spans)`` where nothing is known of the landscape.
        rules: see there.
        seed: of the directions.

    The same arguments give the same search. The first simplex has its edges along the units; later
    ones along random directions, orthogonal in these units, since a descent that got stuck did so
    in a simplex that had gone flat. Yields after every evaluation, and once more at the end.
    """
    random = np.random.default_rng(seed)
    start = np.array(start, dtype=float)
    steps = rules.step * units
    reach = np.sqrt(np.sum(units**2, axis=1))  # of one unit, in each number
    best, value, failures, restart = start, np.inf, 0, 0
    state: SearchState | None = None
    while failures < rules.patience:
        scouting = restart < rules.scouts
        centre = start if scouting else best
        turn = _random_turn(len(start), random) if restart else np.eye(len(start))
        simplex = np.vstack([centre, centre + (steps @ turn).T])
        before = value
        for inner in downhill_simplex(
            objective,
            simplex,
            x_tolerance=reach * (rules.scout_x_tolerance if scouting else rules.x_tolerance),
            f_tolerance=rules.scout_f_tolerance if scouting else rules.f_tolerance,
        ):
            if inner.values[0] < value:
                best, value = inner.vertices[0], float(inner.values[0])
            state = SearchState(best, value, inner, restart)
            if not inner.converged:
                yield state
        if not scouting:
            failures = 0 if before - value > rules.least_gain else failures + 1
        restart += 1
    assert state is not None  # patience is at least one descent
    yield replace(state, finished=True)


def _random_turn(size: int, random: np.random.Generator) -> FloatArray:
    """(d, d): orthogonal, its columns random directions."""
    turn, upper = np.linalg.qr(random.normal(size=(size, size)))
    return turn * np.sign(np.diag(upper))
