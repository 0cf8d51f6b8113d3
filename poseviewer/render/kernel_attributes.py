"""The rasteriser's second half: the attributes of what each pixel shows, stored or added up.

What of a face is linear in the picture stands in its plane, see ``kernel_coverage``; so a pixel
needs no corners. Only reflectances that vary within a face are interpolated from them.

Compiled code is kept per file, so nothing here calls into ``kernel_coverage``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from poseviewer.render.kernel_compiler import kernel

TINY = np.float32(1e-30)
GREY, VARIES = 3, 14  # entries of a face's plane: its grey value; 1 where reflectance varies

_jit: Any = kernel()
# Sums alone may be taken in another order (lanes of a vector); rows are short, so it costs nothing.
_jit_sums: Any = kernel(fastmath={"reassoc", "contract", "nsz", "nnan"})


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
def _project(vertices, camera, index):
    """(X, Y, W) of a vertex, u = X / W, v = Y / W."""
    a, b, c = vertices[0, index], vertices[1, index], vertices[2, index]
    x = camera[0] * a + camera[1] * b + camera[2] * c + camera[9]
    y = camera[3] * a + camera[4] * b + camera[5] * c + camera[10]
    z = camera[6] * a + camera[7] * b + camera[8] * c + camera[11]
    w = z if camera[16] > 0.0 else 1.0
    return camera[12] * x + camera[14] * w, camera[13] * y + camera[15] * w, w


@_jit
def _texture_level(vertices, camera, vertex_data, a, b, c, width, height, levels):
    """Mip level of a face: half the log2 of texels per pixel, rounded, from the two areas."""
    xa, ya, wa = _project(vertices, camera, a)
    xb, yb, wb = _project(vertices, camera, b)
    xc, yc, wc = _project(vertices, camera, c)
    if wa <= 0.0 or wb <= 0.0 or wc <= 0.0:
        return 0
    ax, ay, bx, by, cx, cy = xa / wa, ya / wa, xb / wb, yb / wb, xc / wc, yc / wc
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
def _shares(u, v, vertices, camera, a, b, c):
    """The point of face (a, b, c) at (u, v): three shares that sum to 1.

    With homogeneous corners and ``x_i = X_i - u W_i``, ``y_i = Y_i - v W_i`` they are
    ``l_0 ~ x_1 y_2 - x_2 y_1`` and cyclic (Olano and Greer, *Triangle scan conversion using 2D
    homogeneous coordinates*, 1997), also where the face reaches behind the camera.
    """
    xa, ya, wa = _project(vertices, camera, a)
    xb, yb, wb = _project(vertices, camera, b)
    xc, yc, wc = _project(vertices, camera, c)
    xa, ya, xb, yb = xa - u * wa, ya - v * wa, xb - u * wb, yb - v * wb
    xc, yc = xc - u * wc, yc - v * wc
    la, lb, lc = xb * yc - xc * yb, xc * ya - xa * yc, xa * yb - xb * ya
    side = 1.0 if la + lb + lc > 0.0 else -1.0
    # Snapping may put the pixel centre just outside the exact triangle: stay on it.
    la, lb, lc = max(side * la, 0.0), max(side * lb, 0.0), max(side * lc, 0.0)
    total = la + lb + lc
    if total == 0.0:  # seen exactly edge-on; snapping alone made it visible
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    return la / total, lb / total, lc / total


@_jit
def _reflectance(u, v, face, level, surface, camera, textures):
    """RGB of a face whose reflectance varies: vertex colour, times the texture's, if any."""
    vertices, faces, vertex_data, face_texture = surface
    texels, table = textures
    f = np.uint32(face)
    a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
    la, lb, lc = _shares(u, v, vertices, camera, a, b, c)
    red = la * vertex_data[a, 3] + lb * vertex_data[b, 3] + lc * vertex_data[c, 3]
    green = la * vertex_data[a, 4] + lb * vertex_data[b, 4] + lc * vertex_data[c, 4]
    blue = la * vertex_data[a, 5] + lb * vertex_data[b, 5] + lc * vertex_data[c, 5]
    texture = face_texture[f]
    if texture < 0:
        return red, green, blue
    s = la * vertex_data[a, 6] + lb * vertex_data[b, 6] + lc * vertex_data[c, 6]
    t = la * vertex_data[a, 7] + lb * vertex_data[b, 7] + lc * vertex_data[c, 7]
    width, height = table[texture, level, 1], table[texture, level, 2]
    r, g, b_ = _sample(texels, table[texture, level, 0], width, height, s, t)
    return red * r, green * g, blue * b_


@_jit
def _level_of(face, surface, camera, textures):
    """Mip level of a face, 0 if it has no texture."""
    vertices, faces, vertex_data, face_texture = surface
    _, table = textures
    f = np.uint32(face)
    texture = face_texture[f]
    if texture < 0:
        return 0
    a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
    width, height = table[texture, 0, 1], table[texture, 0, 2]
    return _texture_level(vertices, camera, vertex_data, a, b, c, width, height, table.shape[1])


@_jit
def shade(box, ids, planes, colours, rotation, surface, camera, textures, reflectance, normals):
    """Write the attributes of all visible pixels inside ``box`` to (height, width, 3) pictures.

    ``surface`` is (vertices (3, V), faces (F, 3), vertex data (V, 8) float32: normal, RGB, UV, and
    texture of each face (F,)). ``textures`` as ``flatten_textures`` gives them.
    """
    left, top, right, bottom = box
    for row in range(top, bottom):
        last, level = -1, 0
        for column in range(left, right):
            face = ids[row, column]
            if face < 0:
                continue
            plane = planes[face]
            du, dv = column - plane[12], row - plane[13]
            x = plane[0] + du * plane[4] + dv * plane[8]
            y = plane[1] + du * plane[5] + dv * plane[9]
            z = plane[2] + du * plane[6] + dv * plane[10]
            length = math.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            for k in range(3):
                normals[row, column, k] = scale * (
                    rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
                )
            if plane[VARIES] > 0.0:
                if face != last:
                    last, level = face, _level_of(face, surface, camera, textures)
                colour = _reflectance(
                    column + 0.5, row + 0.5, face, level, surface, camera, textures
                )
                for k in range(3):
                    reflectance[row, column, k] = colour[k]
            else:
                for k in range(3):
                    reflectance[row, column, k] = colours[face, k]


@_jit
def _fill_plain(row, first, faces, planes, colours, count, normals, run, at_model):
    """Normals (of any length) and reflectance of a row's pixels, as far as faces alone tell."""
    size, down, none = faces.shape[0], np.float32(row), np.int64(planes.shape[0] - 1)
    nx, ny, nz, grey = normals[0], normals[1], normals[2], run[at_model]
    for k in range(size):
        face = np.uint64(faces[k] if faces[k] >= 0 else none)  # the last plane is all zeros
        du, dv = np.float32(first + k) - planes[face, 12], down - planes[face, 13]
        x = planes[face, 0] + du * planes[face, 4] + dv * planes[face, 8]
        y = planes[face, 1] + du * planes[face, 5] + dv * planes[face, 9]
        z = planes[face, 2] + du * planes[face, 6] + dv * planes[face, 10]
        nx[k], ny[k], nz[k], grey[k] = x, y, z, planes[face, GREY]
    if count == 1:
        return
    for colour in range(3):
        out = run[at_model + 4 * colour]
        for k in range(size):
            out[k] = colours[np.uint64(faces[k] if faces[k] >= 0 else none), colour]


@_jit
def _fill_varied(row, first, faces, planes, grey, surface, camera, textures, count, run, at_model):
    """The reflectance of those of a row's pixels whose face's reflectance varies."""
    last, level = np.int32(-1), 0
    for k in range(faces.shape[0]):
        face = faces[k]
        if face < 0 or planes[face, VARIES] == 0.0:
            continue
        if face != last:
            last, level = face, _level_of(face, surface, camera, textures)
        r, g, b = _reflectance(first + k + 0.5, row + 0.5, face, level, surface, camera, textures)
        if count == 1:
            run[at_model, k] = grey[0] * r + grey[1] * g + grey[2] * b
        else:
            run[at_model, k], run[at_model + 4, k], run[at_model + 8, k] = r, g, b


@_jit
def accumulate(
    box,
    ids,
    planes,
    colours,
    varies,
    surface,
    camera,
    textures,
    grey,
    planar,
    weights,
    origin,
    model,
    normals,
    weighted,
    run,
    first,
    second,
):
    """Add up ``w``, ``w x`` and the lower half of ``w x x^T`` over the visible pixels in ``box``.

    x = (F, M) - ``origin``: ``planar`` (n, height, width), ``model`` = m is 4 (grey, by the
    weights ``grey`` (3,)) or 12, or 1 more: the last attribute is then 1 on the model, and the
    products of F with F are left out. The normals in M are those of the model's frame. ``origin``
    (n + m,) is given for F and set for M. ``normals`` (3, width) float32, ``weighted`` (width,)
    float64 and ``run`` (n + 14, width) float32 are room for a row of pixels. Adds into ``first``
    (n + m,) and ``second`` (n + m, n + m); returns how many pixels of positive weight there were,
    and their weight.
    """
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
        _fill_plain(row, begin, faces, planes, colours, count, normals, run, at_model)
        if varies:
            _fill_varied(
                row, begin, faces, planes, grey, surface, camera, textures, count, run, at_model
            )
        _fill_products(end - begin, count, normals, run, at_model)
        if pixels == 0:
            _set_origin(end - begin, weight, n, count, run, origin)
        _centre(end - begin, n, count, run, origin)
        _add_products(end - begin, n, count, whole, weighted, run, first, second)
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
    """Reflectance times unit normals."""
    scale = run[at_model + 4 * count, :size]
    x, y, z = normals[0, :size], normals[1, :size], normals[2, :size]
    for p in range(size):
        square = x[p] * x[p] + y[p] * y[p] + z[p] * z[p]
        scale[p] = np.float32(1.0) / math.sqrt(max(square, TINY))
    for colour in range(count):
        at = at_model + 4 * colour
        k = run[at, :size]
        for axis in range(3):
            out, normal = run[at + 1 + axis, :size], normals[axis, :size]
            for p in range(size):
                out[p] = k[p] * (scale[p] * normal[p])


@_jit_sums
def _set_origin(size, weight, n, count, run, origin):
    """The means of a row's model attributes as their origin.

    Sums about it keep their digits where the model's attributes hardly vary.
    """
    used = run[0, :size]
    for j in range(n, n + 4 * count):
        row, total = run[1 + j, :size], np.float32(0.0)
        for p in range(size):
            total += used[p] * row[p]
        origin[j] = np.float32(total / weight)


@_jit_sums
def _centre(size, n, count, run, origin):
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
