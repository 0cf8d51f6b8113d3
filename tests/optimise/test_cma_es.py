"""The evolving cloud: it ends in the valley, and knows its shape."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.optimise.cma_es import CmaOptions, evolve

TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(5, 5)))[0]
LENGTHS = np.geomspace(1.0, 0.02, 5)
LEAST = np.array([0.1, -0.2, 0.05, 0.1, -0.1])
SPANS = np.array([1.0, 2.0, 0.5, 1.0, 4.0])


def valley(points):
    for point in points:
        yield float(np.sum((TURN.T @ ((point - LEAST) / SPANS) / LENGTHS) ** 2))


RULES = CmaOptions(width=0.3, generations=60, nearness=0.0, least_width=1e-4)


def test_it_ends_at_the_least_loss_and_has_the_valleys_shape():
    *_, end = evolve(valley, np.zeros(5), SPANS, RULES, seed=0)
    assert end.converged
    np.testing.assert_allclose(end.vertices[0], LEAST, atol=0.02)
    # In the valley's own axes and lengths the cloud is about round; the valley itself is 50 to 1.
    shape = (TURN.T @ (end.axes / SPANS[:, None])) / LENGTHS[:, None]
    assert np.linalg.cond(shape) < 5.0


def test_at_first_it_is_as_wide_as_the_rules_say():
    first, *_ = evolve(valley, np.zeros(5), SPANS, RULES, seed=0)
    np.testing.assert_allclose(first.axes, np.diag(RULES.width * SPANS), atol=1e-12)


def test_the_same_arguments_give_the_same_search():
    one, other = (list(evolve(valley, np.zeros(5), SPANS, RULES, seed=3)) for _ in range(2))
    assert len(one) == len(other)
    np.testing.assert_array_equal(one[-1].axes, other[-1].axes)
    assert one[-1].values[0] == pytest.approx(min(state.values[0] for state in one), abs=0.0)
