"""The software rasteriser: numba kernels, arrays in, arrays out, without the GIL.

Stages: ``project`` vertices to homogeneous picture coordinates; ``rasterise`` faces into a depth
and an id buffer; then, for the visible face of each pixel, interpolate its attributes and either
store them (``shade``) or add them up (``accumulate``).

Coverage: vertices are snapped to 1/256 px and edges tested in integers with the top-left rule, so
that a pixel centre on a shared edge belongs to exactly one face. Attributes: with homogeneous
corners ``(X_i, Y_i, W_i)`` and ``x_i = X_i - u W_i``, ``y_i = Y_i - v W_i`` at the pixel centre
(u, v), the perspective-correct barycentrics are ``l_0 ~ x_1 y_2 - x_2 y_1`` and cyclic
(Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, 1997). They need no
division by W, and so hold for faces that reach behind the camera as well.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

SUBPIXELS = 256
GUARD_PX = float(1 << 20)  # beyond it faces are clipped, so that edge functions fit into 64 bits
OFF_SCREEN = np.int64(-(1 << 62))  # marks a vertex behind the near plane or beyond the guard band
NO_FACE = np.int32(-1)

_jit: Any = njit(nogil=True, cache=True, error_model="numpy")


@_jit
def project(vertices, rotation, translation, intrinsics, perspective, near, homogeneous, snapped):
    """Vertices (V, 3) to ``homogeneous`` (V, 4) = (X, Y, W, z) and ``snapped`` (V, 2), 1/256 px.

    ``intrinsics`` is (fx, fy, cx, cy); W is z, or 1 under parallel projection. Returns the box
    (left, top, right, bottom) of the vertices in px, and whether any needs clipping.
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
        homogeneous[i, 3] = z
        off = perspective and z < near
        if not off:
            u, v = homogeneous[i, 0] / w, homogeneous[i, 1] / w
            off = abs(u) > GUARD_PX or abs(v) > GUARD_PX
            if not off:
                left, right = min(left, u), max(right, u)
                top, bottom = min(top, v), max(bottom, v)
                snapped[i, 0] = np.int64(math.floor(u * SUBPIXELS + 0.5))
                snapped[i, 1] = np.int64(math.floor(v * SUBPIXELS + 0.5))
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
            d[k] = 1.0 / one[corner, 3] if perspective else -one[corner, 3]
        _draw(x[0], y[0], d[0], x[1], y[1], d[1], x[2], y[2], d[2], face, two_sided, depth, ids)


@_jit
def rasterise(homogeneous, snapped, faces, perspective, near, two_sided, depth, ids):
    """Draw all faces into ``depth`` (height, width) float32 and ``ids`` (height, width) int32.

    Both must have been cleared (-inf, -1) where anything can be drawn. Depth values are 1/z under
    perspective, -z under parallel projection: linear in the picture, and the greater the nearer.
    """
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, bx, cx = snapped[a, 0], snapped[b, 0], snapped[c, 0]
        if ax == OFF_SCREEN or bx == OFF_SCREEN or cx == OFF_SCREEN:
            _clip_and_draw(homogeneous, a, b, c, face, perspective, near, two_sided, depth, ids)
            continue
        za, zb, zc = homogeneous[a, 3], homogeneous[b, 3], homogeneous[c, 3]
        if perspective:
            da, db, dc = 1.0 / za, 1.0 / zb, 1.0 / zc
        else:
            da, db, dc = -za, -zb, -zc
        ay, by, cy = snapped[a, 1], snapped[b, 1], snapped[c, 1]
        _draw(ax, ay, da, bx, by, db, cx, cy, dc, face, two_sided, depth, ids)


@_jit
def _sample(texels, offset, width, height, u, v, out):
    """Bilinear, wrapped around, v upwards; texel centres at (i + 0.5) / size."""
    x = (u - math.floor(u)) * width - 0.5
    y = (1.0 - (v - math.floor(v))) * height - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, right = int(x0) % width, (int(x0) + 1) % width
    top, bottom = int(y0) % height, (int(y0) + 1) % height
    for k in range(3):
        upper = (1.0 - fx) * texels[offset + top * width + left, k] + fx * texels[
            offset + top * width + right, k
        ]
        lower = (1.0 - fx) * texels[offset + bottom * width + left, k] + fx * texels[
            offset + bottom * width + right, k
        ]
        out[k] = (1.0 - fy) * upper + fy * lower


@_jit
def _texture_level(homogeneous, uvs, a, b, c, width, height, levels):
    """Mip level of a face: half the log2 of texels per pixel, rounded, from the two areas."""
    if homogeneous[a, 2] <= 0.0 or homogeneous[b, 2] <= 0.0 or homogeneous[c, 2] <= 0.0:
        return 0
    ax, ay = homogeneous[a, 0] / homogeneous[a, 2], homogeneous[a, 1] / homogeneous[a, 2]
    bx, by = homogeneous[b, 0] / homogeneous[b, 2], homogeneous[b, 1] / homogeneous[b, 2]
    cx, cy = homogeneous[c, 0] / homogeneous[c, 2], homogeneous[c, 1] / homogeneous[c, 2]
    pixels = abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    du, dv = uvs[b, 0] - uvs[a, 0], uvs[b, 1] - uvs[a, 1]
    eu, ev = uvs[c, 0] - uvs[a, 0], uvs[c, 1] - uvs[a, 1]
    texels = abs(du * ev - eu * dv) * width * height
    if texels <= pixels:
        return 0
    if pixels <= 0.0:
        return levels - 1
    return min(int(0.5 * math.log2(texels / pixels) + 0.5), levels - 1)


@_jit
def _attributes(u, v, face, homogeneous, rotation, surface, out):
    """``out`` (6,) = RGB reflectance, camera-frame unit normal of ``face`` at the point (u, v)."""
    faces, normals, colours, uvs, face_texture, texels, table = surface
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    xa, ya = homogeneous[a, 0] - u * homogeneous[a, 2], homogeneous[a, 1] - v * homogeneous[a, 2]
    xb, yb = homogeneous[b, 0] - u * homogeneous[b, 2], homogeneous[b, 1] - v * homogeneous[b, 2]
    xc, yc = homogeneous[c, 0] - u * homogeneous[c, 2], homogeneous[c, 1] - v * homogeneous[c, 2]
    la, lb, lc = xb * yc - xc * yb, xc * ya - xa * yc, xa * yb - xb * ya
    total = la + lb + lc
    if total == 0.0:  # seen exactly edge-on; snapping alone made it visible
        la, lb, lc, total = 1.0, 1.0, 1.0, 3.0
    # The sum is the signed area as seen from the camera: negative where the front is seen.
    side = -1.0 if total > 0.0 else 1.0
    la, lb, lc = la / total, lb / total, lc / total
    # Snapping may put the pixel centre just outside the exact triangle: stay on it.
    la, lb, lc = max(la, 0.0), max(lb, 0.0), max(lc, 0.0)
    total = la + lb + lc
    la, lb, lc = la / total, lb / total, lc / total
    x = la * normals[a, 0] + lb * normals[b, 0] + lc * normals[c, 0]
    y = la * normals[a, 1] + lb * normals[b, 1] + lc * normals[c, 1]
    z = la * normals[a, 2] + lb * normals[b, 2] + lc * normals[c, 2]
    length = math.sqrt(x * x + y * y + z * z)
    scale = side / length if length > 0.0 else 0.0
    for k in range(3):
        out[3 + k] = scale * (rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z)
    texture = face_texture[face]
    if texture >= 0:
        su = la * uvs[a, 0] + lb * uvs[b, 0] + lc * uvs[c, 0]
        sv = la * uvs[a, 1] + lb * uvs[b, 1] + lc * uvs[c, 1]
        width, height = table[texture, 0, 1], table[texture, 0, 2]
        level = _texture_level(homogeneous, uvs, a, b, c, width, height, table.shape[1])
        offset = table[texture, level, 0]
        width, height = table[texture, level, 1], table[texture, level, 2]
        _sample(texels, offset, width, height, su, sv, out)
        for k in range(3):
            out[k] *= la * colours[a, k] + lb * colours[b, k] + lc * colours[c, k]
    else:
        for k in range(3):
            out[k] = la * colours[a, k] + lb * colours[b, k] + lc * colours[c, k]


@_jit
def clear(box, depth, ids):
    """Empty the buffers inside ``box`` (left, top, right, bottom), in whole px, ends excluded."""
    left, top, right, bottom = box
    for row in range(top, bottom):
        for column in range(left, right):
            depth[row, column] = -np.inf
            ids[row, column] = NO_FACE


@_jit
def shade(box, ids, homogeneous, rotation, surface, reflectance, normals):
    """Write the attributes of all visible pixels inside ``box`` to (height, width, 3) pictures."""
    left, top, right, bottom = box
    values = np.empty(6)
    for row in range(top, bottom):
        for column in range(left, right):
            face = ids[row, column]
            if face >= 0:
                _attributes(column + 0.5, row + 0.5, face, homogeneous, rotation, surface, values)
                for k in range(3):
                    reflectance[row, column, k] = values[k]
                    normals[row, column, k] = values[3 + k]


@_jit
def accumulate(
    box, ids, homogeneous, rotation, surface, grey, channels, weights, origin, model, first, second
):
    """Add up ``w``, ``w x`` and the upper half of ``w x x^T`` over the visible pixels in ``box``.

    x = (F - ``origin``, M): ``channels`` (height, width, n), ``model`` = m is 4 (grey, by the
    weights ``grey`` (3,)) or 12. Adds into ``first`` (n + m,), ``second`` (n + m, n + m); returns
    the pixel count and the sum of the weights.
    """
    left, top, right, bottom = box
    n = channels.shape[2]
    size = n + model
    values = np.empty(6)
    x = np.empty(size)
    pixels, total = 0, 0.0
    for row in range(top, bottom):
        for column in range(left, right):
            face = ids[row, column]
            if face < 0:
                continue
            weight = np.float64(weights[row, column])
            if weight <= 0.0:
                continue
            _attributes(column + 0.5, row + 0.5, face, homogeneous, rotation, surface, values)
            for k in range(n):
                x[k] = channels[row, column, k] - origin[k]
            if model == 4:
                k = grey[0] * values[0] + grey[1] * values[1] + grey[2] * values[2]
                x[n] = k
                x[n + 1], x[n + 2], x[n + 3] = k * values[3], k * values[4], k * values[5]
            else:
                for band in range(3):
                    k = values[band]
                    x[n + 4 * band] = k
                    for axis in range(3):
                        x[n + 4 * band + 1 + axis] = k * values[3 + axis]
            pixels += 1
            total += weight
            for i in range(size):
                scaled = weight * x[i]
                first[i] += scaled
                for j in range(i, size):
                    second[i, j] += scaled * x[j]
    return pixels, total
