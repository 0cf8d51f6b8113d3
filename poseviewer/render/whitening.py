"""A covariance as its inverse root, on its range: what correlations are taken with."""

from __future__ import annotations

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.render.kernel_correlations import squared_correlations, whiten

_NOT_KNOWN = np.empty((0, 0))


def whitening(covariance: FloatArray, mean: FloatArray) -> FloatArray:
    """W (rank, k) with ``W C W^T = I`` on the range of the covariance C (k, k).

    ``W^T W`` is the pseudo-inverse of C, in which ``kernel_correlations.CONSTANT_VARIANCE`` and
    ``RANK_TOLERANCE`` apply to the correlation matrix: a channel measured in other units is not a
    smaller channel.
    """
    return whiten(np.ascontiguousarray(covariance), np.ascontiguousarray(mean))


def canonical_correlations(
    n: int, mean: FloatArray, covariance: FloatArray, photo: FloatArray | None
) -> FloatArray:
    """The squares of the canonical correlations of the first n variables with the others, from
    their joint ``mean`` (k,) and ``covariance`` (k, k): the least first, as many as the lesser rank
    of the two. ``photo`` is the ``whitening`` of the first n, where it is known.
    """
    return squared_correlations(n, mean, covariance, _NOT_KNOWN if photo is None else photo)
