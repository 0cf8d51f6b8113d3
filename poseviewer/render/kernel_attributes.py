"""The rasteriser's second half: the attributes of what each pixel shows, stored or added up.

With homogeneous corners ``(X_i, Y_i, W_i)`` and ``x_i = X_i - u W_i``, ``y_i = Y_i - v W_i`` at
the pixel centre (u, v), the perspective-correct barycentrics are ``l_0 ~ x_1 y_2 - x_2 y_1`` and
cyclic (Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, 1997). They
need no division by W, and so hold for faces that reach behind the camera as well.

Compiled code is kept per file, so nothing here calls into ``kernel_coverage``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

RUN = 256  # pixels whose attributes are added up together

_jit: Any = njit(nogil=True, cache=True, error_model="numpy")
# Sums alone may be taken in another order (lanes of a vector); runs are short, so it costs nothing.
_jit_sums: Any = njit(
    nogil=True, cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"}
)


@_jit
def _corners(faces, face):
    """Vertex indices of a face; unsigned, which spares a test for negative ones at every use."""
    return np.uint32(faces[face, 0]), np.uint32(faces[face, 1]), np.uint32(faces[face, 2])


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
    # Their sum is the signed area as seen by the camera: negative where the front is seen.
    side = 1.0
    if la + lb + lc > 0.0:
        side = -1.0
    else:
        la, lb, lc = -la, -lb, -lc
    # Snapping may put the pixel centre just outside the exact triangle: stay on it.
    la, lb, lc = max(la, 0.0), max(lb, 0.0), max(lc, 0.0)
    total = la + lb + lc
    if total == 0.0:  # seen exactly edge-on; snapping alone made it visible
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0, 1.0
    scale = 1.0 / total
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
    weights ``grey`` (3,)) or 12, or 1 more: the last attribute is then 1 on the model. Adds into
    ``first`` (n + m,), ``second`` (n + m, n + m); returns the pixel count and the sum of the
    weights. Pixels are gathered into runs, and the sums taken over a run at a time, channel
    against channel, so that they vectorise.
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
            if model < 12:
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
            if model % 4 == 1:
                run[n + model - 1, filled] = 1.0
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
