"""Canonical correlations of small covariances: LAPACK's calls from Python take longer than they do.

The interpreter's lock is kept: to get it back would take longer, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.software.kernel_compiler import kernel

CONSTANT_VARIANCE = 1e-12
"""A channel whose variance is below this share of its mean square counts as constant."""
RANK_TOLERANCE = 1e-7
"""Eigenvalues of a correlation matrix below this share of the greatest count as zero: sums in
float32 are no more exact, and no light is so strong that what varies 3,000 times less than the
rest would show. Where a channel varies so little that its rounding to float32 weighs more, that is
the limit."""
SWEEPS = 30  # some eight are needed

_jit: Any = kernel(nogil=False)


@_jit
def whiten(covariance, mean):
    """W (rank, k) with ``W C W^T = I`` on the range of the covariance C (k, k).

    ``W^T W`` is the pseudo-inverse of C, in which tolerances apply to the correlation matrix: a
    channel measured in other units is not a smaller channel.
    """
    size = mean.shape[0]
    scale, correlation, vectors = np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    limit = RANK_TOLERANCE
    for i in range(size):
        variance = covariance[i, i]
        rounding = CONSTANT_VARIANCE * (variance + mean[i] * mean[i])
        if variance > rounding:
            scale[i] = 1.0 / np.sqrt(variance)
            limit = max(limit, rounding / variance)
    for i in range(size):
        for j in range(size):
            correlation[i, j] = covariance[i, j] * scale[i] * scale[j]
    _diagonalise(correlation, vectors)
    greatest = 0.0
    for i in range(size):
        greatest = max(greatest, correlation[i, i])
    whitened, rank = np.zeros((size, size)), 0
    for k in range(size):
        value = correlation[k, k]
        if value > limit * greatest:
            for i in range(size):
                whitened[rank, i] = vectors[i, k] * scale[i] / np.sqrt(value)
            rank += 1
    return whitened[:rank]


@_jit
def squared_correlations(mean, covariance, n, photo, is_known):
    """The squared canonical correlations of the first ``n`` channels with the m others.

    (min(n, m),), in no order, 0 where there is nothing to correlate; by rounding they may be a
    little beyond [0, 1]. ``photo`` (rank, n) whitens
    the first channels; used if ``is_known``. They are the eigenvalues of ``K^T K`` or ``K K^T``,
    with ``K = W_F C_FM W_M^T``.
    """
    m = mean.shape[0] - n
    model = whiten(covariance[n:, n:], mean[n:])
    if not is_known:
        photo = whiten(covariance[:n, :n], mean[:n])
    rows, columns = photo.shape[0], model.shape[0]
    half, joint = np.zeros((n, columns)), np.zeros((rows, columns))
    for i in range(n):
        for j in range(columns):
            for k in range(m):
                half[i, j] += covariance[i, n + k] * model[j, k]
    for i in range(rows):
        for j in range(columns):
            for k in range(n):
                joint[i, j] += photo[i, k] * half[k, j]
    short = joint if rows <= columns else joint.T
    count, length = short.shape
    gram, vectors, found = np.zeros((count, count)), np.zeros((count, count)), np.zeros(min(n, m))
    for i in range(count):
        for j in range(count):
            for k in range(length):
                gram[i, j] += short[i, k] * short[j, k]
    _diagonalise(gram, vectors)
    for i in range(count):
        found[i] = gram[i, i]
    return found


@_jit
def _diagonalise(matrix, vectors):
    """Jacobi's method (Golub and Van Loan, *Matrix Computations*, 8.5), in place.

    The symmetric ``matrix`` ends with its eigenvalues on the diagonal, ``vectors`` with its
    eigenvectors as columns.
    """
    size = matrix.shape[0]
    total = 0.0
    for i in range(size):
        for j in range(size):
            vectors[i, j] = 1.0 if i == j else 0.0
            total += matrix[i, j] * matrix[i, j]
    for _ in range(SWEEPS):
        rest = 0.0
        for p in range(size):
            for q in range(p):
                rest += matrix[p, q] * matrix[p, q]
        if rest <= 1e-30 * total:
            return
        for p in range(size):
            for q in range(p + 1, size):
                if matrix[p, q] != 0.0:
                    _rotate(matrix, vectors, p, q)


@_jit
def _rotate(matrix, vectors, p, q):
    """Turn in the plane of p and q so that their entry becomes zero."""
    ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    sign = 1.0 if ratio >= 0.0 else -1.0
    tangent = sign / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for i in range(matrix.shape[0]):
        one, other = matrix[i, p], matrix[i, q]
        matrix[i, p], matrix[i, q] = cosine * one - sine * other, sine * one + cosine * other
        one, other = vectors[i, p], vectors[i, q]
        vectors[i, p], vectors[i, q] = cosine * one - sine * other, sine * one + cosine * other
    for i in range(matrix.shape[0]):
        one, other = matrix[p, i], matrix[q, i]
        matrix[p, i], matrix[q, i] = cosine * one - sine * other, sine * one + cosine * other
