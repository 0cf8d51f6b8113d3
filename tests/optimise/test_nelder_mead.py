"""The downhill simplex against scipy's, and what a generator must do."""

import numpy as np
import pytest
from scipy.optimize import minimize, rosen

from poseviewer.optimise import simplex_restarts
from poseviewer.optimise.nelder_mead import Descent, NelderMeadOptions, minimise
from poseviewer.optimise.restart_options import RestartOptions


def batched(function):
    """The objective of a function of one point; evaluates a point when its loss is asked for."""
    return lambda points: (function(point) for point in points)


def bowl(x):
    return float(np.sum(np.arange(1, len(x) + 1) * (x - 0.3) ** 2))


def steps(x):
    """Piecewise constant, with ties: what a rasterised silhouette looks like."""
    return float(np.sum(np.abs(np.round(8.0 * (x - 0.3)))))


def random_valley(seed: int):
    matrix = np.random.default_rng(seed).normal(size=(6, 6))
    return lambda x: float(np.sum((matrix @ (x - 0.2)) ** 2) + 0.3 * np.sum(np.cos(5 * x)))


@pytest.mark.parametrize(
    ("function", "dimensions"),
    [
        *[(bowl, d) for d in (1, 2, 6, 7)],
        *[(rosen, d) for d in (2, 6)],
        *[(random_valley(seed), 6) for seed in range(4)],
    ],
)
def test_simplex_matches_scipy(function, dimensions):
    start = np.random.default_rng(dimensions).normal(size=dimensions)
    simplex = start + np.vstack([np.zeros(dimensions), 0.1 * np.eye(dimensions)])
    visited: list[np.ndarray] = []

    def objective(x):
        visited.append(np.array(x))
        return function(x)

    options = {"initial_simplex": simplex, "xatol": 1e-5, "fatol": 1e-9, "maxfev": 20000}
    expected = minimize(objective, start, method="Nelder-Mead", options=options)
    theirs, visited[:] = visited.copy(), []
    edges = 0.1 * np.eye(dimensions)
    *_, end = minimise(batched(objective), start, edges, NelderMeadOptions(1e-5, 1e-9))
    assert len(visited) == len(theirs)
    assert np.array_equal(np.array(visited), np.array(theirs))
    assert np.array_equal(end.best, expected.x)
    assert end.value == expected.fun


@pytest.mark.parametrize("dimensions", [1, 2, 6])
def test_simplex_ends_on_a_staircase(dimensions):
    """No comparison with scipy here: which of two equal corners is the worse is not defined."""
    start, edges = np.zeros(dimensions), 0.2 * np.eye(dimensions)
    *_, end = minimise(batched(steps), start, edges, NelderMeadOptions(1e-4, 1e-9))
    assert end.converged
    assert end.value <= steps(start)
    assert np.all(np.isfinite(end.candidate_losses))


@pytest.mark.parametrize("evaluations", [9, 1000])
def test_a_descent_ends_after_its_evaluations_or_where_it_converges(evaluations):
    start, visited = np.zeros(6), []

    def loss(x):
        visited.append(x)
        return bowl(x)

    options = NelderMeadOptions(1e-3, 1e-4)
    end = Descent(0.1, evaluations, options).run(loss, start)
    assert end.converged == (evaluations == 1000)
    assert end.value == min(map(bowl, visited))
    if not end.converged:
        assert len(visited) == evaluations + 1
    assert any(point[5] != 0.0 for point in visited)
    visited.clear()
    Descent(0.1 * np.eye(6, 3), evaluations, options).run(loss, start)
    assert all(point[5] == 0.0 for point in visited)  # no edge leads there


def test_restarts_leave_a_collapsed_simplex():
    """McKinnon's function (1998): a single descent converges to a point that is no minimum."""

    def mckinnon(x):
        a, b = x
        return float((360.0 * a * a if a <= 0.0 else 6.0 * a * a) + b + b * b)

    lam = (1.0 + np.sqrt(33.0)) / 8.0, (1.0 - np.sqrt(33.0)) / 8.0
    edges = np.array([lam, [1.0, 1.0]]).T
    *_, once = minimise(batched(mckinnon), np.zeros(2), edges, NelderMeadOptions(1e-8, 1e-12))
    assert once.value > -0.01  # the trap works
    options = RestartOptions(step=0.5, multi_starts=0, x_tolerance=1e-6, f_tolerance=1e-10)
    *_, last = simplex_restarts.minimise(batched(mckinnon), once.best, np.eye(2), options)
    assert last.value == pytest.approx(-0.25, abs=1e-6)


def test_several_starts_leave_a_side_valley():
    """Two valleys; the first simplex reaches into the shallow one, others into the deep one."""

    def valleys(x):
        deep, shallow = (x[0] + 1.0) ** 2, 0.05 * (x[0] - 0.5) ** 2 + 0.4
        return float(min(deep, shallow) + x[1] ** 2)

    ends = {}
    for starts in (0, 8):
        options = RestartOptions(step=0.6, multi_starts=starts, patience=1)
        x0 = np.array([-0.1, 0.2])
        search = simplex_restarts.minimise(batched(valleys), x0, np.eye(2), options)
        ends[starts] = [state.value for state in search]
    assert ends[0][-1] == pytest.approx(0.4, abs=1e-3)
    assert ends[8][-1] == pytest.approx(0.0, abs=1e-3)


def test_the_best_ends_of_short_descents_span_the_next_simplex():
    """They scatter along the valley, where directions at random lead up its sides."""
    valley, seen = random_valley(3), []
    options, evaluated = RestartOptions(), [[] for _ in range(20)]

    def objective(x):
        seen.append((valley(x), tuple(x)))
        return seen[-1][0]

    for state in simplex_restarts.minimise(
        batched(objective), np.zeros(6), np.eye(6), options, seed=5
    ):
        if not state.converged:
            evaluated[state.restart].append(seen[-1])
    ends = sorted(min(points) for points in evaluated[: options.multi_starts])
    simplex = evaluated[options.multi_starts][:7]
    assert np.array([x for _, x in simplex]) == pytest.approx(np.array([x for _, x in ends[:7]]))
