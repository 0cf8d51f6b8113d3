"""A covariance as its inverse root, on its range: what correlations are taken with."""

from __future__ import annotations

import numpy as np

from poseviewer.geometry.arrays import FloatArray

CONSTANT_VARIANCE = 1e-12
"""A channel whose variance is below this share of its mean square counts as constant."""
RANK_TOLERANCE = 1e-7
"""Eigenvalues of a correlation matrix below this share of the greatest count as zero: sums in
float32 are no more exact, and no light is so strong that what varies 3,000 times less than the
rest would show. Where a channel varies so little that its rounding to float32 weighs more, that is
the limit."""


def whitening(covariance: FloatArray, mean: FloatArray) -> FloatArray:
    """W (rank, k) with ``W C W^T = I`` on the range of the covariance C (k, k).

    ``W^T W`` is the pseudo-inverse of C, in which tolerances apply to the correlation matrix: a
    channel measured in other units is not a smaller channel.
    """
    variance = covariance.diagonal()
    rounding = CONSTANT_VARIANCE * (variance + mean * mean)
    varies = variance > rounding
    scale = varies / np.sqrt(np.where(varies, variance, 1.0))
    values, vectors = np.linalg.eigh(covariance * scale[:, None] * scale)
    noise = float((rounding * scale * scale).max())
    kept = values > max(RANK_TOLERANCE, noise) * max(float(values[-1]), 0.0)
    if not kept.all():
        values, vectors = values[kept], vectors[:, kept]
    return (vectors / np.sqrt(values)).T * scale
