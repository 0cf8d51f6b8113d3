"""From the rasteriser's sums to moments: matrices so small that NumPy's calls would count."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.software.kernel_compiler import kernel

_jit: Any = kernel()


@_jit
def turn(rotation, vector):
    """``rotation`` (3, 3) times ``vector`` (3,), in place."""
    x, y, z = vector[0], vector[1], vector[2]
    for i in range(3):
        vector[i] = rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z


@_jit
def as_moments(n, weight, first, second, origin, rotation):
    """Mean (n + m,) and covariance (n + m, n + m) from sums about ``origin``, normals turned by
    ``rotation`` (3, 3). ``second`` is used up.
    """
    size = first.shape[0]
    mean = first / weight
    for i in range(size):
        for j in range(i + 1):
            second[i, j] = second[j, i] = second[i, j] / weight - mean[i] * mean[j]
    mean += origin
    for at in range(n + 1, size - 2, 4):
        turn(rotation, mean[at : at + 3])
        for i in range(size):
            turn(rotation, second[at : at + 3, i])
        for i in range(size):
            turn(rotation, second[i, at : at + 3])
    for i in range(size):
        for j in range(i):
            second[i, j] = second[j, i]
    return mean, second


@_jit
def add_surroundings(n, weight, first, second, origin, region_first, region_second):
    """Make sums over the model's pixels, of ``weight``, sums over the region around it too.

    Beside the model all its attributes are 0: their origin becomes 0. What F alone adds is
    ``region_first`` (n,) and ``region_second`` (n, n).
    """
    size = first.shape[0]
    for i in range(n, size):
        for j in range(i + 1):
            shift = origin[i] * first[j] + first[i] * origin[j] if j >= n else origin[i] * first[j]
            second[i, j] += shift + (weight * origin[i] * origin[j] if j >= n else 0.0)
    for i in range(n, size):
        first[i] += weight * origin[i]
        origin[i] = 0.0
    for i in range(n):
        first[i] = region_first[i]
        for j in range(n):
            second[i, j] = region_second[i, j]


@_jit
def of_classes(weight, photo_mean, photo_covariance, joint, second):
    """Mean (n + m,) and covariance (n + m, n + m), where F's are known.

    ``joint`` (n, m) and ``second`` (m, m) are sums of ``F M^T`` and ``M M^T``; the last attribute
    of M is 1 where it is summed, and so the last row of ``second`` is the sum of M.
    """
    n, m = joint.shape
    mean, covariance = np.zeros(n + m), np.zeros((n + m, n + m))
    if weight <= 0.0:
        return mean, covariance
    share = 1.0 / weight
    for j in range(m):
        mean[n + j] = share * second[m - 1, j]
    for i in range(n):
        mean[i] = photo_mean[i]
        for j in range(n):
            covariance[i, j] = photo_covariance[i, j]
        for j in range(m):
            covariance[i, n + j] = share * joint[i, j] - mean[i] * mean[n + j]
            covariance[n + j, i] = covariance[i, n + j]
    for i in range(m):
        for j in range(m):
            covariance[n + i, n + j] = share * second[i, j] - mean[n + i] * mean[n + j]
    return mean, covariance
