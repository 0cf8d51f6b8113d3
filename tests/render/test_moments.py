"""Moments summed over the model's pixels against NumPy's over the whole region."""

import numpy as np
import pytest

from poseviewer.render.attributes import AttributeImage, PhotoAttributes
from poseviewer.render.moments import model_attributes, moments_of_images

SHAPE = 30, 40


@pytest.mark.parametrize("clipped", [True, False])
@pytest.mark.parametrize("colours", [True, False])
def test_moments_are_weighted_means_and_covariances(clipped, colours):
    random = np.random.default_rng(0)
    faces = random.integers(-1, 3, SHAPE).astype(np.int32)
    on_model = (faces >= 0)[..., None]
    normals = random.normal(size=(*SHAPE, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    image = AttributeImage(
        faces,
        (on_model * random.random((*SHAPE, 3))).astype(np.float32),
        (on_model * normals).astype(np.float32),
    )
    weights = np.maximum(random.uniform(-0.5, 1.0, SHAPE), 0.0).astype(np.float32)
    photo = PhotoAttributes(
        random.random((*SHAPE, 3), np.float32), weights, clipped, colour_reflectance=colours
    )
    found = moments_of_images(image, photo)
    region = (weights > 0.0) & (image.mask if clipped else True)
    joint = np.concatenate([photo.channels, model_attributes(image, photo)], axis=-1)[region]
    assert found.pixels == np.count_nonzero(image.mask & (weights > 0.0))
    assert found.weight == pytest.approx(weights[region].sum(dtype=float))
    np.testing.assert_allclose(found.mean, np.average(joint, axis=0, weights=weights[region]))
    wanted = np.cov(joint.T, aweights=weights[region].astype(float), ddof=0)
    np.testing.assert_allclose(found.covariance, wanted, atol=1e-12)
