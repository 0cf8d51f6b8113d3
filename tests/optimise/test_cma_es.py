"""The population ends in the valley, and has its shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.optimise.cma_es import CmaOptions, minimise

TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(5, 5)))[0]
LENGTHS = np.geomspace(1.0, 0.02, 5)
LEAST = np.array([0.1, -0.2, 0.05, 0.1, -0.1])
SCALES = np.array([1.0, 2.0, 0.5, 1.0, 4.0])
SCALE = np.diag(SCALES)


def valley(points):
    for point in points:
        yield float(np.sum((TURN.T @ ((point - LEAST) / SCALES) / LENGTHS) ** 2))


OPTIONS = CmaOptions(sigma=0.3, generations=60, nearness=0.0, least_sigma=1e-4)


def test_it_ends_at_the_least_loss_and_has_the_valleys_shape():
    *_, end = minimise(valley, np.zeros(5), SCALE, OPTIONS, seed=0)
    assert end.converged
    np.testing.assert_allclose(end.best, LEAST, atol=0.02)
    # In the valley's own axes and lengths the population is about round; the valley is 50 to 1.
    assert end.axes is not None
    shape = (TURN.T @ (end.axes / SCALES[:, None])) / LENGTHS[:, None]
    assert np.linalg.cond(shape) < 5.0


def test_at_first_it_is_as_wide_as_the_options_say():
    first, *_ = minimise(valley, np.zeros(5), SCALE, OPTIONS, seed=0)
    assert first.axes == pytest.approx(np.diag(OPTIONS.sigma * SCALES), abs=1e-12)


def test_the_same_arguments_give_the_same_search():
    one, other = (list(minimise(valley, np.zeros(5), SCALE, OPTIONS, seed=3)) for _ in range(2))
    assert len(one) == len(other)
    np.testing.assert_array_equal(one[-1].axes, other[-1].axes)
    assert one[-1].value == pytest.approx(min(state.value for state in one), abs=0.0)


def test_where_a_surface_tells_the_order_few_of_a_population_are_evaluated():
    """And where none can, on unrelated losses, each point of each population is."""
    random = np.random.default_rng(0)
    options = CmaOptions(sigma=0.3, generations=20, nearness=0.0, least_sigma=0.0, has_surface=True)
    *smooth, end = minimise(valley, np.zeros(5), SCALE, options, seed=0)
    *rugged, _ = minimise(
        lambda points: iter(random.uniform(size=len(points))), np.zeros(5), SCALE, options, seed=0
    )
    assert len(smooth) < (1 + 20 * options.population) / 3
    assert len(rugged) == 1 + 20 * options.population
    assert end.value < 1e-3


def test_the_best_is_a_point_that_was_evaluated():
    seen = {}

    def noted(points):
        for point, loss in zip(points, valley(points), strict=True):
            seen[point.tobytes()] = loss
            yield loss

    options = replace(OPTIONS, has_surface=True)
    for state in minimise(noted, np.zeros(5), SCALE, options, seed=0):
        known = np.isfinite(state.candidate_losses)
        assert known[0]
        for point, loss in zip(state.candidates[known], state.candidate_losses[known], strict=True):
            assert seen[point.tobytes()] == loss
