"""The population ends in the valley, and has its shape."""

import numpy as np
import pytest

from poseviewer.optimise.cma_es import CmaOptions, minimise

TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(5, 5)))[0]
LENGTHS = np.geomspace(1.0, 0.02, 5)
MINIMUM = np.array([0.1, -0.2, 0.05, 0.1, -0.1])
SCALES = np.array([1.0, 2.0, 0.5, 1.0, 4.0])
SCALE = np.diag(SCALES)


def valley(points):
    for point in points:
        yield float(np.sum((TURN.T @ ((point - MINIMUM) / SCALES) / LENGTHS) ** 2))


OPTIONS = CmaOptions(sigma=0.3, generations=60, prior_weight=0.0, min_sigma=1e-4)


def test_it_ends_at_the_least_loss_and_has_the_valleys_shape():
    first, *states = minimise(valley, np.zeros(5), SCALE, OPTIONS, seed=0)
    assert first.axes == pytest.approx(np.diag(OPTIONS.sigma * SCALES), abs=1e-12)
    end = states[-1]
    assert end.converged
    assert end.value == min(state.value for state in states)
    np.testing.assert_allclose(end.best, MINIMUM, atol=0.02)
    # In the valley's own axes and lengths the population is about round; the valley is 50 to 1.
    assert end.axes is not None
    shape = (TURN.T @ (end.axes / SCALES[:, None])) / LENGTHS[:, None]
    assert np.linalg.cond(shape) < 5.0
