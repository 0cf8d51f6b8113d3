"""Moments of photo and model, in one call for a pose. Arrays in, arrays out, without the GIL.

Between calls a thread waits for the interpreter's lock: with a call for each part of the work two
threads were no quicker than one on coarse pyramid levels.

``moments`` adds up attributes row by row, while they are computed. ``structure_sums`` compares a
photo's classes and edges with the model's, from planes of attributes with a rim of one pixel of
zeros, see ``shade.fill_planes``; ``spans`` (height, 2) are the columns of each row with the model.
"""

import math
from typing import Any

import numpy as np

from poseviewer.render.software.kernel import jit, jit_sums, kernel
from poseviewer.render.software.shade import (
    COVERAGE,
    GREY_REFLECTANCE,
    NORMAL,
    RED,
    TINY,
    fill_planes,
    fill_row,
    make_row,
    span,
)

EDGE_PLANES = 5
"""Planes in which edges are found: normal, grey reflectance and coverage."""

_jit_fast: Any = kernel(fastmath=True)


@jit
def moments(box, ids, of_faces, textures, photo, photo_origin, model, region, rotation):
    """Compute the moments of photo and model.

    Args:
        box: (left, top, right, bottom), ends excluded.
        ids: (height, width) int32 of the picture.
        of_faces: see ``shade``.
        textures: see ``shade``.
        photo: (F (n, height, width) float32, weights (height, width) float32).
        photo_origin: (n,), about which F is summed.
        model: m, the number of attributes of the model: 4, or 5 with one that is 1 on the model.
        region: (whether P is the whole region, its ``PhotoSums``).
        rotation: (3, 3), camera from model, of the normals.

    Returns:
        Pixels, their weight, mean (n + m,) and covariance (n + m, n + m).
    """
    n = photo_origin.shape[0]
    size = n + model
    first, second = np.zeros(size), np.zeros((size, size))
    origin = np.zeros(size)
    for i in range(n):  # a slice's size is compared first, which takes long to compile
        origin[i] = photo_origin[i]
    pixels, weight = _accumulate(box, ids, of_faces, textures, photo, origin, model, first, second)
    is_whole, region_weight, region_first, region_second = region
    if is_whole:
        _add_surroundings(n, weight, first, second, origin, region_first, region_second)
        weight = region_weight
    if weight <= 0.0:
        return 0, 0.0, np.zeros(size), np.zeros((size, size))
    mean, covariance = _from_sums(n, weight, first, second, origin, rotation)
    return pixels, weight, mean, covariance


@jit
def _accumulate(box, ids, of_faces, textures, photo, origin, model, first, second):
    """Add up ``w``, ``w x`` and the lower half of ``w x x^T``; returns pixels and their weight."""
    # x = (F, M) - ``origin`` (n + m,), which is given for F and set for M; products of F with F are
    # left out where P is not the model's.
    planar, weights = photo
    n, weighted = planar.shape[0], np.empty(ids.shape[1])
    of_row = normals, run, _ = make_row(ids.shape[1], n + 6)
    whole, at_model = model == 5, 1 + n
    left, top, right, bottom = box
    pixels, total = 0, 0.0
    for row in range(top, bottom):
        begin, end = span(ids, row, left, right)
        if begin == end:
            continue
        faces = ids[row, begin:end]
        seen, weight = _gather_photo(
            faces, weights[row, begin:end], planar, row, begin, origin, run
        )
        if seen == 0:
            continue
        fill_row(row, begin, faces, of_faces, textures, of_row, at_model)
        _fill_products(end - begin, normals, run, at_model)
        _centre(end - begin, weight if pixels == 0 else 0.0, n, run, origin)
        _add_row(end - begin, n, whole, weighted, run, first, second)
        pixels += seen
        total += weight
    if whole:  # sums with the attribute that is 1 on the model are those without it
        last = n + 4
        for i in range(last):
            second[last, i] += first[i]
        first[last] += total
        second[last, last] += total
    return pixels, total


@jit_sums
def _gather_photo(faces, weights, planar, row, first, origin, run):
    """Write a row's weights and F, 0 where none counts; returns their number and weight."""
    zero, length = np.float32(0.0), faces.shape[0]
    total, pixels = 0.0, np.int32(0)
    used = run[0, :length]
    for p in range(length):
        w = weights[p]
        counts = (w > zero) & (faces[p] >= 0)
        w = w if counts else zero
        used[p] = w
        total += np.float64(w)
        pixels += np.int32(1) if counts else np.int32(0)
    for k in range(planar.shape[0]):
        mean, out = np.float32(origin[k]), run[1 + k, :length]
        channel = planar[k, row, first : first + length]
        for p in range(length):
            value = channel[p] - mean
            out[p] = value if used[p] > zero else zero
    return pixels, total


@jit_sums
def _fill_products(size, normals, run, at_model):
    """Write one over the normals' lengths, and reflectance times unit normals."""
    scale = run[at_model + 4, :size]
    x, y = normals[0, :size], normals[1, :size]
    z = normals[2, :size]
    for p in range(size):
        square = x[p] * x[p] + y[p] * y[p] + z[p] * z[p]
        scale[p] = np.float32(1.0) / math.sqrt(max(square, TINY))
    k, kx = run[at_model, :size], run[at_model + 1, :size]
    ky, kz = run[at_model + 2, :size], run[at_model + 3, :size]
    for p in range(size):
        kx[p] = k[p] * (scale[p] * x[p])
        ky[p] = k[p] * (scale[p] * y[p])
        kz[p] = k[p] * (scale[p] * z[p])


@jit_sums
def _centre(size, weight, n, run, origin):
    """Take model attributes about the first row's means, so that sums of them keep their digits."""
    used = run[0, :size]
    for j in range(n, n + 4):
        row, total = run[1 + j, :size], np.float32(0.0)
        if weight > 0.0:
            for p in range(size):
                total += used[p] * row[p]
            origin[j] = np.float32(total / weight)
        mean = np.float32(origin[j])
        for p in range(size):
            row[p] -= mean


@jit_sums
def _add_row(length, n, whole, weighted, run, first, second):
    """Add the sums over a row of pixels, in float64: near-singular covariances need the digits."""
    weights, weighted = run[0, :length], weighted[:length]
    for i in range(n + 4):
        row, mine = run[1 + i, :length], 0.0
        for p in range(length):
            weighted[p] = np.float64(weights[p]) * np.float64(row[p])
            mine += weighted[p]
        first[i] += mine
        if whole and i < n:
            continue
        for j in range(i + 1):
            other, product = run[1 + j, :length], 0.0
            for p in range(length):
                product += weighted[p] * np.float64(other[p])
            second[i, j] += product


@jit
def _rotate(rotation, vector):
    """Multiply ``rotation`` (3, 3) by ``vector`` (3,), in place."""
    x, y = vector[0], vector[1]
    z = vector[2]
    for i in range(3):
        vector[i] = rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z


@jit
def _from_sums(n, weight, first, second, origin, rotation):
    """Compute mean and covariance from sums about ``origin``, with rotated normals."""
    size = first.shape[0]
    mean = first / weight
    for i in range(size):
        for j in range(i + 1):
            second[i, j] = second[j, i] = second[i, j] / weight - mean[i] * mean[j]
    mean += origin
    at = n + 1
    _rotate(rotation, mean[at : at + 3])
    for i in range(size):
        _rotate(rotation, second[at : at + 3, i])
    for i in range(size):
        _rotate(rotation, second[i, at : at + 3])
    for i in range(size):
        for j in range(i):
            second[i, j] = second[j, i]
    return mean, second


@jit
def _add_surroundings(n, weight, first, second, origin, region_first, region_second):
    """Extend sums over the model's pixels to the region around, where M is 0 and the origin too."""
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


@jit
def structure_sums(box, ids, of_faces, textures, photo, target, rotation, noise, taps, workspace):
    """Compute sums where classes and edges are compared.

    F are the channels and memberships, M the colours, grey times normal, and 1; e is the model's
    orientation field.

    Args:
        box: (left, top, right, bottom), ends excluded.
        ids: (height, width) int32 of the picture.
        of_faces: see ``shade``.
        textures: see ``shade``.
        photo: (channels (n, height, width) float32, labels (height, width) uint8, number of
            classes, weights (height, width) float32).
        target: (2, height, width) float32, the photo's weighted field.
        rotation: (3, 3), camera from model, of the normals.
        noise: gradient below which there is no edge.
        taps: (r + 1,) float32, the right half of e's blur.
        workspace: spans and planes as the last call left them, and (2, height, width) float32.

    Returns:
        Pixels that count; sums of ``F M^T`` (n + classes, 7), ``M M^T`` (7, 7), ``e target`` and
        ``w e^2``.
    """
    spans, planes, across = workspace
    channels, labels, classes, weights = photo
    fill_planes(box, ids, of_faces, textures, spans, planes)
    joint, second = np.zeros((channels.shape[0] + classes, 7)), np.zeros((7, 7))
    pixels = _class_sums(spans, planes, weights, channels, labels, rotation, joint, second)
    dot, square = _edge_sums(spans, planes, noise, taps, weights, target, across)
    return pixels, joint, second, dot, square


@jit
def _class_sums(spans, planes, weights, photo, labels, rotation, joint, second):
    """Add up ``F M^T`` and ``M M^T``; returns how many pixels count."""
    channels, size = photo.shape[0], second.shape[0]
    pixels = 0
    run = np.empty((joint.shape[0] + size + 1, weights.shape[1]))
    for row in range(spans.shape[0]):
        begin, end = spans[row, 0], spans[row, 1]
        if begin == end:
            continue
        pixels += _fill_products_row(row, begin, end, planes, weights, photo, size, run)
        _add_products(end - begin, channels, size, run, joint, second)
        _add_classes(labels[row, begin:end], channels, size, run, joint)
    for i in range(size):
        for j in range(i):
            second[j, i] = second[i, j]
    for i in range(joint.shape[0]):
        _rotate(rotation, joint[i, 3:6])
    for i in range(size):
        _rotate(rotation, second[i, 3:6])
    for i in range(size):
        _rotate(rotation, second[3:6, i])
    return pixels


@jit_sums
def _fill_products_row(row, begin, end, planes, weights, photo, attributes, run):
    """Write M, m rows, its last the weight, then F weighted, n rows; 0 without weight."""
    size, ones = end - begin, run[attributes - 1, : end - begin]
    covered = planes[COVERAGE, row + 1, begin + 1 : end + 1]
    weight = weights[row, begin:end]
    pixels = 0
    for p in range(size):
        counts = (weight[p] > np.float32(0.0)) & (covered[p] > np.float32(0.0))
        ones[p] = np.float64(weight[p]) if counts else 0.0
        pixels += 1 if counts else 0
    grey = planes[GREY_REFLECTANCE, row + 1, begin + 1 : end + 1]
    for k in range(3):
        colour, out = planes[RED + k, row + 1, begin + 1 : end + 1], run[k, :size]
        for p in range(size):
            out[p] = np.float64(colour[p])
        normal, lit = planes[NORMAL + k, row + 1, begin + 1 : end + 1], run[3 + k, :size]
        for p in range(size):
            lit[p] = np.float64(grey[p]) * np.float64(normal[p])
    for channel in range(photo.shape[0]):
        value, seen = run[attributes + channel, :size], photo[channel, row, begin:end]
        for p in range(size):
            value[p] = np.float64(seen[p]) * ones[p] if ones[p] > 0.0 else 0.0
    return pixels


@jit_sums
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


@jit
def _add_classes(labels, channels, size, run, joint):
    for p in range(labels.shape[0]):
        label, weight = np.uint64(channels + np.int64(labels[p])), run[size - 1, p]
        for i in range(size - 1):
            joint[label, i] += weight * run[i, p]
        joint[label, size - 1] += weight


@jit
def _edge_sums(spans, planes, noise, taps, weights, target, across):
    """Sum ``e target`` and ``w e^2`` over P, of the model's orientation field e, blurred."""
    height, width = weights.shape
    reach = taps.shape[0] - 1
    workspace = np.empty((5, width + 2 * reach), np.float32)
    first, last, left, right = _span_of_all(spans, width)
    if first >= last:
        return 0.0, 0.0
    first, last = max(first - 1, 0), min(last + 1, height)
    left, right = max(left - 1 - reach, 0), min(right + 1 + reach, width)
    for row in range(first, last):
        begin, end = _span_about(row, spans, width)
        workspace[0], workspace[1] = np.float32(0.0), np.float32(0.0)
        if begin < end:
            _orientation(row, begin, end, planes, noise, workspace, reach)
        for axis in range(2):
            _blur(workspace[axis, left : right + 2 * reach], taps, across[axis, row, left:right])
    dot, length = 0.0, 0.0
    for row in range(max(first - reach, 0), min(last + reach, height)):
        for axis in range(2):
            total = workspace[axis, : right - left]
            _add_rows(row, first, last, left, right, taps, across[axis], total)
            part, square = _dot(total, target[axis, row, left:right], weights[row, left:right])
            dot += part
            length += square
    return dot, length


@jit
def _span_of_all(spans, width):
    first, last = spans.shape[0], 0
    left, right = width, 0
    for row in range(spans.shape[0]):
        if spans[row, 0] < spans[row, 1]:
            first, last = min(first, row), row + 1
            left, right = min(left, spans[row, 0]), max(right, spans[row, 1])
    return first, last, left, right


@jit
def _span_about(row, spans, width):
    """Return the columns of a row that have the model within a pixel; ends excluded."""
    begin, end = width, 0
    for other in range(max(row - 1, 0), min(row + 2, spans.shape[0])):
        if spans[other, 0] < spans[other, 1]:
            begin, end = min(begin, spans[other, 0]), max(end, spans[other, 1])
    return max(begin - 1, 0), min(end + 1, width)


@_jit_fast
def _orientation(row, begin, end, planes, noise, workspace, reach):
    """Write the field, by Sobel's operator, to two rows of ``workspace``, from ``reach`` on."""
    size = end - begin
    xx, yy = workspace[2, :size], workspace[3, :size]
    xy = workspace[4, :size]
    xx[:], yy[:] = np.float32(0.0), np.float32(0.0)
    xy[:] = np.float32(0.0)
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
    e_x = workspace[0, begin + reach : end + reach]
    e_y = workspace[1, begin + reach : end + reach]
    for u in range(size):
        share = np.float32(1.0) / (xx[u] + yy[u] + least)
        e_x[u] = (xx[u] - yy[u]) * share
        e_y[u] = two * xy[u] * share


@_jit_fast
def _blur(values, taps, out):
    """Blur a row; ``values`` reach beyond ``out`` on both sides."""
    reach = taps.shape[0] - 1
    for u in range(out.shape[0]):
        out[u] = taps[0] * values[u + reach]
    for k in range(1, taps.shape[0]):
        before, after = values[reach - k :], values[reach + k :]
        share = taps[k]
        for u in range(out.shape[0]):
            out[u] += share * (before[u] + after[u])


@_jit_fast
def _add_rows(row, first, last, left, right, taps, across, total):
    """Blur along columns, for a row of pixels."""
    reach = taps.shape[0] - 1
    total[:] = np.float32(0.0)
    for other in range(max(row - reach, first), min(row + reach + 1, last)):
        values, share = across[other, left:right], taps[abs(other - row)]
        for u in range(total.shape[0]):
            total[u] += share * values[u]


@_jit_fast
def _dot(values, target, weights):
    dot, length = np.float32(0.0), np.float32(0.0)
    for u in range(values.shape[0]):
        dot += values[u] * target[u]
        length += weights[u] * values[u] * values[u]
    return np.float64(dot), np.float64(length)
