"""Properties of the loss that the paper proves, and a least-squares oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseviewer.fit.lighting import recover_lighting
from poseviewer.losses.paper_loss import lighting_loss
from poseviewer.render.attributes import Moments

SEEDS = st.integers(0, 2**32 - 1)
CHANNELS = st.sampled_from([(1, 1), (1, 4), (3, 4), (3, 12), (4, 3)])


def make_moments(photo, model, weights=None) -> Moments:
    """Moments of samples F (N, n) and M (N, m)."""
    weights = np.ones(len(photo)) if weights is None else weights
    joint = np.concatenate([photo, model], axis=1)
    mean = weights @ joint / weights.sum()
    centred = joint - mean
    covariance = (weights[:, None] * centred).T @ centred / weights.sum()
    return Moments(len(photo), weights.sum(), mean, covariance, photo.shape[1])


def make_samples(seed: int, n: int, m: int, noise: float = 1.0):
    """Correlated samples of a photo and a model, none of them degenerate."""
    random = np.random.default_rng(seed)
    model = random.normal(size=(400, m)) @ well_conditioned(random, m) + random.normal(size=m)
    photo = model @ random.normal(size=(m, n)) + noise * random.normal(size=(400, n))
    return random, photo, model


def well_conditioned(random, size: int):
    """A regular matrix with a condition number of at most 10."""
    u, _, vt = np.linalg.svd(random.normal(size=(size, size)))
    return u @ np.diag(random.uniform(0.3, 3.0, size)) @ vt


@given(SEEDS, CHANNELS)
def test_loss_is_the_least_squares_residual_in_the_mahalanobis_norm(seed, channels):
    n, m = channels
    random, photo, model = make_samples(seed, n, m)
    weights = random.uniform(0.1, 1.0, len(photo))
    root = np.sqrt(weights)[:, None]
    design = np.concatenate([model, np.ones((len(model), 1))], axis=1)
    solution = np.linalg.lstsq(root * design, root * photo, rcond=None)[0]
    residual = photo - design @ solution
    moments = make_moments(photo, model, weights)
    metric = np.linalg.inv(moments.covariance[:n, :n])
    mahalanobis = np.einsum("p,pi,ij,pj", weights, residual, metric, residual) / weights.sum()
    # E |F - AM - b|^2 in the metric C_FF^-1 is n - trace; the loss counts from min(n, m).
    assert lighting_loss(moments) == pytest.approx(min(n, m) - n + mahalanobis, abs=1e-8)
    gain, offset = recover_lighting(moments)
    assert gain == pytest.approx(solution[:-1].T, abs=1e-7)
    assert offset == pytest.approx(solution[-1], abs=1e-7)


@given(SEEDS, CHANNELS)
def test_loss_is_symmetric_and_unchanged_by_regular_affine_changes(seed, channels):
    n, m = channels
    random, photo, model = make_samples(seed, n, m)
    loss = lighting_loss(make_moments(photo, model))
    assert 0.0 <= loss <= min(n, m)
    other_photo = photo @ well_conditioned(random, n) + random.normal(size=n)
    other_model = model @ well_conditioned(random, m) + random.normal(size=m)
    assert lighting_loss(make_moments(other_photo, model)) == pytest.approx(loss, abs=1e-8)
    assert lighting_loss(make_moments(photo, other_model)) == pytest.approx(loss, abs=1e-8)
    assert lighting_loss(make_moments(-photo, model)) == pytest.approx(loss, abs=1e-8)
    assert lighting_loss(make_moments(model, photo)) == pytest.approx(loss, abs=1e-9)


@pytest.mark.parametrize("n", [1, 3])
def test_a_constant_photo_is_not_explained(n):
    random, photo, model = make_samples(0, n, 4)
    photo[:] = random.uniform(size=n)
    assert lighting_loss(make_moments(photo, model)) == n


def test_a_constant_reflectance_leaves_the_normals():
    random = np.random.default_rng(0)
    normals = random.normal(size=(300, 3))
    model = np.concatenate([np.full((300, 1), 0.7), 0.7 * normals], axis=1)
    photo = normals @ random.normal(size=(3, 1)) + 0.2
    assert lighting_loss(make_moments(photo, model)) < 1e-9


def test_a_linearly_dependent_attribute_changes_nothing():
    _, photo, model = make_samples(1, 3, 4)
    doubled = np.concatenate([model, model[:, :2] @ np.ones((2, 1))], axis=1)
    expected = lighting_loss(make_moments(photo, model))
    assert lighting_loss(make_moments(photo, doubled)) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("pixels", [0, 19])
def test_too_few_pixels_cost_the_most(pixels):
    random = np.random.default_rng(0)
    joint = random.normal(size=(max(pixels, 1), 5))
    moments = make_moments(joint[:, :1], joint[:, 1:])
    moments = Moments(pixels, float(pixels), moments.mean, moments.covariance, 1)
    assert lighting_loss(moments) == 1.0
