"""The rasteriser's second half: the attributes of what each pixel shows.

What of a face is linear in the picture stands in its plane, see ``kernel_coverage``; so a pixel
needs no corners. Only reflectances that vary within a face are interpolated from them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from poseviewer.render.software.kernel_blocks import (
    COLUMN_OF,
    GRADED,
    GREY,
    MAPPED,
    NO_WEIGHT,
    ROW_OF,
    normals_of_four,
    paints_of_four,
)
from poseviewer.render.software.kernel_compiler import kernel

TINY = np.float32(1e-30)
_GRADED, _MAPPED, _ZERO = np.float32(-GRADED), np.float32(-MAPPED), np.float32(0.0)

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
    left, upper = int(x0), int(y0)  # from -1 on: divisions would cost more than all the rest
    right, lower = left + 1, upper + 1
    left, right = left if left >= 0 else width - 1, right if 0 <= right < width else 0
    upper, lower = upper if upper >= 0 else height - 1, lower if 0 <= lower < height else 0
    top, bottom = offset + upper * width, offset + lower * width
    a, b = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)
    c, d = (1.0 - fx) * fy, fx * fy
    p, q = texels[np.uint64(top + left)], texels[np.uint64(top + right)]
    r, s = texels[np.uint64(bottom + left)], texels[np.uint64(bottom + right)]
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
def _edge(one, two):
    """(p, q, r): the edge through two corners is ``p + q u + r v``, 0 on it."""
    (xa, ya, wa), (xb, yb, wb) = one, two
    return xa * yb - xb * ya, wb * ya - wa * yb, wa * xb - wb * xa


@_jit
def _set_up(face, level, surface, camera, textures):
    """What all pixels of a face share: corners, edges, and offset, width, height of its texture.

    With homogeneous corners and ``x_i = X_i - u W_i``, ``y_i = Y_i - v W_i`` the shares of a point
    are ``l_0 ~ x_1 y_2 - x_2 y_1`` and cyclic, linear in u and v (Olano and Greer, *Triangle scan
    conversion using 2D homogeneous coordinates*, 1997), also where the face reaches behind the
    camera.
    """
    (vertices, faces, _, face_texture), (_, table) = surface, textures
    f = np.uint32(face)
    a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
    one, two = _project(vertices, camera, a), _project(vertices, camera, b)
    three = _project(vertices, camera, c)
    edges = _edge(two, three), _edge(three, one), _edge(one, two)
    offset, width, height = table[face_texture[f], level]
    return (a, b, c), edges, (offset, width, height)


@_jit
def _shares(u, v, edges):
    """The point of a face at (u, v): three shares that sum to 1."""
    (pa, qa, ra), (pb, qb, rb), (pc, qc, rc) = edges
    la, lb, lc = pa + qa * u + ra * v, pb + qb * u + rb * v, pc + qc * u + rc * v
    side = 1.0 if la + lb + lc > 0.0 else -1.0
    # Snapping may put the pixel centre just outside the exact triangle: stay on it.
    la, lb, lc = max(side * la, 0.0), max(side * lb, 0.0), max(side * lc, 0.0)
    total = la + lb + lc
    if total == 0.0:  # seen exactly edge-on; snapping alone made it visible
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    return la / total, lb / total, lc / total


@_jit
def _reflectance(u, v, vertex_data, texels, corners, edges, texture):
    """RGB at (u, v) of a face that is set up: vertex colour times the texture's."""
    la, lb, lc = _shares(u, v, edges)
    a, b, c = vertex_data[corners[0]], vertex_data[corners[1]], vertex_data[corners[2]]
    red = la * a[3] + lb * b[3] + lc * c[3]
    green = la * a[4] + lb * b[4] + lc * c[4]
    blue = la * a[5] + lb * b[5] + lc * c[5]
    offset, width, height = texture
    s, t = la * a[6] + lb * b[6] + lc * c[6], la * a[7] + lb * b[7] + lc * c[7]
    r, g, b_ = _sample(texels, offset, width, height, s, t)
    return red * r, green * g, blue * b_


@_jit
def _textured(face, level, u, v, of_model):
    """RGB of a MAPPED face at a point of its texture."""
    (_, faces, vertex_data, face_texture), _, (texels, table) = of_model
    offset, width, height = table[face_texture[face], level]
    r, g, b = _sample(texels, offset, width, height, u, v)
    colour = vertex_data[np.uint32(faces[face, 0])]
    return r * colour[3], g * colour[4], b * colour[5]


@_jit
def _of_both(face, level, column, row, of_model):
    """RGB of a face of the kind BOTH at a pixel."""
    surface, camera, textures = of_model
    corners, edges, texture = _set_up(face, level, surface, camera, textures)
    return _reflectance(column + 0.5, row + 0.5, surface[2], textures[0], corners, edges, texture)


@_jit
def _colour(face, column, row, du, dv, of_faces, of_model):
    """RGB of a face at a pixel, (du, dv) from that of its plane."""
    colours, paint, levels = of_faces[1], of_faces[3], of_faces[4]
    kind = colours[face, 0]
    if kind >= 0.0:
        return colours[face, 0], colours[face, 1], colours[face, 2]
    if kind < _MAPPED:
        return _of_both(face, levels[face], column, row, of_model)
    x = paint[face, 0] + du * paint[face, 4] + dv * paint[face, 8]
    y = paint[face, 1] + du * paint[face, 5] + dv * paint[face, 9]
    z = paint[face, 2] + du * paint[face, 6] + dv * paint[face, 10]
    w = paint[face, 3] + du * paint[face, 7] + dv * paint[face, 11]
    w = w if abs(w) > NO_WEIGHT else np.float32(1.0)
    x, y, z = x / w, y / w, z / w
    if kind == _MAPPED:
        return _textured(face, levels[face], x, y, of_model)
    return _bounded(x), _bounded(y), _bounded(z)


@_jit
def _bounded(value):
    """In [0, 1]: a face seen edge-on, which snapping alone made visible, may have any paint."""
    return min(max(value, np.float32(0.0)), np.float32(1.0))


@_jit
def shade(box, ids, of_faces, rotation, of_model, reflectance, normals):
    """Write the attributes of all visible pixels inside ``box`` to (height, width, 3) pictures.

    ``of_faces`` is (planes, colours, whether any reflectance varies within a face, paints, levels
    of the faces' textures); ``of_model`` is (surface, camera, textures): the surface (vertices
    (3, V), faces (F, 3), vertex data (V, 8) float32: normal, RGB, UV, and texture of each face
    (F,)), the textures as ``flatten_textures`` gives them.
    """
    (left, top, right, bottom), planes = box, of_faces[0]
    for row in range(top, bottom):
        for column in range(left, right):
            if ids[row, column] < 0:
                continue
            face = np.uint32(ids[row, column])
            plane = planes[face]
            du, dv = np.float32(column) - plane[COLUMN_OF], np.float32(row) - plane[ROW_OF]
            x = plane[0] + du * plane[4] + dv * plane[8]
            y = plane[1] + du * plane[5] + dv * plane[9]
            z = plane[2] + du * plane[6] + dv * plane[10]
            length = math.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            for k in range(3):
                normals[row, column, k] = scale * (
                    rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
                )
            colour = _colour(face, column, row, du, dv, of_faces, of_model)
            for k in range(3):
                reflectance[row, column, k] = colour[k]


@_jit
def fill_plain(row, first, faces, planes, colours, count, normals, run, at_model):
    """Normals (of any length) and reflectance of a row's pixels, as far as faces alone tell."""
    size, down, none = faces.shape[0], np.float32(row), np.int64(planes.shape[0] - 1)
    nx, ny, nz, grey = normals[0], normals[1], normals[2], run[at_model]
    fours = size & ~3
    for k in range(0, fours, 4):
        normals_of_four(faces, k, first + k, row, planes, nx, ny, nz, grey)
    for k in range(fours, size):
        face = np.uint64(faces[k] if faces[k] >= 0 else none)  # the last plane is all zeros
        du, dv = np.float32(first + k) - planes[face, COLUMN_OF], down - planes[face, ROW_OF]
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
def fill_varied(row, first, faces, of_faces, grey, of_model, count, room, run, at_model):
    """The reflectance of those of a row's pixels where it varies within the face: they have the
    face's kind there, negative. ``room`` (3, width + 3).
    """
    planes, _, _, paints, levels = of_faces
    size, kinds, least = faces.shape[0], run[at_model], _ZERO
    for k in range(size):
        least = min(least, kinds[k])
    if least == _ZERO:
        return
    x, y, z = room[0], room[1], room[2]
    for k in range(0, size, 4):  # beyond the row's end, too: there is room
        paints_of_four(faces, k, first + k, row, planes, paints, x, y, z)
    if least < _GRADED:
        _fill_textured(row, first, faces, levels, of_model, kinds, x, y, z)
    red, green, blue = np.float32(grey[0]), np.float32(grey[1]), np.float32(grey[2])
    if count == 1:
        for k in range(size):
            mixed = red * _bounded(x[k]) + green * _bounded(y[k]) + blue * _bounded(z[k])
            kinds[k] = mixed if kinds[k] < _ZERO else kinds[k]
        return
    greens, blues = run[at_model + 4], run[at_model + 8]
    for k in range(size):
        greens[k] = _bounded(y[k]) if kinds[k] < _ZERO else greens[k]
        blues[k] = _bounded(z[k]) if kinds[k] < _ZERO else blues[k]
        kinds[k] = _bounded(x[k]) if kinds[k] < _ZERO else kinds[k]


@_jit
def _fill_textured(row, first, faces, levels, of_model, kinds, x, y, z):
    """R, G, B instead of u, v of the pixels whose faces have textures."""
    for k in range(faces.shape[0]):
        if kinds[k] >= _GRADED:
            continue
        face = np.uint32(faces[k])
        if kinds[k] == _MAPPED:
            x[k], y[k], z[k] = _textured(face, levels[face], x[k], y[k], of_model)
        else:
            x[k], y[k], z[k] = _of_both(face, levels[face], first + k, row, of_model)


@_jit
def fill_planes(box, ids, of_faces, of_model, grey, room, spans, out):
    """Attributes of all visible pixels inside ``box`` as planes, normals in the model's frame.

    ``out`` (5 or 8, height + 2, width + 2): unit normals, grey reflectance, 1 where the model is,
    and R, G, B; zeros elsewhere. ``spans`` (height, 2) are the columns of each row that hold all of
    it, ends excluded; they and ``out`` are given as the last call left them. The others are as for
    ``accumulate``.
    """
    planes, colours, varies = of_faces[0], of_faces[1], of_faces[2]
    normals, _, run, paint = room
    count = 3 if out.shape[0] > 5 else 1
    red, green, blue = np.float32(grey[0]), np.float32(grey[1]), np.float32(grey[2])
    left, top, right, bottom = box
    for row in range(spans.shape[0]):
        begin, end = spans[row, 0], spans[row, 1]
        for k in range(out.shape[0]):
            out[k, row + 1, begin + 1 : end + 1] = np.float32(0.0)
        begin, end = (left, right) if top <= row < bottom else (0, 0)
        while begin < end and ids[row, begin] < 0:
            begin += 1
        while end > begin and ids[row, end - 1] < 0:
            end -= 1
        spans[row, 0], spans[row, 1] = begin, end
        if begin == end:
            continue
        faces = ids[row, begin:end]
        fill_plain(row, begin, faces, planes, colours, count, normals, run, 0)
        if varies:
            fill_varied(row, begin, faces, of_faces, grey, of_model, count, paint, run, 0)
        _write_planes(row + 1, begin + 1, faces, count, red, green, blue, normals, run, out)


@_jit_sums
def _write_planes(row, first, faces, count, red, green, blue, normals, run, out):
    size, none = faces.shape[0], np.float32(0.0)
    x, y, z = normals[0, :size], normals[1, :size], normals[2, :size]
    nx, ny = out[0, row, first : first + size], out[1, row, first : first + size]
    nz, covered = out[2, row, first : first + size], out[4, row, first : first + size]
    for p in range(size):
        square = x[p] * x[p] + y[p] * y[p] + z[p] * z[p]
        scale = np.float32(1.0) / math.sqrt(max(square, TINY))
        nx[p], ny[p], nz[p] = scale * x[p], scale * y[p], scale * z[p]
        covered[p] = np.float32(1.0) if faces[p] >= 0 else none
    k, r, g, b = out[3, row, first : first + size], run[0, :size], run[4, :size], run[8, :size]
    for p in range(size):
        mixed = r[p] if count == 1 else red * r[p] + green * g[p] + blue * b[p]
        k[p] = mixed if faces[p] >= 0 else none
    for colour in range(3 if count == 3 else 0):
        channel, value = out[5 + colour, row, first : first + size], run[4 * colour, :size]
        for p in range(size):
            channel[p] = value[p] if faces[p] >= 0 else none
