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
OFF_SCREEN = np.int32(-(1 << 31))  # marks a vertex behind the near plane or beyond the guard band
NO_FACE = np.int32(-1)
RUN = 256  # pixels whose attributes are added up together

_jit: Any = njit(nogil=True, cache=True, error_model="numpy")
# Sums alone may be taken in another order (lanes of a vector); runs are short, so it costs nothing.
_jit_sums: Any = njit(
    nogil=True, cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"}
)


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
            d[k] = 1.0 / one[corner, 3] if perspective else -one[corner, 3]
        _draw(x[0], y[0], d[0], x[1], y[1], d[1], x[2], y[2], d[2], face, two_sided, depth, ids)


@_jit
def _corners(faces, face):
    """Vertex indices of a face; unsigned, which spares a test for negative ones at every use."""
    return np.uint32(faces[face, 0]), np.uint32(faces[face, 1]), np.uint32(faces[face, 2])


@_jit
def rasterise(homogeneous, snapped, faces, perspective, near, two_sided, depth, ids):
    """Draw all faces into ``depth`` (height, width) float32 and ``ids`` (height, width) int32.

    Both must have been cleared (-inf, -1) where anything can be drawn. Depth values are 1/z under
    perspective, -z under parallel projection: linear in the picture, and the greater the nearer.
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
        za, zb, zc = homogeneous[a, 3], homogeneous[b, 3], homogeneous[c, 3]
        if perspective:
            da, db, dc = 1.0 / za, 1.0 / zb, 1.0 / zc
        else:
            da, db, dc = -za, -zb, -zc
        _draw(ax, ay, da, bx, by, db, cx, cy, dc, face, two_sided, depth, ids)


@_jit
def _sample(texels, offset, width, height, u, v):
    """Bilinear RGB, wrapped around, v upwards; texel centres at (i + 0.5) / size."""
    x = (u - math.floor(u)) * width - 0.5
    y = (1.0 - (v - math.floor(v))) * height - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, right = int(x0) % width, (int(x0) + 1) % width
    top, bottom = offset + int(y0) % height * width, offset + (int(y0) + 1) % height * width
    a, b = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)
    c, d = (1.0 - fx) * fy, fx * fy
    p, q = texels[top + left], texels[top + right]
    r, s = texels[bottom + left], texels[bottom + right]
    return (
        a * p[0] + b * q[0] + c * r[0] + d * s[0],
        a * p[1] + b * q[1] + c * r[1] + d * s[1],
        a * p[2] + b * q[2] + c * r[2] + d * s[2],
    )


@_jit
def _texture_level(homogeneous, vertex_data, a, b, c, width, height, levels):
    """Mip level of a face: half the log2 of texels per pixel, rounded, from the two areas."""
    if homogeneous[a, 2] <= 0.0 or homogeneous[b, 2] <= 0.0 or homogeneous[c, 2] <= 0.0:
        return 0
    ax, ay = homogeneous[a, 0] / homogeneous[a, 2], homogeneous[a, 1] / homogeneous[a, 2]
    bx, by = homogeneous[b, 0] / homogeneous[b, 2], homogeneous[b, 1] / homogeneous[b, 2]
    cx, cy = homogeneous[c, 0] / homogeneous[c, 2], homogeneous[c, 1] / homogeneous[c, 2]
    pixels = abs((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    du, dv = vertex_data[b, 6] - vertex_data[a, 6], vertex_data[b, 7] - vertex_data[a, 7]
    eu, ev = vertex_data[c, 6] - vertex_data[a, 6], vertex_data[c, 7] - vertex_data[a, 7]
    texels = abs(du * ev - eu * dv) * width * height
    if texels <= pixels:
        return 0
    if pixels <= 0.0:
        return levels - 1
    return min(int(0.5 * math.log2(texels / pixels) + 0.5), levels - 1)


@_jit
def _barycentrics(u, v, a, b, c, homogeneous):
    """The point of face (a, b, c) at (u, v): three shares that sum to 1, and the side seen.

    The side is 1 where the face is seen from the front, -1 from behind.
    """
    wa, wb, wc = homogeneous[a, 2], homogeneous[b, 2], homogeneous[c, 2]
    xa, ya = homogeneous[a, 0] - u * wa, homogeneous[a, 1] - v * wa
    xb, yb = homogeneous[b, 0] - u * wb, homogeneous[b, 1] - v * wb
    xc, yc = homogeneous[c, 0] - u * wc, homogeneous[c, 1] - v * wc
    la, lb, lc = xb * yc - xc * yb, xc * ya - xa * yc, xa * yb - xb * ya
    total = la + lb + lc
    if total == 0.0:  # seen exactly edge-on; snapping alone made it visible
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 1.0
    # The sum is the signed area as seen by the camera: negative where the front is seen.
    side = -1.0 if total > 0.0 else 1.0
    # Snapping may put the pixel centre just outside the exact triangle: stay on it.
    la, lb, lc = max(la / total, 0.0), max(lb / total, 0.0), max(lc / total, 0.0)
    scale = 1.0 / (la + lb + lc)
    return la * scale, lb * scale, lc * scale, side


@_jit
def _normal(shares, a, b, c, vertex_data, rotation):
    """The interpolated unit normal, in the camera frame, on the side that is seen."""
    la, lb, lc, side = shares
    x = la * vertex_data[a, 0] + lb * vertex_data[b, 0] + lc * vertex_data[c, 0]
    y = la * vertex_data[a, 1] + lb * vertex_data[b, 1] + lc * vertex_data[c, 1]
    z = la * vertex_data[a, 2] + lb * vertex_data[b, 2] + lc * vertex_data[c, 2]
    length = math.sqrt(x * x + y * y + z * z)
    scale = side / length if length > 0.0 else 0.0
    return (
        scale * (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z),
        scale * (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z),
        scale * (rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z),
    )


@_jit
def _reflectance(shares, a, b, c, texture, homogeneous, vertex_data, texels, table):
    """RGB: interpolated vertex colour, times the texture's (-1: none)."""
    la, lb, lc, _ = shares
    red = la * vertex_data[a, 3] + lb * vertex_data[b, 3] + lc * vertex_data[c, 3]
    green = la * vertex_data[a, 4] + lb * vertex_data[b, 4] + lc * vertex_data[c, 4]
    blue = la * vertex_data[a, 5] + lb * vertex_data[b, 5] + lc * vertex_data[c, 5]
    if texture < 0:
        return red, green, blue
    u = la * vertex_data[a, 6] + lb * vertex_data[b, 6] + lc * vertex_data[c, 6]
    v = la * vertex_data[a, 7] + lb * vertex_data[b, 7] + lc * vertex_data[c, 7]
    width, height = table[texture, 0, 1], table[texture, 0, 2]
    level = _texture_level(homogeneous, vertex_data, a, b, c, width, height, table.shape[1])
    width, height = table[texture, level, 1], table[texture, level, 2]
    r, g, b = _sample(texels, table[texture, level, 0], width, height, u, v)
    return red * r, green * g, blue * b


@_jit
def clear(box, depth, ids):
    """Empty the buffers inside ``box`` (left, top, right, bottom), in whole px, ends excluded."""
    left, top, right, bottom = box
    for row in range(top, bottom):
        for column in range(left, right):
            depth[row, column] = -np.inf
            ids[row, column] = NO_FACE


@_jit
def shade(
    box,
    ids,
    homogeneous,
    rotation,
    faces,
    vertex_data,
    face_texture,
    texels,
    table,
    reflectance,
    normals,
):
    """Write the attributes of all visible pixels inside ``box`` to (height, width, 3) pictures.

    ``vertex_data`` (V, 8) float32: normal, RGB, UV.
    """
    left, top, right, bottom = box
    for row in range(top, bottom):
        for column in range(left, right):
            face = ids[row, column]
            if face < 0:
                continue
            a, b, c = (
                np.uint32(faces[face, 0]),
                np.uint32(faces[face, 1]),
                np.uint32(faces[face, 2]),
            )
            shares = _barycentrics(column + 0.5, row + 0.5, a, b, c, homogeneous)
            normal = _normal(shares, a, b, c, vertex_data, rotation)
            colour = _reflectance(
                shares, a, b, c, face_texture[face], homogeneous, vertex_data, texels, table
            )
            for k in range(3):
                reflectance[row, column, k] = colour[k]
                normals[row, column, k] = normal[k]


@_jit
def accumulate(
    box,
    ids,
    homogeneous,
    rotation,
    faces,
    vertex_data,
    face_texture,
    texels,
    table,
    grey,
    channels,
    weights,
    origin,
    model,
    first,
    second,
):
    """Add up ``w``, ``w x`` and the lower half of ``w x x^T`` over the visible pixels in ``box``.

    x = (F - ``origin``, M): ``channels`` (height, width, n), ``model`` = m is 4 (grey, by the
    weights ``grey`` (3,)) or 12. Adds into ``first`` (n + m,), ``second`` (n + m, n + m); returns
    the pixel count and the sum of the weights. Pixels are gathered into runs, and the sums taken
    over a run at a time, channel against channel, so that they vectorise.
    """
    left, top, right, bottom = box
    n = channels.shape[2]
    run = np.empty((n + model, RUN))
    run_weights = np.empty(RUN)
    filled, pixels, total = 0, 0, 0.0
    for row in range(top, bottom):
        for column in range(left, right):
            face = ids[row, column]
            if face < 0 or not weights[row, column] > 0.0:
                continue
            a, b, c = (
                np.uint32(faces[face, 0]),
                np.uint32(faces[face, 1]),
                np.uint32(faces[face, 2]),
            )
            shares = _barycentrics(column + 0.5, row + 0.5, a, b, c, homogeneous)
            x, y, z = _normal(shares, a, b, c, vertex_data, rotation)
            colour = _reflectance(
                shares, a, b, c, face_texture[face], homogeneous, vertex_data, texels, table
            )
            run_weights[filled] = weights[row, column]
            for k in range(n):
                run[k, filled] = channels[row, column, k] - origin[k]
            if model == 4:
                k = grey[0] * colour[0] + grey[1] * colour[1] + grey[2] * colour[2]
                run[n, filled] = k
                run[n + 1, filled], run[n + 2, filled], run[n + 3, filled] = k * x, k * y, k * z
            else:
                for band in range(3):
                    k, at = colour[band], n + 4 * band
                    run[at, filled] = k
                    run[at + 1, filled] = k * x
                    run[at + 2, filled] = k * y
                    run[at + 3, filled] = k * z
            filled += 1
            if filled == RUN:
                pixels += filled
                total += _add_run(run, run_weights, filled, first, second)
                filled = 0
    pixels += filled
    total += _add_run(run, run_weights, filled, first, second)
    return pixels, total


@_jit_sums
def _add_run(run, weights, filled, first, second):
    """Add the sums over a run of pixels; returns the sum of its weights."""
    weighted = np.empty(RUN)
    total = 0.0
    for p in range(filled):
        total += weights[p]
    for i in range(run.shape[0]):
        mine = 0.0
        for p in range(filled):
            weighted[p] = weights[p] * run[i, p]
            mine += weighted[p]
        first[i] += mine
        for j in range(i + 1):
            product = 0.0
            for p in range(filled):
                product += weighted[p] * run[j, p]
            second[i, j] += product
    return total
