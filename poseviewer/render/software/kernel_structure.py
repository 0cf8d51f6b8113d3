"""What the classes and edges of a photo are compared with: sums by class, and a field of edges.

Both are taken from planes of attributes (unit normals, grey reflectance, coverage, and R, G, B),
with a rim of one pixel of zeros, see ``kernel_attributes.fill_planes``.
``spans`` (height, 2) are the columns of each row that the model is in, ends excluded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.software.kernel_compiler import kernel
from poseviewer.render.software.kernel_moments import turn

GREY, COVERAGE, RED = 3, 4, 5  # planes; 0 to 2 are the normal
PLANES, EDGE_PLANES = 8, 5  # edges are found in the first five
COLOURED = 13  # attributes, where each colour has shades of its own

_jit: Any = kernel()
# Sums alone may be taken in another order (lanes of a vector).
_jit_sums: Any = kernel(fastmath={"reassoc", "contract", "nsz", "nnan"})
_fast_jit: Any = kernel(fastmath=True)


@_jit
def class_sums(spans, planes, weights, photo, labels, rotation, run, joint, second):
    """Sums of ``F M^T`` (n + classes, m) and ``M M^T`` (m, m); returns how many pixels count.

    F is the ``photo`` (n, height, width), and the memberships in the classes. M (13,) is
    ``(k, k n)`` of each colour k, or (7,) the three colours and ``g n`` of their grey g; last the 1
    of a pixel that the model covers. The normal n is turned by ``rotation`` (3, 3). ``run``
    (n + m + 1, width) float64 is room for a row.
    """
    channels, size = photo.shape[0], second.shape[0]
    first, step = (1, 4) if size == COLOURED else (3, size)  # where the shades of a colour are
    joint[:], second[:] = 0.0, 0.0
    pixels = 0
    for row in range(spans.shape[0]):
        begin, end = spans[row, 0], spans[row, 1]
        if begin == end:
            continue
        pixels += _fill_row(row, begin, end, planes, weights, photo, size, run)
        _add_products(end - begin, channels, size, run, joint, second)
        _add_classes(labels[row, begin:end], channels, size, run, joint)
    for i in range(size):
        for j in range(i):
            second[j, i] = second[i, j]
    for at in range(first, size - 1, step):
        for i in range(joint.shape[0]):
            turn(rotation, joint[i, at : at + 3])
        for i in range(size):
            turn(rotation, second[i, at : at + 3])
    for at in range(first, size - 1, step):
        for i in range(size):
            turn(rotation, second[at : at + 3, i])
    return pixels


@_jit_sums
def _fill_row(row, begin, end, planes, weights, photo, attributes, run):
    """Into ``run``: M, m rows, its last the weight, then F weighted, n rows; 0 without weight."""
    size, ones = end - begin, run[attributes - 1, : end - begin]
    covered = planes[COVERAGE, row + 1, begin + 1 : end + 1]
    weight = weights[row, begin:end]
    pixels = 0
    for p in range(size):
        counts = (weight[p] > np.float32(0.0)) & (covered[p] > np.float32(0.0))
        ones[p] = np.float64(weight[p]) if counts else 0.0
        pixels += 1 if counts else 0
    coloured = attributes == COLOURED
    for channel in range(3):
        colour = planes[RED + channel, row + 1, begin + 1 : end + 1]
        k = run[4 * channel if coloured else channel, :size]
        for p in range(size):
            k[p] = np.float64(colour[p])
    for block in range(3 if coloured else 1):
        shade = planes[RED + block if coloured else GREY, row + 1, begin + 1 : end + 1]
        for axis in range(3):
            normal = planes[axis, row + 1, begin + 1 : end + 1]
            lit = run[(4 * block + 1 if coloured else 3) + axis, :size]
            for p in range(size):
                lit[p] = np.float64(shade[p]) * np.float64(normal[p])
    for channel in range(photo.shape[0]):
        value, seen = run[attributes + channel, :size], photo[channel, row, begin:end]
        for p in range(size):
            value[p] = np.float64(seen[p]) * ones[p] if ones[p] > 0.0 else 0.0
    return pixels


@_jit_sums
def _add_products(length, channels, size, run, joint, second):
    ones = run[size - 1, :length]
    weighted = run[size + channels, :length]
    for i in range(size):
        mine = run[i, :length]
        for p in range(length):
            weighted[p] = mine[p] * ones[p] if i < size - 1 else mine[p]
        for j in range(min(i, size - 2) + 1):
            other, product = run[j, :length], 0.0
            for p in range(length):
                product += weighted[p] * other[p]
            second[i, j] += product
    total = 0.0
    for p in range(length):
        total += ones[p]
    second[size - 1, size - 1] += total
    for channel in range(channels):
        seen, total = run[size + channel, :length], 0.0
        for p in range(length):
            total += seen[p]
        joint[channel, size - 1] += total
        for i in range(size - 1):
            mine, product = run[i, :length], 0.0
            for p in range(length):
                product += seen[p] * mine[p]
            joint[channel, i] += product


@_jit
def _add_classes(labels, channels, size, run, joint):
    for p in range(labels.shape[0]):
        label, weight = np.uint64(channels + np.int64(labels[p])), run[size - 1, p]
        for i in range(size - 1):
            joint[label, i] += weight * run[i, p]
        joint[label, size - 1] += weight


@_jit
def edge_sums(spans, planes, noise, taps, weights, target, room, across):
    """Sums over P of ``e target`` and of ``w e^2``, of the model's orientation field e, blurred.

    ``target`` (2, height, width) is the photo's field times its weights. The blur is the
    convolution along columns and rows with the symmetric kernel that ``taps`` (r + 1,) float32 are
    the right half of. ``room`` (5, width + 2 r) and ``across`` (2, height, width) float32 are room.
    """
    height, width = weights.shape
    reach = taps.shape[0] - 1
    first, last, left, right = _span_of_all(spans, width)
    if first >= last:
        return 0.0, 0.0
    first, last = max(first - 1, 0), min(last + 1, height)
    left, right = max(left - 1 - reach, 0), min(right + 1 + reach, width)
    for row in range(first, last):
        begin, end = _span_about(row, spans, width)
        room[0], room[1] = np.float32(0.0), np.float32(0.0)
        if begin < end:
            _orientation(row, begin, end, planes, noise, room, reach)
        for axis in range(2):
            _blur(room[axis, left : right + 2 * reach], taps, across[axis, row, left:right])
    likeness, length = 0.0, 0.0
    for row in range(max(first - reach, 0), min(last + reach, height)):
        for axis in range(2):
            total = room[axis, : right - left]
            _add_rows(row, first, last, left, right, taps, across[axis], total)
            one, other = _dot(total, target[axis, row, left:right], weights[row, left:right])
            likeness += one
            length += other
    return likeness, length


@_jit
def _span_of_all(spans, width):
    first, last, left, right = spans.shape[0], 0, width, 0
    for row in range(spans.shape[0]):
        if spans[row, 0] < spans[row, 1]:
            first, last = min(first, row), row + 1
            left, right = min(left, spans[row, 0]), max(right, spans[row, 1])
    return first, last, left, right


@_jit
def _span_about(row, spans, width):
    """Columns of a row that have the model within a pixel, in the picture; ends excluded."""
    begin, end = width, 0
    for other in range(max(row - 1, 0), min(row + 2, spans.shape[0])):
        if spans[other, 0] < spans[other, 1]:
            begin, end = min(begin, spans[other, 0]), max(end, spans[other, 1])
    return max(begin - 1, 0), min(end + 1, width)


@_fast_jit
def _orientation(row, begin, end, planes, noise, room, reach):
    """The field, by Sobel's operator, into the first two rows of ``room``, ``reach`` px on."""
    size = end - begin
    xx, yy, xy = room[2, :size], room[3, :size], room[4, :size]
    xx[:], yy[:], xy[:] = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    two = np.float32(2.0)
    for k in range(EDGE_PLANES):
        above = planes[k, row, begin : end + 2]
        here = planes[k, row + 1, begin : end + 2]
        below = planes[k, row + 2, begin : end + 2]
        for u in range(size):
            middle = two * (here[u + 2] - here[u])
            dx = above[u + 2] - above[u] + middle + below[u + 2] - below[u]
            middle = two * (below[u + 1] - above[u + 1])
            dy = below[u] - above[u] + middle + below[u + 2] - above[u + 2]
            xx[u] += dx * dx
            yy[u] += dy * dy
            xy[u] += dx * dy
    least = np.float32(64.0 * noise * noise)  # the operator's gradients are 8 times those per px
    one, other = room[0, begin + reach : end + reach], room[1, begin + reach : end + reach]
    for u in range(size):
        share = np.float32(1.0) / (xx[u] + yy[u] + least)
        one[u] = (xx[u] - yy[u]) * share
        other[u] = two * xy[u] * share


@_fast_jit
def _blur(values, taps, out):
    """A row blurred; ``values`` reach beyond ``out`` on both sides."""
    reach = taps.shape[0] - 1
    for u in range(out.shape[0]):
        out[u] = taps[0] * values[u + reach]
    for k in range(1, taps.shape[0]):
        before, after, share = values[reach - k :], values[reach + k :], taps[k]
        for u in range(out.shape[0]):
            out[u] += share * (before[u] + after[u])


@_fast_jit
def _add_rows(row, first, last, left, right, taps, across, total):
    """The blur along a column, for a row of pixels."""
    reach = taps.shape[0] - 1
    total[:] = np.float32(0.0)
    for other in range(max(row - reach, first), min(row + reach + 1, last)):
        values, share = across[other, left:right], taps[abs(other - row)]
        for u in range(total.shape[0]):
            total[u] += share * values[u]


@_fast_jit
def _dot(values, target, weights):
    likeness, length = np.float32(0.0), np.float32(0.0)
    for u in range(values.shape[0]):
        likeness += values[u] * target[u]
        length += weights[u] * values[u] * values[u]
    return np.float64(likeness), np.float64(length)
