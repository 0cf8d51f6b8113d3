"""What the classes and edges of a photo are compared with: sums by class, and a field of edges."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.kernel_compiler import kernel

_jit: Any = kernel()
_fast_jit: Any = kernel(fastmath=True)


@_jit
def class_sums(box, ids, reflectance, normals, weights, photo, labels, classes, coloured, grey):
    """How many pixels count, and sums of ``F M^T`` (n + classes, m), M (m,) and ``M M^T`` (m, m).

    F is the ``photo`` (n, height, width), and the memberships in the classes.

    M is ``(k, k n)`` of each colour k where ``coloured``, else the three colours and ``g n`` of
    their grey g; and last the 1 of a pixel that the model covers. Outside ``box``, and where
    ``ids`` (height, width) are negative, it does not.
    """
    size = 13 if coloured else 7
    channels = photo.shape[0]
    joint, second = np.zeros((channels + classes, size)), np.zeros((size, size))
    m = np.zeros(size)
    m[size - 1] = 1.0
    pixels = 0
    left, top, right, bottom = box
    for row in range(top, bottom):
        for column in range(left, right):
            weight = np.float64(weights[row, column])
            if ids[row, column] < 0 or not weight > 0.0:
                continue
            pixels += 1
            colour, normal = reflectance[row, column], normals[row, column]
            shade = colour[0] * grey[0] + colour[1] * grey[1] + colour[2] * grey[2]
            for axis in range(3):
                if not coloured:
                    m[axis], m[3 + axis] = colour[axis], shade * normal[axis]
                    continue
                m[4 * axis] = colour[axis]
                for k in range(3):
                    m[4 * axis + 1 + k] = colour[axis] * normal[k]
            label = channels + labels[row, column]
            for i in range(size):
                weighted = weight * m[i]
                joint[label, i] += weighted
                for channel in range(channels):
                    joint[channel, i] += weighted * photo[channel, row, column]
                for j in range(i + 1):
                    second[i, j] += weighted * m[j]
    for i in range(size):
        for j in range(i):
            second[j, i] = second[i, j]
    return pixels, joint, joint[channels:].sum(axis=0), second


@_jit
def attribute_planes(box, part, ids, reflectance, normals, grey):
    """(5, height + 2, width + 2) of the ``part`` (left, top, right, bottom) of the picture.

    Grey reflectance, normal and coverage, one after the other; zeros where the model is not, and in
    a rim of one pixel. Nothing is covered outside ``box``.
    """
    left, top, right, bottom = part
    planes = np.zeros((5, bottom - top + 2, right - left + 2), np.float32)
    for row in range(box[1], box[3]):
        for column in range(box[0], box[2]):
            if ids[row, column] < 0:
                continue
            v, u = row - top + 1, column - left + 1
            colour = reflectance[row, column]
            planes[0, v, u] = colour[0] * grey[0] + colour[1] * grey[1] + colour[2] * grey[2]
            for axis in range(3):
                planes[1 + axis, v, u] = normals[row, column, axis]
            planes[4, v, u] = 1.0
    return planes


@_fast_jit
def orientation(planes, noise):
    """(height, width, 2): the orientation field of attributes (q, height + 2, width + 2).

    Gradients by Sobel's operator, per px.
    """
    count, height, width = planes.shape[0], planes.shape[1] - 2, planes.shape[2] - 2
    field = np.empty((height, width, 2), np.float32)
    xx, yy = np.empty(width, np.float32), np.empty(width, np.float32)
    xy = np.empty(width, np.float32)
    least = np.float32(noise * noise)
    two, eighth = np.float32(2.0), np.float32(0.125)
    for row in range(height):
        xx[:], yy[:], xy[:] = least, np.float32(0.0), np.float32(0.0)
        for k in range(count):
            above, here, below = planes[k, row], planes[k, row + 1], planes[k, row + 2]
            for u in range(width):
                middle = two * (here[u + 2] - here[u])
                across = eighth * (above[u + 2] - above[u] + middle + below[u + 2] - below[u])
                middle = two * (below[u + 1] - above[u + 1])
                down = eighth * (below[u] - above[u] + middle + below[u + 2] - above[u + 2])
                xx[u] += across * across
                yy[u] += down * down
                xy[u] += across * down
        for u in range(width):
            share = np.float32(1.0) / (xx[u] + yy[u])
            field[row, u, 0] = (xx[u] - least - yy[u]) * share
            field[row, u, 1] = two * xy[u] * share
    return field
