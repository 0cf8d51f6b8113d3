"""Nelder-Mead from several starts, then restarted at the minimum until nothing improves."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise import nelder_mead
from poseviewer.optimise.restart_options import RestartOptions
from poseviewer.optimise.state import Objective, State


def minimise(
    objective: Objective,
    x0: FloatArray,
    scale: FloatArray,
    options: RestartOptions,
    seed: int = 0,
) -> Iterator[State]:
    """Descend, rebuild the simplex at the minimum with random directions, descend again.

    The first simplex has its edges along the scale's columns, later ones along random directions,
    orthogonal in its units: a descent that got stuck did so in a simplex that had gone flat. The
    best ends of the short descents, if enough, span the first that follows: they lie in the valley.
    """
    random = np.random.default_rng(seed)
    x0 = np.array(x0, dtype=float)
    unit = np.sqrt(np.sum(scale**2, axis=1))  # in each coordinate
    long = nelder_mead.NelderMeadOptions(unit * options.x_tolerance, options.f_tolerance)
    short = nelder_mead.NelderMeadOptions(
        unit * options.multi_start_x_tolerance, options.multi_start_f_tolerance
    )
    state = State(x0, np.inf, x0[None], np.full(1, np.inf))
    restart, failures, ends = 0, 0, list[State]()
    while failures < options.patience:
        is_short = restart < options.multi_starts
        before = state.value
        turn = _random_rotation(len(x0), random) if restart else np.eye(len(x0))
        edges = ((options.multi_start_step if is_short else options.step) * scale) @ turn
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
            failures = 0 if before - state.value > options.least_gain else failures + 1
        restart += 1
    yield replace(state, converged=True)


def _random_rotation(size: int, random: np.random.Generator) -> FloatArray:
    """(d, d): orthogonal."""
    turn, upper = np.linalg.qr(random.normal(size=(size, size)))
    return turn * np.sign(np.diag(upper))
