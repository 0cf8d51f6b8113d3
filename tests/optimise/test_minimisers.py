"""Every minimiser on every test function keeps the same promises."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
import pytest
from scipy.optimize import rosen

from poseviewer.geometry.arrays import FloatArray
from poseviewer.optimise import cma_es, nelder_mead, quadratic, simplex_restarts
from poseviewer.optimise.protocol import Minimiser, State
from poseviewer.optimise.restart_options import RestartOptions

Function = Callable[[FloatArray], float]
Search = Callable[..., Iterator[State]]
Options = TypeVar("Options")


def bind(minimise: Minimiser[Options], options: Options) -> Search:
    return partial(minimise, options=options)


MINIMISERS = {
    "nelder_mead": bind(nelder_mead.minimise, nelder_mead.NelderMeadOptions(1e-6, 1e-10)),
    "simplex_restarts": bind(
        simplex_restarts.minimise,
        RestartOptions(step=0.2, x_tolerance=1e-6, f_tolerance=1e-10),
    ),
    "cma_es": bind(
        cma_es.minimise,
        cma_es.CmaOptions(sigma=0.5, generations=150, prior_weight=0.0, min_sigma=1e-5),
    ),
    "quadratic": bind(
        quadratic.minimise,
        quadratic.QuadraticOptions(1.0, 0.1, rounds=30, min_gain=1e-9, growth=2.0),
    ),
}
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
FUNCTIONS: dict[str, tuple[Function, int]] = {
    "bowl": (lambda x: float(np.sum((x - 0.3) ** 2)), 2),
    "line": (lambda x: float((x[0] - 0.3) ** 2), 1),
    "valley": (lambda x: float(np.sum((TURN @ (x - 0.3) * [1.0, 2.0, 5.0, 10.0]) ** 2)), 4),
    "rosenbrock": (lambda x: float(rosen(x + 0.7)), 2),
}
"""Functions and numbers of their parameters; the least value, 0, is where all are 0.3."""


def search_of(name: str, function: str, losses: list[float], **seed: int) -> Iterator[State]:
    """A search whose evaluations are written down; a state is asked for after each."""
    compute, size = FUNCTIONS[function]

    def objective(points: Sequence[FloatArray]) -> Iterator[float]:
        for point in points:
            losses.append(compute(point))
            yield losses[-1]

    return MINIMISERS[name](objective, np.zeros(size), np.eye(size), **seed)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("name", MINIMISERS)
def test_a_state_follows_every_evaluation_and_the_last_is_the_minimum(name: str, function: str):
    losses, value = list[float](), math.inf
    compute, size = FUNCTIONS[function]
    for count, state in enumerate(search_of(name, function, losses), 1):
        assert len(losses) == count - state.converged
        assert state.candidates.shape[1:] == state.best.shape == (size,)
        assert len(state.candidates) == len(state.candidate_losses)
        assert state.candidate_losses.tolist() == sorted(state.candidate_losses)
        assert state.axes is None or state.axes.shape == (size, size)
        if not state.converged:
            assert state.value == compute(state.best) <= value
            value = state.value
    assert state.converged
    assert min(value, state.value) == min(losses)
    np.testing.assert_allclose(state.best, 0.3, atol=0.01)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("name", MINIMISERS)
def test_a_search_is_repeated_exactly_and_can_be_stopped(name: str, function: str):
    losses: list[float] = []
    values = [state.value for state in search_of(name, function, losses)]
    again: list[float] = []
    for (state, value), _ in zip(
        zip(search_of(name, function, again), values, strict=False), range(20), strict=False
    ):
        assert state.value == value
    assert again == losses[: len(again)]
    assert math.isclose(len(again), min(20, len(losses)), abs_tol=1)


@pytest.mark.parametrize("name", [name for name in MINIMISERS if name != "nelder_mead"])
def test_another_seed_is_another_search(name: str):
    values = [[s.value for s in search_of(name, "valley", [], seed=seed)] for seed in (5, 6)]
    assert values[0] != values[1]
