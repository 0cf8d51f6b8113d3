"""Quadratic models of the loss: exact on valleys, and not led astray by jumps."""

import numpy as np
import pytest

from poseviewer.optimise.quadratic import QuadraticOptions, minimise, step_along

OPTIONS = QuadraticOptions(sampling_radius=2.0, contour_level=0.5)
JUMPS = 0.02


def valley(size: int, jumps: float = 0.0):
    """A valley of unlike lengths in random directions; its least place, and its losses."""
    random = np.random.default_rng(size)
    turn = np.linalg.qr(random.normal(size=(size, size)))[0]
    lengths, least = np.geomspace(0.5, 0.05, size), 0.02 * random.normal(size=size)

    def loss(point) -> float:
        """With jumps that depend on the place alone, as those of a rasteriser do."""
        across = float(np.sum((turn.T @ (point - least) / lengths) ** 2))
        return 7.0 + across + jumps * np.sin(1e6 * float(np.sum(point)))

    def losses(points):
        for point in points:
            yield loss(point)

    return least, loss, losses, 0.3 * turn * lengths


@pytest.mark.parametrize("size", [1, 2, 6, 7])
def test_one_model_finds_the_least_place_of_a_quadratic_valley(size):
    least, _, losses, units = valley(size)
    *_, end = minimise(losses, np.zeros(size), units, OPTIONS, seed=0)
    assert end.converged
    np.testing.assert_allclose(end.best, least, atol=1e-6)
    assert end.value == pytest.approx(7.0, abs=1e-9)


def test_jumps_of_the_loss_are_evened_out():
    """The place that is taken has less loss, but for the jumps, than the best that was judged."""
    least, exact, *_ = valley(6)
    _, _, losses, units = valley(6, JUMPS)
    ends, bests = [], []
    for seed in range(10):
        *_, before, end = minimise(losses, np.zeros(6), units, OPTIONS, seed)
        ends.append(exact(end.best) - exact(least))
        bests.append(exact(before.best) - exact(least))
    assert np.mean(ends) < JUMPS
    assert np.mean(ends) < np.mean(bests)


def test_a_loss_that_is_the_same_everywhere_ends_the_search_where_it_began_or_near():
    def flat(points):
        for _ in points:
            yield 3.0

    *_, end = minimise(flat, np.ones(3), 0.1 * np.eye(3), OPTIONS, seed=0)
    assert end.converged
    assert np.all(np.isfinite(end.best))
    assert np.max(np.abs(end.best - 1.0)) < 1.0


def test_rounds_end_when_nothing_is_gained():
    _, _, losses, units = valley(6)
    states = list(minimise(losses, np.zeros(6), units, OPTIONS, seed=0))
    many = list(
        minimise(losses, np.zeros(6), units, QuadraticOptions(2.0, 0.5, min_gain=-1.0), seed=0)
    )
    assert len(states) < len(many)


@pytest.mark.parametrize("size", [1, 6])
def test_one_step_along_known_axes_reaches_the_least_place_by_few_points(size):
    least, _, losses, units = valley(size)
    asked = []

    def counted(points):
        asked.extend(points)
        return losses(points)

    end = step_along(counted, least + 0.5 * units @ np.ones(size) / size, units, 0.09)
    assert end is not None
    assert end.axes is not None
    np.testing.assert_allclose(end.best, least, atol=1e-6)
    assert len(asked) == 2 * size + 2
    lengths = np.linalg.norm(end.axes, axis=0) / np.linalg.norm(units, axis=0)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-6)  # 0.3 of a length has 0.09 more


def test_no_step_leads_beyond_its_points_or_where_there_is_no_minimum():
    least, _, losses, units = valley(6)
    assert step_along(losses, least + 2.0 * units[:, 0], units, 0.09) is None
    assert (
        step_along(lambda points: (-float(one @ one) for one in points), least, units, 1.0) is None
    )
    assert step_along(lambda points: iter([3.0] * len(points)), least, units, 1.0) is None
    assert step_along(lambda points: iter([np.inf] * len(points)), least, units, 1.0) is None
