"""The rasteriser's first half: which face each pixel shows. Arrays in, arrays out, without the GIL.

Vertices are snapped to 1/256 px and edges tested in integers with the top-left rule, so that a
pixel centre on a shared edge belongs to exactly one face.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

SUBPIXELS = 256
GUARD_PX = float(1 << 20)  # beyond it faces are clipped, so that edge functions fit into 64 bits
OFF_SCREEN = np.int32(-(1 << 31))  # marks a vertex behind the near plane or beyond the guard band
NO_FACE = np.int32(-1)

_jit: Any = njit(nogil=True, cache=True, error_model="numpy")


@_jit
def project(vertices, rotation, translation, intrinsics, perspective, near, homogeneous, snapped):
    """Vertices (V, 3) to ``homogeneous`` (V, 4) = (X, Y, W, d) and ``snapped`` (V, 2), 1/256 px.

    ``intrinsics`` is (fx, fy, cx, cy). Under perspective W is z and the depth value d is 1/z;
    under parallel projection they are 1 and -z: d is linear in the picture, and the greater the
    nearer. Returns the box (left, top, right, bottom) of the vertices in px, and whether any
    needs clipping.
    """
    fx, fy, cx, cy = intrinsics
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    any_off = False
    for i in range(vertices.shape[0]):
        a, b, c = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c + translation[0]
        y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c + translation[1]
        z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c + translation[2]
        w = z if perspective else 1.0
        homogeneous[i, 0] = fx * x + cx * w
        homogeneous[i, 1] = fy * y + cy * w
        homogeneous[i, 2] = w
        inverse = 1.0 / w
        homogeneous[i, 3] = inverse if perspective else -z
        off = perspective and z < near
        if not off:
            u, v = homogeneous[i, 0] * inverse, homogeneous[i, 1] * inverse
            off = abs(u) > GUARD_PX or abs(v) > GUARD_PX
            if not off:
                left, right = min(left, u), max(right, u)
                top, bottom = min(top, v), max(bottom, v)
                snapped[i, 0] = np.int32(math.floor(u * SUBPIXELS + 0.5))
                snapped[i, 1] = np.int32(math.floor(v * SUBPIXELS + 0.5))
        if off:
            any_off = True
            snapped[i, 0] = OFF_SCREEN
    return left, top, right, bottom, any_off


@_jit
def _edge_bias(dx, dy):
    """0 for a top or left edge, whose points are inside; -1 for the others."""
    return 0 if dy < 0 or (dy == 0 and dx > 0) else -1


@_jit
def _draw(x0, y0, d0, x1, y1, d1, x2, y2, d2, face, two_sided, depth, ids):
    """One triangle in 1/256 px, with depth values d (greater is nearer), linear in the picture."""
    x0, y0, x1, y1 = np.int64(x0), np.int64(y0), np.int64(x1), np.int64(y1)
    x2, y2 = np.int64(x2), np.int64(y2)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0 or (area > 0 and not two_sided):  # y runs down: faces towards us have area < 0
        return
    if area < 0:
        x1, y1, d1, x2, y2, d2 = x2, y2, d2, x1, y1, d1
        area = -area
    half = SUBPIXELS // 2
    first_column = max((min(x0, x1, x2) + half - 1) >> 8, 0)
    last_column = min((max(x0, x1, x2) - half) >> 8, depth.shape[1] - 1)
    first_row = max((min(y0, y1, y2) + half - 1) >> 8, 0)
    last_row = min((max(y0, y1, y2) - half) >> 8, depth.shape[0] - 1)
    if first_column > last_column or first_row > last_row:
        return
    px, py = first_column * SUBPIXELS + half, first_row * SUBPIXELS + half
    e0 = (x2 - x1) * (py - y1) - (y2 - y1) * (px - x1)
    e1 = (x0 - x2) * (py - y2) - (y0 - y2) * (px - x2)
    e2 = (x1 - x0) * (py - y0) - (y1 - y0) * (px - x0)
    b0 = _edge_bias(x2 - x1, y2 - y1)
    b1 = _edge_bias(x0 - x2, y0 - y2)
    b2 = _edge_bias(x1 - x0, y1 - y0)
    right0, right1, right2 = (y1 - y2) * SUBPIXELS, (y2 - y0) * SUBPIXELS, (y0 - y1) * SUBPIXELS
    down0, down1, down2 = (x2 - x1) * SUBPIXELS, (x0 - x2) * SUBPIXELS, (x1 - x0) * SUBPIXELS
    s1, s2 = (d1 - d0) / area, (d2 - d0) / area
    for row in range(first_row, last_row + 1):
        f0, f1, f2 = e0, e1, e2
        for column in range(first_column, last_column + 1):
            if (f0 + b0) | (f1 + b1) | (f2 + b2) >= 0:
                d = np.float32(d0 + f1 * s1 + f2 * s2)
                if d > depth[row, column]:
                    depth[row, column] = d
                    ids[row, column] = face
            f0 += right0
            f1 += right1
            f2 += right2
        e0 += down0
        e1 += down1
        e2 += down2


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
def _clip_and_draw(homogeneous, a, b, c, face, perspective, near, two_sided, depth, ids):
    """A face that crosses the near plane or the guard band: clip it, draw what is left as a fan."""
    one, other = np.empty((8, 4)), np.empty((8, 4))
    one[0], one[1], one[2] = homogeneous[a], homogeneous[b], homogeneous[c]
    count = 3
    if perspective:
        count = _clip_plane(one, count, 0.0, 0.0, 1.0, -near, other)
        one, other = other, one
    count = _clip_plane(one, count, 1.0, 0.0, GUARD_PX, 0.0, other)
    count = _clip_plane(other, count, -1.0, 0.0, GUARD_PX, 0.0, one)
    count = _clip_plane(one, count, 0.0, 1.0, GUARD_PX, 0.0, other)
    count = _clip_plane(other, count, 0.0, -1.0, GUARD_PX, 0.0, one)
    for i in range(2, count):
        x = np.empty(3, np.int64)
        y = np.empty(3, np.int64)
        d = np.empty(3)
        for k, corner in enumerate((0, i - 1, i)):
            x[k] = np.int64(math.floor(one[corner, 0] / one[corner, 2] * SUBPIXELS + 0.5))
            y[k] = np.int64(math.floor(one[corner, 1] / one[corner, 2] * SUBPIXELS + 0.5))
            d[k] = 1.0 / one[corner, 2] if perspective else one[corner, 3]
        _draw(x[0], y[0], d[0], x[1], y[1], d[1], x[2], y[2], d[2], face, two_sided, depth, ids)


@_jit
def _is_hidden(left, top, right, bottom, nearest, depth):
    """Whether what is drawn already is nearer, all over the box, than ``nearest``."""
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if depth[row, column] < nearest:
                return False
    return True


@_jit
def _corners(faces, face):
    """Vertex indices of a face; unsigned, which spares a test for negative ones at every use."""
    return np.uint32(faces[face, 0]), np.uint32(faces[face, 1]), np.uint32(faces[face, 2])


@_jit
def rasterise(homogeneous, snapped, faces, perspective, near, two_sided, depth, ids):
    """Draw all faces into ``depth`` (height, width) float32 and ``ids`` (height, width) int32.

    Both must have been cleared (-inf, -1) where anything can be drawn.
    """
    height, width = depth.shape
    for face in range(faces.shape[0]):
        a, b, c = _corners(faces, face)
        ax, bx, cx = snapped[a, 0], snapped[b, 0], snapped[c, 0]
        if ax == OFF_SCREEN or bx == OFF_SCREEN or cx == OFF_SCREEN:
            _clip_and_draw(homogeneous, a, b, c, face, perspective, near, two_sided, depth, ids)
            continue
        # Most faces of a detailed model lie between pixel centres: leave them as early as can be.
        left, right = max((min(ax, bx, cx) + 127) >> 8, 0), (max(ax, bx, cx) - 128) >> 8
        if left > min(right, width - 1):
            continue
        ay, by, cy = snapped[a, 1], snapped[b, 1], snapped[c, 1]
        top, bottom = max((min(ay, by, cy) + 127) >> 8, 0), (max(ay, by, cy) - 128) >> 8
        if top > min(bottom, height - 1):
            continue
        da, db, dc = homogeneous[a, 3], homogeneous[b, 3], homogeneous[c, 3]
        right, bottom = min(right, width - 1), min(bottom, height - 1)
        if _is_hidden(left, top, right, bottom, max(da, db, dc), depth):
            continue
        _draw(ax, ay, da, bx, by, db, cx, cy, dc, face, two_sided, depth, ids)


@_jit
def clear(box, depth, ids):
    """Empty the buffers inside ``box`` (left, top, right, bottom), in whole px, ends excluded."""
    left, top, right, bottom = box
    for row in range(top, bottom):
        for column in range(left, right):
            depth[row, column] = -np.inf
            ids[row, column] = NO_FACE
