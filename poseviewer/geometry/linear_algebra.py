"""Whitening and canonical correlations of small covariance matrices, in plain NumPy."""

import numpy as np

from poseviewer.geometry.arrays import FloatArray

CONSTANT_VARIANCE = 1e-12
"""A channel whose variance is below this share of its mean square counts as constant."""
RANK_TOLERANCE = 1e-7
"""Share of the largest eigenvalue below which one counts as zero: float32 is no more exact."""


def whiten(covariance: FloatArray, mean: FloatArray) -> FloatArray:
    """Return W (rank, k) with ``W C W^T = I`` on the range of the covariance C (k, k).

    ``W^T W`` is the pseudo-inverse of C, in which tolerances apply to the correlation matrix, so
    that a channel's unit does not matter. The rounding of a channel that hardly varies is the
    tolerance where it weighs more than ``RANK_TOLERANCE``.
    """
    variance = covariance.diagonal()
    rounding = CONSTANT_VARIANCE * (variance + mean * mean)
    varies = variance > rounding
    if not varies.all():
        part = whiten(covariance[np.ix_(varies, varies)], mean[varies])
        whitening = np.zeros((len(part), len(mean)))
        whitening[:, varies] = part
        return whitening
    if not len(mean):
        return np.zeros((0, 0))
    scale = 1.0 / np.sqrt(variance)
    values, vectors = np.linalg.eigh(covariance * scale * scale[:, None])
    limit = max(RANK_TOLERANCE, (rounding * scale * scale).max()) * values[-1]
    first = int(values.searchsorted(limit, "right"))  # eigenvalues ascend
    return vectors.T[first:] * scale / np.sqrt(values[first:, None])


def canonical_correlations_squared(
    mean: FloatArray, covariance: FloatArray, n: int, photo_whitening: FloatArray | None = None
) -> FloatArray:
    """Square the canonical correlations (min(n, m),) of F and M: ascending, in [0, 1] but rounded.

    They are the eigenvalues of ``K^T K`` with ``K = W_F C_FM W_M^T``.

    Args:
        mean: (n + m,) of the channels, those of F first.
        covariance: (n + m, n + m) of the channels.
        n: number of channels of F.
        photo_whitening: W_F (rank, n), if it is known.
    """
    if photo_whitening is None:
        photo_whitening = whiten(covariance[:n, :n], mean[:n])
    model_whitening = whiten(covariance[n:, n:], mean[n:])
    joint = photo_whitening @ covariance[:n, n:] @ model_whitening.T
    if joint.shape[0] > joint.shape[1]:
        joint = joint.T
    squares = np.asarray(np.linalg.eigvalsh(joint @ joint.T), float)
    missing = min(n, len(mean) - n) - len(squares)
    return np.concatenate([np.zeros(missing), squares]) if missing else squares
