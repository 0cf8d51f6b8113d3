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
TINY = 1e-300

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
def _reflectance(la, lb, lc, a, b, c, texture, level, vertex_data, texels, table):
    """RGB at shares of any common scale: vertex colour, times the texture's (-1: none)."""
    scale = 1.0 / (la + lb + lc)
    la, lb, lc = la * scale, lb * scale, lc * scale
    red = la * vertex_data[a, 3] + lb * vertex_data[b, 3] + lc * vertex_data[c, 3]
    green = la * vertex_data[a, 4] + lb * vertex_data[b, 4] + lc * vertex_data[c, 4]
    blue = la * vertex_data[a, 5] + lb * vertex_data[b, 5] + lc * vertex_data[c, 5]
    if texture < 0:
        return red, green, blue
    u = la * vertex_data[a, 6] + lb * vertex_data[b, 6] + lc * vertex_data[c, 6]
    v = la * vertex_data[a, 7] + lb * vertex_data[b, 7] + lc * vertex_data[c, 7]
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
            texture, level = face_texture[face], 0
            if texture >= 0:
                width, height = table[texture, 0, 1], table[texture, 0, 2]
                level = _texture_level(
                    homogeneous, vertex_data, a, b, c, width, height, table.shape[1]
                )
            la, lb, lc, _ = shares
            colour = _reflectance(la, lb, lc, a, b, c, texture, level, vertex_data, texels, table)
            for k in range(3):
                reflectance[row, column, k] = colour[k]
                normals[row, column, k] = normal[k]


@_jit
def accumulate(
    box,
    ids,
    homogeneous,
    faces,
    vertex_data,
    face_texture,
    texels,
    table,
    face_data,
    grey,
    channels,
    weights,
    origin,
    model,
    where,
    run,
    first,
    second,
):
    """Add up ``w``, ``w x`` and the lower half of ``w x x^T`` over the visible pixels in ``box``.

    x = (F - ``origin``, M): ``channels`` (height, width, n), ``model`` = m is 4 (grey, by the
    weights ``grey`` (3,)) or 12, or 1 more: the last attribute is then 1 on the model, and the
    products of F with F are left out. The normals in M are those of the model's frame, by
    ``face_data`` (faces, 16) float32, see ``clusters``.
    ``where`` (RUN,) int64 and ``run`` (n + 17, RUN) are room to work in. Adds into ``first``
    (n + m,), ``second`` (n + m, n + m); returns the pixel count and the sum of the weights.

    Neighbours in a row that show the same face share its set-up: unscaled barycentrics are linear
    in the picture, and scaling them would not turn the normal. Pixels are gathered into runs, and
    the sums taken over a run at a time, channel against channel, so that they vectorise.
    """
    left, top, right, bottom = box
    n, width = channels.shape[2], channels.shape[1]
    colours = 1 if model < 12 else 3
    whole = model % 4 == 1
    at_model, at_normal = 1 + n, 1 + n + 4 * colours
    filled, pixels, total = 0, 0, 0.0
    for row in range(top, bottom):
        v = row + 0.5
        column = left
        while column < right:
            face = ids[row, column]
            if face < 0:
                column += 1
                continue
            end = column + 1
            while end < right and ids[row, end] == face:
                end += 1
            if filled + (end - column) > RUN:
                seen, weight = _add_run(
                    filled, where, run, channels, weights, origin, colours, whole, first, second
                )
                pixels += seen
                total += weight
                filled = 0
                end = min(end, column + RUN)
            f = np.uint32(face)
            a, b, c = _corners(faces, f)
            u = column + 0.5
            wa, wb, wc = homogeneous[a, 2], homogeneous[b, 2], homogeneous[c, 2]
            xa, ya = homogeneous[a, 0] - u * wa, homogeneous[a, 1] - v * wa
            xb, yb = homogeneous[b, 0] - u * wb, homogeneous[b, 1] - v * wb
            xc, yc = homogeneous[c, 0] - u * wc, homogeneous[c, 1] - v * wc
            la, lb, lc = xb * yc - xc * yb, xc * ya - xa * yc, xa * yb - xb * ya
            slope_a, slope_b, slope_c = wc * yb - wb * yc, wa * yc - wc * ya, wb * ya - wa * yb
            ax, ay, az = face_data[f, 0], face_data[f, 1], face_data[f, 2]
            bx, by, bz = face_data[f, 3], face_data[f, 4], face_data[f, 5]
            cx, cy, cz = face_data[f, 6], face_data[f, 7], face_data[f, 8]
            red, green, blue = face_data[f, 9], face_data[f, 10], face_data[f, 11]
            plain = face_data[f, 12] > 0.0
            texture, level = -1, 0
            if not plain:
                texture = face_texture[f]
            if texture >= 0:
                level = _texture_level(
                    homogeneous,
                    vertex_data,
                    a,
                    b,
                    c,
                    table[texture, 0, 1],
                    table[texture, 0, 2],
                    table.shape[1],
                )
            start = row * width + column
            for step in range(end - column):
                # Their sum is the signed area as seen by the camera: negative in front.
                side = 1.0 if la + lb + lc > 0.0 else -1.0
                # Snapping may put the pixel centre just outside the exact triangle: stay on it.
                sa, sb, sc = max(side * la, 0.0), max(side * lb, 0.0), max(side * lc, 0.0)
                la, lb, lc = la + slope_a, lb + slope_b, lc + slope_c
                if sa + sb + sc == 0.0:  # seen exactly edge-on; snapping alone made it visible
                    sa, sb, sc, side = 1.0, 1.0, 1.0, -1.0
                at = np.uint64(filled + step)
                where[at] = start + step
                run[at_normal, at] = -side * (sa * ax + sb * bx + sc * cx)
                run[at_normal + 1, at] = -side * (sa * ay + sb * by + sc * cy)
                run[at_normal + 2, at] = -side * (sa * az + sb * bz + sc * cz)
                if not plain:
                    red, green, blue = _reflectance(
                        sa, sb, sc, a, b, c, texture, level, vertex_data, texels, table
                    )
                if colours == 1:
                    run[at_model, at] = grey[0] * red + grey[1] * green + grey[2] * blue
                else:
                    run[at_model, at] = red
                    run[at_model + 4, at] = green
                    run[at_model + 8, at] = blue
            filled += end - column
            column = end
    seen, weight = _add_run(
        filled, where, run, channels, weights, origin, colours, whole, first, second
    )
    pixels += seen
    total += weight
    if whole:
        _copy_constant(n + model - 1, total, first, second)
    return pixels, total


@_jit
def _copy_constant(last, total, first, second):
    """Sums with the attribute that is 1 on the model: those without it."""
    for j in range(last):
        second[last, j] += first[j]
    first[last] += total
    second[last, last] += total


@_jit_sums
def _gather_photo(filled, where, run, channels, weights, origin):
    """Fill a run's weights and photo attributes; returns the pixels that count, and their weight.

    What does not count is 0, even where the photo is not a number.
    """
    n = channels.shape[2]
    flat_weights, flat_channels = weights.reshape(-1), channels.reshape(-1)
    total, pixels = 0.0, 0
    for p in range(filled):
        w = flat_weights[np.uint64(where[p])]
        counts = w > np.float32(0.0)
        w = w if counts else np.float32(0.0)
        run[0, p] = w
        total += w
        pixels += 1 if counts else 0
    for k in range(n):
        mean = origin[k]
        for p in range(filled):
            value = flat_channels[np.uint64(where[p] * n + k)] - mean
            run[1 + k, p] = value if run[0, p] > 0.0 else 0.0
    return pixels, total


@_jit_sums
def _add_run(filled, where, run, channels, weights, origin, colours, whole, first, second):
    """Add the sums over a run of pixels; returns the pixels that count, and their weight."""
    n = channels.shape[2]
    at_model, at_normal = 1 + n, 1 + n + 4 * colours
    pixels, total = _gather_photo(filled, where, run, channels, weights, origin)
    nx, ny, nz = run[at_normal], run[at_normal + 1], run[at_normal + 2]
    for p in range(filled):
        square = nx[p] * nx[p] + ny[p] * ny[p] + nz[p] * nz[p]
        scale = 1.0 / math.sqrt(max(square, TINY))
        nx[p] *= scale
        ny[p] *= scale
        nz[p] *= scale
    for colour in range(colours):
        at = at_model + 4 * colour
        k, kx, ky, kz = run[at], run[at + 1], run[at + 2], run[at + 3]
        for p in range(filled):
            kx[p] = k[p] * nx[p]
            ky[p] = k[p] * ny[p]
            kz[p] = k[p] * nz[p]
    weights_of_run, weighted = run[0], run[at_normal + 3]
    for i in range(n + 4 * colours):
        row = run[1 + i]
        mine = 0.0
        for p in range(filled):
            weighted[p] = weights_of_run[p] * row[p]
            mine += weighted[p]
        first[i] += mine
        if whole and i < n:
            continue
        for j in range(i + 1):
            other = run[1 + j]
            product = 0.0
            for p in range(filled):
                product += weighted[p] * other[p]
            second[i, j] += product
    return pixels, total
