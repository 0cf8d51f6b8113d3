"""Whitening and canonical correlations against NumPy's eigenvalues and singular values."""

import numpy as np
import pytest

from poseviewer.geometry.linear_algebra import canonical_correlations_squared, whiten


def make_moments(seed: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of channels in very unlike units."""
    random = np.random.default_rng(seed)
    samples = random.normal(size=(400, size)) @ random.normal(size=(size, size))
    samples *= np.geomspace(1e-3, 1e3, size)
    return samples.mean(axis=0), np.cov(samples.T).reshape(size, size)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 13, 19])
def test_whitening_makes_the_covariance_the_identity(size):
    mean, covariance = make_moments(size, size)
    found = whiten(covariance, mean)
    np.testing.assert_allclose(found @ covariance @ found.T, np.eye(size), atol=1e-8)


def test_constant_and_dependent_channels_are_left_out():
    mean, covariance = make_moments(0, 5)
    mix = np.vstack([np.eye(5), np.zeros(5), np.ones(5)])  # a constant one, and a sum of the others
    mean, covariance = mix @ mean + 3.0, mix @ covariance @ mix.T
    found = whiten(covariance, mean)
    assert found.shape == (5, 7)
    np.testing.assert_array_equal(found[:, 5], 0.0)
    np.testing.assert_allclose(found @ covariance @ found.T, np.eye(5), atol=1e-8)


@pytest.mark.parametrize(("n", "m"), [(1, 4), (3, 4), (3, 13), (19, 7), (4, 4)])
@pytest.mark.parametrize("is_known", [False, True])
def test_squares_are_those_of_the_singular_values(n, m, is_known):
    mean, covariance = make_moments(n + m, n + m)
    one, other = (np.linalg.inv(np.linalg.cholesky(c)) for c in _blocks(covariance, n))
    wanted = np.linalg.svd(one @ covariance[:n, n:] @ other.T, compute_uv=False) ** 2
    photo = whiten(covariance[:n, :n], mean[:n]) if is_known else None
    found = canonical_correlations_squared(mean, covariance, n, photo)
    np.testing.assert_allclose(np.sort(found), np.sort(wanted), atol=1e-8)


def _blocks(covariance: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    return covariance[:n, :n], covariance[n:, n:]
