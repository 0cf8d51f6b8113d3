"""Which pixels count, packed and unpacked."""

import numpy as np
import pytest

from poseviewer.geometry.mask import Mask


@pytest.mark.parametrize("binary", [True, False])
def test_weights_come_back_to_the_last_bit(binary):
    random = np.random.default_rng(0)
    weights = random.random((37, 53)).astype(np.float32)
    weights = np.float32(weights > 0.5) if binary else weights
    mask = Mask.of(weights)
    assert (mask.width, mask.height) == (53, 37)
    assert mask.weights.dtype == np.float32
    assert np.array_equal(mask.weights, weights)
    assert not mask.weights.flags.writeable


@pytest.mark.parametrize("weights", [np.ones((3, 4, 3)), np.full((3, 4), 2.0), [[np.nan, 1.0]]])
def test_what_is_no_mask_is_refused(weights):
    with pytest.raises(ValueError, match="a mask of shape"):
        Mask.of(weights)
