"""The attributes of photo and model added up, row by row, while they are worked out.

No picture of them is made: what is needed of a row is made anew for each.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from poseviewer.render.software.kernel_attributes import TINY, fill_plain, fill_varied
from poseviewer.render.software.kernel_compiler import kernel

_jit: Any = kernel()
# Sums may be taken in another order (lanes of a vector); rows are short, so it costs nothing.
_jit_sums: Any = kernel(fastmath={"reassoc", "contract", "nsz", "nnan"})


@_jit
def accumulate(box, ids, of_faces, of_model, grey, photo, origin, model, room, first, second):
    """Add up ``w``, ``w x`` and the lower half of ``w x x^T`` over the visible pixels in ``box``.

    x = (F, M) - ``origin``: ``photo`` is (F (n, height, width), w (height, width)), ``model`` = m
    is 4 (grey, by the weights ``grey`` (3,)) or 12, or 1 more: the last attribute is then 1 on the
    model, and products of F with F are left out. Normals are those of the model's frame. ``origin``
    (n + m,) is given for F and set for M. ``of_faces`` and ``of_model`` are as for ``shade``;
    ``room`` is for a row of pixels: (3, width) float32, (width,) float64, (n + 14, width) float32,
    (3, width + 3) float32. Adds into ``first``
    (n + m,) and ``second`` (n + m, n + m); returns how many pixels of positive weight there were,
    and their weight.
    """
    planes, colours, varies = of_faces[0], of_faces[1], of_faces[2]
    normals, weighted, run, paint = room
    planar, weights = photo
    n = planar.shape[0]
    count, whole = (1 if model < 12 else 3), model in (5, 13)
    at_model = 1 + n
    left, top, right, bottom = box
    pixels, total = 0, 0.0
    for row in range(top, bottom):
        begin, end = left, right
        while begin < end and ids[row, begin] < 0:
            begin += 1
        while end > begin and ids[row, end - 1] < 0:
            end -= 1
        if begin == end:
            continue
        faces = ids[row, begin:end]
        seen, weight = _gather_photo(
            faces, weights[row, begin:end], planar, row, begin, origin, run
        )
        if seen == 0:
            continue
        fill_plain(row, begin, faces, planes, colours, count, normals, run, at_model)
        if varies:
            fill_varied(row, begin, faces, of_faces, grey, of_model, count, paint, run, at_model)
        _fill_products(end - begin, count, normals, run, at_model)
        if pixels == 0:
            _find_means(end - begin, weight, n, count, run, origin)
        _centre(end - begin, n, count, run, origin)
        _add_products(end - begin, n, count, whole, weighted, run, first, second)
        pixels += seen
        total += weight
    if whole:  # sums with the attribute that is 1 on the model are those without it
        last = n + 4 * count
        for i in range(last):
            second[last, i] += first[i]
        first[last] += total
        second[last, last] += total
    return pixels, total


@_jit_sums
def _gather_photo(faces, weights, planar, row, first, origin, run):
    """Fill a row's weights and photo attributes; returns the pixels that count, and their weight.

    What does not count is 0, even where the photo is not a number.
    """
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


@_jit_sums
def _fill_products(size, count, normals, run, at_model):
    """One over the normals' lengths, and reflectance times unit normals less their origin."""
    scale = run[at_model + 4 * count, :size]
    x, y, z = normals[0, :size], normals[1, :size], normals[2, :size]
    for p in range(size):
        square = x[p] * x[p] + y[p] * y[p] + z[p] * z[p]
        scale[p] = np.float32(1.0) / math.sqrt(max(square, TINY))
    for colour in range(count):
        at = at_model + 4 * colour
        k = run[at, :size]
        kx, ky, kz = run[at + 1, :size], run[at + 2, :size], run[at + 3, :size]
        for p in range(size):
            kx[p] = k[p] * (scale[p] * x[p])
            ky[p] = k[p] * (scale[p] * y[p])
            kz[p] = k[p] * (scale[p] * z[p])


@_jit_sums
def _find_means(size, weight, n, count, run, origin):
    """The model attributes' means over a row: sums about them keep their digits where the
    attributes hardly vary.
    """
    used = run[0, :size]
    for j in range(n, n + 4 * count):
        row, total = run[1 + j, :size], np.float32(0.0)
        for p in range(size):
            total += used[p] * row[p]
        origin[j] = np.float32(total / weight)


@_jit_sums
def _centre(size, n, count, run, origin):
    """Take model attributes about their origin."""
    for j in range(n, n + 4 * count):
        row, mean = run[1 + j, :size], np.float32(origin[j])
        for p in range(size):
            row[p] -= mean


@_jit_sums
def _add_products(length, n, count, whole, weighted, run, first, second):
    """Add the sums over a row of pixels, in float64: near-singular covariances need the digits."""
    weights, weighted = run[0, :length], weighted[:length]
    for i in range(n + 4 * count):
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
