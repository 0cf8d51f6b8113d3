"""Nelder-Mead from several starts, then restarted at the minimum until nothing improves."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise import nelder_mead
from poseviewer.optimise.protocol import Objective, State
from poseviewer.optimise.restart_options import RestartOptions


def minimise(
    objective: Objective, x0: FloatArray, scale: FloatArray, options: RestartOptions, seed: int = 0
) -> Iterator[State]:
    """Descend, rebuild the simplex at the minimum with random directions, descend again.

    The first simplex has its edges along the scale's columns, later ones along random directions,
    orthogonal in its units: a descent that got stuck did so in a simplex that had gone flat. The
    best ends of the short descents, if enough, span the first that follows: they lie in the valley.

    Args:
        objective: function that returns the losses of points.
        x0: (d,), the start.
        scale: (d, d), whose columns are the directions and units of the edges.
        options: options of the descents.
        seed: seed of the random directions.
    """
    random = np.random.default_rng(seed)
    x0 = np.array(x0, dtype=float)
    units = np.sqrt(np.sum(scale**2, axis=1))  # of each coordinate
    long = nelder_mead.NelderMeadOptions(units * options.x_tolerance, options.f_tolerance)
    short = nelder_mead.NelderMeadOptions(
        units * options.multi_start_x_tolerance, options.multi_start_f_tolerance
    )
    state = State(x0, np.inf, x0[None], np.full(1, np.inf))
    ends: list[State] = []
    restart = failures = 0
    while failures < options.patience:
        is_short = restart < options.multi_starts
        value_before = state.value
        rotation = _random_rotation(len(x0), random) if restart else np.eye(len(x0))
        edges = ((options.multi_start_step if is_short else options.step) * scale) @ rotation
        if restart == options.multi_starts and len(ends) > len(x0):
            ends.sort(key=lambda end: end.value)
            edges = np.array([end.best - state.best for end in ends[1 : len(x0) + 1]]).T
        states = nelder_mead.minimise(
            objective, x0 if is_short else state.best, edges, short if is_short else long
        )
        for inner in states:
            state = replace(inner.since(state), restart=restart, converged=False)
            if inner.converged:
                ends.append(inner)
            else:
                yield state
        if not is_short:
            is_better = value_before - state.value > options.least_gain
            failures = 0 if is_better else failures + 1
        restart += 1
    yield replace(state, converged=True)


def _random_rotation(size: int, random: np.random.Generator) -> FloatArray:
    """Draw an orthogonal matrix (size, size)."""
    q, r = np.linalg.qr(random.normal(size=(size, size)))
    return q * np.sign(np.diag(r))
