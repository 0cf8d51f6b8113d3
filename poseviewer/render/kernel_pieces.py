"""Large faces, and those that reach behind the camera or far outside the picture.

They are cut into triangles that ``kernel_coverage`` can draw; the numbers are those of its file.
Compiled code is kept per file, so nothing here calls into it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from poseviewer.render.kernel_compiler import kernel

SUBPIXELS = 256
GUARD_PX = float(1 << 20)  # beyond it faces are cut, so that edge functions fit into 64 bits
OFF_SCREEN = np.int32(-(1 << 31))
MOST_PIECES = 6  # a triangle cut by five planes has eight corners

_jit: Any = kernel()


@_jit
def _clip_plane(polygon, count, a, b, c, d, out):
    """Sutherland-Hodgman: keep ``a X + b Y + c W + d >= 0``; returns the new corner count."""
    kept = 0
    for i in range(count):
        j = (i + 1) % count
        here = a * polygon[i, 0] + b * polygon[i, 1] + c * polygon[i, 2] + d
        there = a * polygon[j, 0] + b * polygon[j, 1] + c * polygon[j, 2] + d
        if here >= 0.0:
            out[kept] = polygon[i]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            t = here / (here - there)
            for k in range(4):
                out[kept, k] = polygon[i, k] + t * (polygon[j, k] - polygon[i, k])
            kept += 1
    return kept


@_jit
def _set_homogeneous(vertices, index, camera, out):
    """``out`` (4,): (X, Y, W, d) with u = X / W, v = Y / W; W is z or 1, d linear in the others."""
    a, b, c = vertices[0, index], vertices[1, index], vertices[2, index]
    x = camera[0] * a + camera[1] * b + camera[2] * c + camera[9]
    y = camera[3] * a + camera[4] * b + camera[5] * c + camera[10]
    z = camera[6] * a + camera[7] * b + camera[8] * c + camera[11]
    w = z if camera[16] > 0.0 else 1.0
    out[0], out[1] = camera[12] * x + camera[14] * w, camera[13] * y + camera[15] * w
    out[2], out[3] = w, -z


@_jit
def _set_plane(face, polygon, corners, planes):
    """A face's plane from homogeneous corners (Olano and Greer, *Triangle scan conversion using 2D
    homogeneous coordinates*, 1997): the weights ``l_0 ~ x_1 y_2 - x_2 y_1`` and cyclic, with
    x_i = X_i - u W_i and y_i = Y_i - v W_i, hold behind the camera too.
    """
    weights, most = np.empty((3, 3)), 1e-300
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        xj, yj, wj = polygon[j, 0], polygon[j, 1], polygon[j, 2]
        xk, yk, wk = polygon[k, 0], polygon[k, 1], polygon[k, 2]
        # Negative where the front is seen: so this is the side that is seen.
        weights[0, i] = xk * yj - xj * yk
        weights[1, i], weights[2, i] = wj * yk - wk * yj, wk * xj - wj * xk
        for step in range(3):
            most = max(most, abs(weights[step, i]))
    for step in range(3):
        for axis in range(3):
            total = 0.0
            for i in range(3):
                total += weights[step, i] / most * corners[face, 3 * i + axis]
            planes[face, 4 * step + axis] = total
    planes[face, 12] = planes[face, 13] = -0.5  # the pixel whose centre is the origin


@_jit
def _cut(polygon, other, near):
    """Cut a triangle at the near plane and the guard band; returns the corners, and how many."""
    count = 3
    if near > 0.0:
        count = _clip_plane(polygon, count, 0.0, 0.0, 1.0, -near, other)
        polygon, other = other, polygon
    count = _clip_plane(polygon, count, 1.0, 0.0, GUARD_PX, 0.0, other)
    count = _clip_plane(other, count, -1.0, 0.0, GUARD_PX, 0.0, polygon)
    count = _clip_plane(polygon, count, 0.0, 1.0, GUARD_PX, 0.0, other)
    count = _clip_plane(other, count, 0.0, -1.0, GUARD_PX, 0.0, polygon)
    return polygon, count


@_jit
def cut(count, listed, faces, corners, vertices, camera, screen, depths, planes):
    """The first ``count`` of the ``listed`` faces in pieces, each a triangle; sets their planes.

    Returns the pieces' faces (T,) int32, their corners (T, 3, 2) int64 in 1/256 px, and the depth
    values there (T, 3) float32.
    """
    owners = np.empty(MOST_PIECES * count, np.int32)
    places = np.empty((MOST_PIECES * count, 3, 2), np.int64)
    values = np.empty((MOST_PIECES * count, 3), np.float32)
    one, other, near, pieces = np.empty((8, 4)), np.empty((8, 4)), camera[16], 0
    for index in range(count):
        face = listed[index]
        off = False
        for k in range(3):
            corner = faces[face, k]
            _set_homogeneous(vertices, corner, camera, one[k])
            off |= screen[0, corner] == OFF_SCREEN or screen[1, corner] == OFF_SCREEN
            places[pieces, k, 0], places[pieces, k, 1] = screen[0, corner], screen[1, corner]
            values[pieces, k] = depths[corner]
        _set_plane(face, one, corners, planes)
        owners[pieces] = face
        if not off:
            pieces += 1
            continue
        polygon, size = _cut(one, other, near)
        for i in range(2, size):
            for k, corner in enumerate((0, i - 1, i)):
                w = polygon[corner, 2]
                for axis in range(2):
                    place = math.floor(polygon[corner, axis] / w * SUBPIXELS + 0.5)
                    places[pieces, k, axis] = np.int64(place)
                values[pieces, k] = 1.0 / w if near > 0.0 else polygon[corner, 3]
            owners[pieces] = face
            pieces += 1
    return owners[:pieces], places[:pieces], values[:pieces]
