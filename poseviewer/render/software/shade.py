"""Attributes of what each pixel shows, row by row. Arrays in, arrays out, without the GIL.

A face's plane equations and varyings give its attributes at any pixel, see ``rasterise``.

Arguments that kernels share: ``of_faces`` is (planes, colours (F + 1, 3) float32, whether any
reflectance varies within a face, varyings, levels of the faces' textures); ``textures`` is (tints
(F + 1, 3) float32 that a face's texture is multiplied by, the texture of each face (F,) int32,
texels and table of a ``TexturePyramid``); ``workspace`` is made by ``make_row``.
"""

import math

import numpy as np

from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.render.software.kernel import jit, jit_sums
from poseviewer.render.software.rasterise import COLUMN_OF, GREY, MAPPED, ROW_OF

NO_WEIGHT = np.float32(1e-20)
"""Homogeneous coordinate up to which varyings are those of no face, or of one seen edge-on."""
TINY = np.float32(1e-30)
"""Smallest squared length that is divided by."""
NORMAL = 0
"""First of 3 planes of attributes: unit normals."""
GREY_REFLECTANCE = 3
"""Plane of attributes: grey reflectance."""
COVERAGE = 4
"""Plane of attributes: 1 on the model."""
RED = 5
"""First of 3 planes of attributes: R, G, B."""
PLANES = 8
"""Number of planes of attributes."""
_MAPPED = np.float32(-MAPPED)
_ZERO = np.float32(0.0)
_RED, _GREEN, _BLUE = (np.float32(weight) for weight in GREY_WEIGHTS)


@jit
def make_row(width, rows):
    """Make the workspace for a row of pixels: normals (3, width), sums (rows, width), varyings."""
    normals, varying = np.empty((3, width), np.float32), np.empty((3, width), np.float32)
    return normals, np.empty((rows, width), np.float32), varying


@jit
def _sample(texels, offset, width, height, u, v):
    """Sample RGB bilinearly, wrapped around, v upwards; texel centres at (i + 0.5) / size."""
    x = (u - math.floor(u)) * width - 0.5
    y = (1.0 - (v - math.floor(v))) * height - 0.5
    x0, y0 = math.floor(x), math.floor(y)
    fx, fy = x - x0, y - y0
    left, upper = int(x0), int(y0)  # from -1 on: a modulo costs more than all the rest
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


@jit
def _sample_face(face, level, u, v, textures):
    """Return RGB of a MAPPED face at a point of its texture."""
    tints, face_texture, texels, table = textures
    offset, width, height = table[face_texture[face], level]
    r, g, b = _sample(texels, offset, width, height, u, v)
    return r * tints[face, 0], g * tints[face, 1], b * tints[face, 2]


@jit
def _clamp(value):
    """Clamp to [0, 1]: varyings of a face seen edge-on, which snapping made visible, are not."""
    return min(max(value, np.float32(0.0)), np.float32(1.0))


@jit
def span(ids, row, left, right):
    """Return the columns of a row that hold all visible pixels; ends excluded.

    Args:
        ids: (height, width) int32 of the picture.
        row: row of the picture.
        left: first column of the box.
        right: end of the box.
    """
    while left < right and ids[row, left] < 0:
        left += 1
    while right > left and ids[row, right - 1] < 0:
        right -= 1
    return left, right


@jit
def shade(box, ids, of_faces, textures, rotation, reflectance, normals):
    """Write the attributes of all pixels inside a box.

    Args:
        box: (left, top, right, bottom), ends excluded.
        ids: (height, width) int32 of the picture.
        of_faces: see the module.
        textures: see the module.
        rotation: (3, 3), camera from model, of the normals.
        reflectance: (height, width, 3) float32, written.
        normals: (height, width, 3) float32, written.
    """
    left, top, right, bottom = box
    workspace = of_row, run, _ = make_row(ids.shape[1], 3)
    nx, ny = of_row[0], of_row[1]
    nz = of_row[2]
    for row in range(top, bottom):
        begin, end = span(ids, row, left, right)
        faces = ids[row, begin:end]
        fill_row(row, begin, faces, of_faces, textures, workspace, 0)
        for k in range(end - begin):
            if faces[k] < 0:
                continue
            x, y = nx[k], ny[k]
            z = nz[k]
            length = math.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            for axis in range(3):
                normals[row, begin + k, axis] = scale * (
                    rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
                )
                reflectance[row, begin + k, axis] = run[axis, k]


@jit
def fill_row(row, first, faces, of_faces, textures, workspace, at):
    """Write normals (of any length, in the model's frame) and reflectance of a row's pixels.

    Args:
        row: row of the picture.
        first: column of the first pixel.
        faces: (n,) int32, of the pixels.
        of_faces: see the module.
        textures: see the module.
        workspace: made by ``make_row``.
        at: row of the workspace's sums for grey; 0: the first three rows take R, G and B.
    """
    planes, colours = of_faces[0], of_faces[1]
    normals, run, _ = workspace
    nx, ny = normals[0], normals[1]
    nz, grey = normals[2], run[at]
    size, down = faces.shape[0], np.float32(row)
    none = np.int64(planes.shape[0] - 1)
    for k in range(size):
        face = np.uint64(faces[k] if faces[k] >= 0 else none)  # the last plane is all zeros
        du, dv = np.float32(first + k) - planes[face, COLUMN_OF], down - planes[face, ROW_OF]
        nx[k] = planes[face, 0] + du * planes[face, 4] + dv * planes[face, 8]
        ny[k] = planes[face, 1] + du * planes[face, 5] + dv * planes[face, 9]
        nz[k] = planes[face, 2] + du * planes[face, 6] + dv * planes[face, 10]
        grey[k] = planes[face, GREY]
    if at == 0:
        for colour in range(3):
            out = run[colour]
            for k in range(size):
                out[k] = colours[np.uint64(faces[k] if faces[k] >= 0 else none), colour]
    if of_faces[2]:  # some reflectance varies
        _fill_varying(row, first, faces, of_faces, textures, workspace, at)


@jit
def _fill_varying(row, first, faces, of_faces, textures, workspace, at):
    """Write a row's reflectance where it varies within a face, whose kind is there, negative."""
    planes, _, _, varyings, levels = of_faces
    _, run, varying = workspace
    x, y = varying[0], varying[1]
    z, kinds = varying[2], run[at]
    size, least = faces.shape[0], _ZERO
    for k in range(size):
        least = min(least, kinds[k])
    if least == _ZERO:
        return
    down = np.float32(row)
    for k in range(size):
        if kinds[k] >= _ZERO:
            continue
        face = np.uint64(faces[k])
        du, dv = np.float32(first + k) - planes[face, COLUMN_OF], down - planes[face, ROW_OF]
        w = varyings[face, 3] + du * varyings[face, 7] + dv * varyings[face, 11]
        w = w if abs(w) > NO_WEIGHT else np.float32(1.0)
        x[k] = (varyings[face, 0] + du * varyings[face, 4] + dv * varyings[face, 8]) / w
        y[k] = (varyings[face, 1] + du * varyings[face, 5] + dv * varyings[face, 9]) / w
        z[k] = (varyings[face, 2] + du * varyings[face, 6] + dv * varyings[face, 10]) / w
        if kinds[k] == _MAPPED:
            x[k], y[k], z[k] = _sample_face(face, levels[face], x[k], y[k], textures)
        x[k], y[k] = _clamp(x[k]), _clamp(y[k])
        z[k] = _clamp(z[k])
    for k in range(size):
        if kinds[k] >= _ZERO:
            continue
        if at > 0:
            kinds[k] = _RED * x[k] + _GREEN * y[k] + _BLUE * z[k]
        else:
            kinds[k], run[1, k] = x[k], y[k]
            run[2, k] = z[k]


@jit
def fill_planes(box, ids, of_faces, textures, spans, out):
    """Write the attributes of all visible pixels as planes, normals in the model's frame.

    Args:
        box: (left, top, right, bottom), ends excluded.
        ids: (height, width) int32 of the picture.
        of_faces: see the module.
        textures: see the module.
        spans: (height, 2) int64, columns of each row that hold the model; as the last call left it.
        out: (PLANES, height + 2, width + 2) float32, as the last call left it.
    """
    workspace = normals, run, _ = make_row(ids.shape[1], 3)
    nx, ny = normals[0], normals[1]
    nz = normals[2]
    left, top, right, bottom = box
    for row in range(spans.shape[0]):
        begin, end = spans[row, 0], spans[row, 1]
        out[:, row + 1, begin + 1 : end + 1] = np.float32(0.0)
        begin, end = span(ids, row, left, right) if top <= row < bottom else (0, 0)
        spans[row, 0], spans[row, 1] = begin, end
        if begin < end:
            faces = ids[row, begin:end]
            fill_row(row, begin, faces, of_faces, textures, workspace, 0)
            _write_planes(row + 1, begin + 1, faces, nx, ny, nz, run, out)


@jit_sums
def _write_planes(row, begin, faces, x, y, z, run, out):
    size, none = faces.shape[0], np.float32(0.0)
    end = begin + size
    nx, ny = out[NORMAL, row, begin:end], out[NORMAL + 1, row, begin:end]
    nz, grey = out[NORMAL + 2, row, begin:end], out[GREY_REFLECTANCE, row, begin:end]
    covered = out[COVERAGE, row, begin:end]
    for p in range(size):
        square = x[p] * x[p] + y[p] * y[p] + z[p] * z[p]
        scale = np.float32(1.0) / math.sqrt(max(square, TINY))
        nx[p], ny[p] = scale * x[p], scale * y[p]
        nz[p] = scale * z[p]
        covered[p] = np.float32(1.0) if faces[p] >= 0 else none
    r, g = run[0], run[1]
    b = run[2]
    for p in range(size):
        grey[p] = _RED * r[p] + _GREEN * g[p] + _BLUE * b[p] if faces[p] >= 0 else none
    for colour in range(3):
        channel, value = out[RED + colour, row, begin:end], run[colour]
        for p in range(size):
            channel[p] = value[p] if faces[p] >= 0 else none
