"""Quadratic surfaces: exact on quadratic losses, round where they are not told."""

from __future__ import annotations

import numpy as np
import pytest

from poseviewer.optimise.surface import coefficients, fit_surface

RANDOM = np.random.default_rng(0)
TURN = np.linalg.qr(RANDOM.normal(size=(4, 4)))[0]
HESSIAN = TURN @ np.diag([1.0, 1.2, 1.5, 2.0]) @ TURN.T
SLOPE = np.array([0.3, -0.2, 0.1, 0.4])


def losses(z):
    return 5.0 + z @ SLOPE + 0.5 * np.einsum("ni,ij,nj->n", z, HESSIAN, z)


def test_many_points_tell_the_surface():
    z = RANDOM.normal(size=(200, 4))
    found = fit_surface(z, losses(z), np.ones(len(z)))
    np.testing.assert_allclose(found.hessian, HESSIAN, atol=0.01)
    np.testing.assert_allclose(found.slope, SLOPE, atol=0.01)
    np.testing.assert_allclose(found(z), losses(z), atol=0.05)
    step = found.least(radius=10.0)
    np.testing.assert_allclose(step, -np.linalg.solve(HESSIAN, SLOPE), atol=0.02)
    assert np.linalg.norm(found.least(radius=0.05)) == pytest.approx(0.05)


def test_fewer_points_than_coefficients_give_a_round_one_that_goes_through_them():
    z = RANDOM.normal(size=(coefficients(4) - 4, 4))
    found = fit_surface(z, losses(z), np.ones(len(z)))
    curvatures = np.linalg.eigvalsh(found.hessian)
    assert curvatures.min() > 0.8
    assert curvatures.max() < 2.2
    np.testing.assert_allclose(found(z), losses(z), atol=0.2)


def test_a_saddle_is_taken_for_a_valley():
    z = RANDOM.normal(size=(100, 2))
    found = fit_surface(z, z[:, 0] ** 2 - z[:, 1] ** 2 + z[:, 1], np.ones(len(z)))
    directions, curvatures = found.principal()
    assert curvatures == pytest.approx([2.0, 2.0], rel=0.05)
    assert abs(directions.T @ directions - np.eye(2)).max() < 1e-9
    assert found.least(radius=3.0)[1] == pytest.approx(-0.5, rel=0.1)
