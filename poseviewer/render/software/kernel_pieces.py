"""Large faces, and those that reach behind the camera or far outside the picture.

They are cut into triangles that are drawn here by the rules of ``kernel_coverage``, in 64 bits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from poseviewer.render.software.kernel_blocks import COLUMN_OF, PLAIN, ROW_OF
from poseviewer.render.software.kernel_compiler import kernel
from poseviewer.render.software.kernel_coverage import texture_level
from poseviewer.render.software.kernel_visibility import GUARD_PX, OFF_SCREEN, SUBPIXELS

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
            for k in range(4):
                out[kept, k] = polygon[i, k]
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
    size = corners.shape[1] // 3
    for step in range(3):
        for axis in range(size):
            total = 0.0
            for i in range(3):
                total += weights[step, i] / most * corners[face, size * i + axis]
            planes[face, 4 * step + axis] = total


@_jit
def _pixel_area(polygon):
    """Twice a triangle's area in the picture, px; without bound if it reaches behind the camera."""
    if min(polygon[0, 2], polygon[1, 2], polygon[2, 2]) <= 0.0:
        return np.inf
    x, y = polygon[0, 0] / polygon[0, 2], polygon[0, 1] / polygon[0, 2]
    ax, ay = polygon[1, 0] / polygon[1, 2] - x, polygon[1, 1] / polygon[1, 2] - y
    bx, by = polygon[2, 0] / polygon[2, 2] - x, polygon[2, 1] / polygon[2, 2] - y
    return abs(ax * by - bx * ay)


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
def cut(count, listed, faces, corners, vertices, camera, screen, depths, planes, painting):
    """The first ``count`` of the ``listed`` faces in pieces, each a triangle; sets their planes,
    and what ``painting`` has of them, see ``draw_listed``.

    Returns the pieces' faces (T,) int32, their corners (T, 3, 2) int64 in 1/256 px, and the depth
    values there (T, 3) float32.
    """
    kinds, paint, texel_areas, count_of_levels, paints, levels = painting
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
        planes[face, COLUMN_OF] = planes[
            face, ROW_OF
        ] = -0.5  # the pixel whose centre is the origin
        if paint.shape[0] > 1 and kinds[face] != PLAIN:
            _set_plane(face, one, paint, paints)
            levels[face] = texture_level(texel_areas[face], _pixel_area(one), count_of_levels)
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


@_jit
def _span(first, last, e, right):
    """The part of columns ``first`` to ``last``, counted from where the edge function is ``e``, in
    which it is not negative; it grows by ``right`` a column.
    """
    if right > 0:
        return max(first, (right - 1 - e) // right) if e < 0 else first, last
    if e < 0:
        return first, first - 1
    return first, min(last, e // -right) if right < 0 else last


@_jit
def _fill_row(depths, faces, d, slope, face):
    """Draw ``face`` all along a row's pixels, where it is not behind what is there."""
    for k in range(depths.shape[0]):
        value, before, face_before = np.float32(d + np.int32(k) * slope), depths[k], faces[k]
        wins = (value > before) | ((value == before) & (face < face_before))
        depths[k] = value if wins else before
        faces[k] = face if wins else face_before


@_jit
def _edges(x0, y0, x1, y1, x2, y2, first_column, first_row, sign):
    """Edge functions at a pixel centre, and what a column and a row more add to each.

    In 1/256 px squared; edge i lies opposite corner i. Inside, all three are positive.
    """
    px, py = first_column * SUBPIXELS + SUBPIXELS // 2, first_row * SUBPIXELS + SUBPIXELS // 2
    ex0, ey0 = sign * (x2 - x1), sign * (y2 - y1)
    ex1, ey1 = sign * (x0 - x2), sign * (y0 - y2)
    ex2, ey2 = sign * (x1 - x0), sign * (y1 - y0)
    e0 = ex0 * (py - y1) - ey0 * (px - x1)
    e1 = ex1 * (py - y2) - ey1 * (px - x2)
    e2 = ex2 * (py - y0) - ey2 * (px - x0)
    right = (-ey0 * SUBPIXELS, -ey1 * SUBPIXELS, -ey2 * SUBPIXELS)
    down = (ex0 * SUBPIXELS, ex1 * SUBPIXELS, ex2 * SUBPIXELS)
    # Points on a top or left edge are inside, on the others outside.
    b0 = ~(((ey0 << 32) - ex0) >> 63)
    b1 = ~(((ey1 << 32) - ex1) >> 63)
    b2 = ~(((ey2 << 32) - ex2) >> 63)
    return (e0, e1, e2), right, down, (b0, b1, b2)


@_jit
def _draw_piece(x0, y0, d0, x1, y1, d1, x2, y2, d2, face, two_sided, width, depth, ids):
    """One triangle of any size, in 1/256 px, with depth values d, linear in the picture."""
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0 or (area > 0 and not two_sided):
        return
    sign = 1 if area > 0 else -1
    area *= sign
    first_column = max((min(x0, x1, x2) + 127) >> 8, 0)
    last_column = min((max(x0, x1, x2) - 128) >> 8, width - 1)
    first_row = max((min(y0, y1, y2) + 127) >> 8, 0)
    last_row = min((max(y0, y1, y2) - 128) >> 8, depth.shape[0] - 1)
    if first_column > last_column or first_row > last_row:
        return
    (e0, e1, e2), right, down, (b0, b1, b2) = _edges(
        x0, y0, x1, y1, x2, y2, first_column, first_row, sign
    )
    s1, s2 = (np.float64(d1) - d0) / area, (np.float64(d2) - d0) / area
    slope = right[1] * s1 + right[2] * s2
    for row in range(first_row, last_row + 1):
        first, last = _span(0, last_column - first_column, e0 + b0, right[0])
        first, last = _span(first, last, e1 + b1, right[1])
        first, last = _span(first, last, e2 + b2, right[2])
        if first <= last:
            value = d0 + (e1 + first * right[1]) * s1 + (e2 + first * right[2]) * s2
            begin, end = first_column + first, first_column + last + 1
            _fill_row(depth[row, begin:end], ids[row, begin:end], value, slope, face)
        e0, e1, e2 = e0 + down[0], e1 + down[1], e2 + down[2]


@_jit
def draw_pieces(owners, places, values, two_sided, width, depth, ids):
    """Draw triangles of any size, as ``cut`` gives them."""
    for i in range(owners.shape[0]):
        x0, y0, x1, y1 = places[i, 0, 0], places[i, 0, 1], places[i, 1, 0], places[i, 1, 1]
        x2, y2, d0, d1, d2 = (
            places[i, 2, 0],
            places[i, 2, 1],
            values[i, 0],
            values[i, 1],
            values[i, 2],
        )
        _draw_piece(x0, y0, d0, x1, y1, d1, x2, y2, d2, owners[i], two_sided, width, depth, ids)
