"""From moments to correlations: matrices so small that NumPy's calls would count."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.kernel_compiler import kernel

CONSTANT_VARIANCE = 1e-12
"""A channel whose variance is below this share of its mean square counts as constant."""
RANK_TOLERANCE = 1e-7
"""Eigenvalues of a correlation matrix below this share of the greatest count as zero: sums in
float32 are no more exact, and no light is so strong that what varies 3,000 times less than the
rest would show. Where a channel varies so little that its rounding to float32 weighs more, that is
the limit."""

_jit: Any = kernel()


@_jit
def whiten(covariance, mean):
    """See ``whitening.whitening``."""
    size, noise = mean.shape[0], 0.0
    scale, correlation = np.zeros(size), np.empty((size, size))
    for i in range(size):
        variance = covariance[i, i]
        rounding = CONSTANT_VARIANCE * (variance + mean[i] * mean[i])
        if variance > rounding:
            scale[i] = 1.0 / np.sqrt(variance)
            noise = max(noise, rounding / variance)
    for i in range(size):
        for j in range(size):
            correlation[i, j] = covariance[i, j] * scale[i] * scale[j]
    values, vectors = np.linalg.eigh(correlation)
    least, first = max(RANK_TOLERANCE, noise) * max(values[-1], 0.0), 0
    while first < size and not values[first] > least:
        first += 1
    white = np.empty((size - first, size))
    for k in range(first, size):
        for j in range(size):
            white[k - first, j] = vectors[j, k] / np.sqrt(values[k]) * scale[j]
    return white


@_jit
def squared_correlations(n, mean, covariance, photo):
    """The squares of the canonical correlations between the first n variables and the others, the
    least first; as many as the lesser rank of the two.

    ``photo`` (rank, n) whitens the first n; with no row, that is found here.
    """
    if photo.shape[0] == 0:
        photo = whiten(covariance[:n, :n], mean[:n])
    model = whiten(covariance[n:, n:], mean[n:])
    rows, columns, size = photo.shape[0], model.shape[0], mean.shape[0] - n
    half = np.zeros((rows, size))
    for i in range(rows):
        for k in range(n):
            for j in range(size):
                half[i, j] += photo[i, k] * covariance[k, n + j]
    found = np.zeros((rows, columns))
    for i in range(rows):
        for j in range(columns):
            for k in range(size):
                found[i, j] += half[i, k] * model[j, k]
    if rows > columns:
        found = found.T.copy()
    rows, columns = found.shape
    products = np.zeros((rows, rows))
    for i in range(rows):
        for j in range(rows):
            for k in range(columns):
                products[i, j] += found[i, k] * found[j, k]
    return np.linalg.eigvalsh(products)
