"""Nelder-Mead from several starts, then restarted at the minimum until nothing improves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise import nelder_mead
from poseviewer.optimise.state import Objective, State, best_so_far


@dataclass(frozen=True, slots=True)
class RestartOptions:
    """Size, tolerances and number of the descents. Lengths are in units of the scale."""

    step: float = 0.05
    """Edge of each new simplex."""
    multi_starts: int = 4
    """Short descents from the start, the best of which goes on: one often ends in a side valley."""
    multi_start_x_tolerance: float = 1e-2
    multi_start_f_tolerance: float = 1e-3
    x_tolerance: float = 5e-4
    """A descent ends when its simplex is this small ..."""
    f_tolerance: float = 2e-5
    """... and its losses differ by no more than this."""
    least_gain: float = 2e-4
    """A restart that gains less has not improved anything."""
    patience: int = 2
    """Number of restarts in a row without improvement that ends the search."""


def minimise(
    objective: Objective,
    x0: FloatArray,
    scale: FloatArray,
    options: RestartOptions,
    seed: int = 0,
) -> Iterator[State]:
    """Descend, rebuild the simplex at the minimum with random directions, descend again.

    The first simplex has its edges along the scale's columns, later ones along random directions,
    orthogonal in its units: a descent that got stuck did so in a simplex that had gone flat.
    """
    random = np.random.default_rng(seed)
    x0 = np.array(x0, dtype=float)
    unit = np.sqrt(np.sum(scale**2, axis=1))  # in each coordinate
    long = nelder_mead.NelderMeadOptions(unit * options.x_tolerance, options.f_tolerance)
    short = nelder_mead.NelderMeadOptions(
        unit * options.multi_start_x_tolerance, options.multi_start_f_tolerance
    )
    state = State(x0, np.inf, x0[None], np.full(1, np.inf))
    restart = failures = 0
    while failures < options.patience:
        is_short = restart < options.multi_starts
        before = state.value
        turn = _random_rotation(len(x0), random) if restart else np.eye(len(x0))
        states = nelder_mead.minimise(
            objective,
            x0 if is_short else state.best,
            (options.step * scale) @ turn,
            short if is_short else long,
        )
        for inner in best_so_far(states, state):
            state = replace(inner, restart=restart, converged=False)
            if not inner.converged:
                yield state
        if not is_short:
            failures = 0 if before - state.value > options.least_gain else failures + 1
        restart += 1
    yield replace(state, converged=True)


def _random_rotation(size: int, random: np.random.Generator) -> FloatArray:
    """(d, d): orthogonal."""
    turn, upper = np.linalg.qr(random.normal(size=(size, size)))
    return turn * np.sign(np.diag(upper))
