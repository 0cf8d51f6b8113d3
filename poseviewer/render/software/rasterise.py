"""Which face each pixel shows: a depth buffer. Arrays in, arrays out, without the GIL.

Vertices are snapped to 1/256 px and edges tested in integers with the top-left rule (J. Pineda, *A
parallel algorithm for polygon rasterization*, 1988), so that a pixel centre on a shared edge
belongs to exactly one face. A depth value is 1/z under perspective, -z in parallel projection:
linear in the picture, and the greater the nearer. Of two faces at the same depth the first is seen.

Each face that is seen has *plane equations* of its normal, of any length (PLANE,) float32: three
entries each for the value at a reference pixel, for what a column more adds, and for what a row
more adds. Its *varyings* (VARYING,) have four each: R, G, B or u, v, 0, and the homogeneous
coordinate that these are divided by. The last row of either, of no face, is zeros.

Faces up to SMALL are drawn a CHUNK at a time in 32 bits, larger ones and those that reach behind
the camera are cut into triangles that are drawn in 64 bits.
"""

import math
from typing import Any

import numpy as np

from poseviewer.render.software.blocks import (
    ACROSS,
    ALONG,
    BLOCK,
    CHUNK,
    DEPTHS,
    DOWN,
    EDGE,
    RIGHT,
    SCALE,
    STEPS,
    VALUE,
    VALUES,
    WEIGHTS,
    draw_blocks,
)
from poseviewer.render.software.kernel import jit, kernel

SUBPIXELS = 256
"""Steps of a pixel to which vertices are snapped."""
GUARD_PX = float(1 << 20)
"""px from 0 beyond which faces are clipped, so that edge functions fit into 64 bits."""
SMALL = 64 * SUBPIXELS
"""Size, 1/256 px, up to which a triangle's edge functions fit into 32 bits."""
OFF_SCREEN = np.int32(-(1 << 31))
"""Coordinate of a vertex behind the near plane or beyond the guard band."""
NO_FACE = np.int32(-1)
"""Index of a pixel that shows nothing."""
MAX_PIECES = 6
"""Triangles of a face that is cut: by five planes it gets eight corners."""

TRANSLATION = 9
"""First of 3 entries of a camera, behind those of the rotation, row by row."""
FOCAL = 12
"""First of 2 entries of a camera: fx, fy, or twice the scale."""
PRINCIPAL = 14
"""First of 2 entries of a camera: cx, cy."""
NEAR = 16
"""Entry of a camera: smallest z under perspective, 0 for parallel projection."""
CAMERA = 17
"""Number of entries of a camera."""

PLAIN = 0
"""Kind of a face of one colour."""
GRADED = 1
"""Kind of a face with colours at its corners."""
MAPPED = 2
"""Kind of a face with a texture and one colour."""
COLUMN_OF = 12
"""Entry of a face's plane equations: column of their reference pixel."""
ROW_OF = 13
"""Entry of a face's plane equations: row of their reference pixel."""
GREY = 15
"""Entry of a face's plane equations: its grey reflectance, or its kind, negative, without one."""
PLANE = 16
"""Number of entries of a face's plane equations."""
VARYING = 12
"""Number of entries of a face's varyings."""

BOX_LEFT = 0
"""Row of ``boxes``: first column of a face's box."""
BOX_TOP = 1
"""Row of ``boxes``: first row of a face's box."""
BOX_RIGHT = 2
"""Row of ``boxes``: last column of a face's box."""
BOX_BOTTOM = 3
"""Row of ``boxes``: last row of a face's box."""
COLUMN = 4
"""Row of ``boxes``: first column of the first block."""
STATE = 5
"""Row of ``boxes``: HIDDEN, DRAWN or LARGE."""
LISTED = 6
"""Row of ``boxes``: columns of the faces that are drawn, at its beginning."""
BOXES = 7
"""Number of rows of ``boxes``."""
HIDDEN = np.int32(0)
"""State of a face that holds no pixel centre."""
DRAWN = np.int32(1)
"""State of a face that is drawn in 32 bits."""
LARGE = np.int32(2)
"""State of a face that is cut and drawn in 64 bits."""
_i32 = np.int32  # sums of 32 bits would have 64, and vectors half the lanes
_SUB = _i32(SUBPIXELS)
_HALF_SUB = _i32(128)
_HALF_LESS = _i32(127)
_BITS = _i32(8)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)

# For what is done for every face: a call costs more than it does.
_jit_inline: Any = kernel(forceinline=True)
# For loops over finite numbers: they vectorise. Sums keep their order, and nothing is contracted.
_jit_lanes: Any = kernel(fastmath={"nsz", "nnan"})


@jit
def rasterise(drawn, surface, camera, width, workspace, picture):
    """Draw a model; sets the plane equations and varyings of the faces that show.

    Args:
        drawn: what the last call returned.
        surface: (vertices (3, V) float32, faces (F, 3) int32, normals (F + 1, 9) float32 at their
            corners).
        camera: (CAMERA,) float64: camera_from_model, intrinsics and near plane.
        width: width of the picture; its arrays have whole BLOCKs of columns.
        workspace: (screen (2, V) int32, depths (V,) float32, large (F,) int32, planes (F + 1,
            PLANE) float32, shading), with shading = (kinds (F,) uint8, attributes of corners (F +
            1, VARYING) float32, texel areas (F,) float64, count of texture levels, varyings (F + 1,
            VARYING) float32, levels (F + 1,) int32).
        picture: (depth float32, ids int32), (height, width).

    Returns:
        (left, top, right, bottom), whole px, ends excluded: outside the picture is empty.
    """
    vertices, faces, normals = surface
    screen, depths, large, planes, shading = workspace
    depth, ids = picture
    left, top, right, bottom = drawn
    depth[top:bottom, left:right] = -np.inf
    ids[top:bottom, left:right] = NO_FACE
    box = _project(vertices, camera, screen, depths, width, depth.shape[0])
    near, distance = camera[NEAR], camera[TRANSLATION + 2]
    weighs = np.float32(max(distance, near) if near > 0.0 else -1.0)
    shape = faces, screen, depths, normals
    count = _draw_small(shape, weighs, planes, shading, width, large, picture)
    if count > 0:
        owners, corners, values = _cut(large[:count], shape, vertices, camera, planes, shading)
        for i in range(owners.shape[0]):
            _draw_piece(corners[i], values[i], owners[i], width, depth, ids)
    return box


@_jit_lanes
def _project(vertices, camera, screen, depths, width, height):
    """Set ``screen`` (2, V), 1/256 px, and ``depths`` (V,); returns the box of pixels touched."""
    x, y = vertices[0], vertices[1]
    z, near = vertices[2], np.float32(camera[NEAR])
    r0, r1 = np.float32(camera[6]), np.float32(camera[7])
    r2, shift = np.float32(camera[8]), np.float32(camera[TRANSLATION + 2])
    perspective = near > _ZERO
    for i in range(x.shape[0]):
        distance = r0 * x[i] + r1 * y[i] + r2 * z[i] + shift
        depths[i] = _ONE / max(distance, near) if perspective else -distance
    left, right, off = _snap(0, vertices, camera, depths, screen[0])
    top, bottom, also_off = _snap(1, vertices, camera, depths, screen[1])
    if off | also_off > 0:
        return 0, 0, width, height
    if left > right:
        return 0, 0, 0, 0
    first, upper = min(max((left >> 8) - 1, 0), width), min(max((top >> 8) - 1, 0), height)
    last, lower = min((right >> 8) + 2, width), min((bottom >> 8) + 2, height)
    return first, upper, max(last, first), max(lower, upper)


@_jit_lanes
def _snap(axis, vertices, camera, depths, out):
    """Set coordinates ``out`` (V,), 1/256 px; returns least, greatest, whether any is off."""
    x, y = vertices[0], vertices[1]
    z, near = vertices[2], np.float32(camera[NEAR])
    r0, r1 = np.float32(camera[3 * axis]), np.float32(camera[3 * axis + 1])
    r2, shift = np.float32(camera[3 * axis + 2]), np.float32(camera[TRANSLATION + axis])
    focal, centre = np.float32(camera[FOCAL + axis]), np.float32(camera[PRINCIPAL + axis])
    perspective = near > _ZERO
    nearest = _ONE / near if perspective else np.float32(np.inf)
    least, greatest = np.int32(2**31 - 1), -np.int32(2**31 - 1)
    off = np.int32(0)
    for i in range(x.shape[0]):
        along = focal * (r0 * x[i] + r1 * y[i] + r2 * z[i] + shift)
        px = along * (depths[i] if perspective else _ONE) + centre
        outside = (abs(px) > np.float32(GUARD_PX)) | (depths[i] >= nearest)
        snapped = np.int32(np.floor((_ZERO if outside else px) * np.float32(SUBPIXELS) + _HALF))
        off |= np.int32(1) if outside else np.int32(0)
        least, greatest = min(least, snapped), max(greatest, snapped)
        out[i] = OFF_SCREEN if outside else snapped
    return least, greatest, off


@jit
def _draw_small(shape, weighs, planes, shading, width, large, picture):
    """Draw faces with corners' weights ``weighs`` x depth (negative: 1); lists the large ones."""
    (faces, screen, depths, normals), (depth, ids) = shape, picture
    kinds, attributes, texel_areas, count_of_levels, varyings, levels = shading
    # A column for each face: x, then y, of the three corners, 1/256 px.
    corners, boxes = np.empty((6, CHUNK), np.int32), np.empty((BOXES, CHUNK), np.int32)
    steps, values = np.empty((STEPS, CHUNK), np.int32), np.empty((VALUES, CHUNK), np.float32)
    has_varyings, left_over = attributes.shape[0] > 1, 0
    for begin in range(0, faces.shape[0], CHUNK):
        size = min(CHUNK, faces.shape[0] - begin)
        _gather(begin, size, faces, screen, depths, corners, values)
        _find_boxes(size, width, depth.shape[0], corners, boxes)
        _set_up(size, corners, boxes, values)
        for k in range(3):
            _set_edge(size, k, weighs, corners, boxes, steps, values)
        for k in range(_list_drawn(size, boxes)):
            i = np.int64(boxes[LISTED, k])
            face = np.int32(begin + i)
            if boxes[STATE, i] == LARGE:
                large[left_over] = face
                left_over += 1
                continue
            left, top = np.int64(boxes[COLUMN, i]), np.int64(boxes[BOX_TOP, i])
            right, bottom = np.int64(boxes[BOX_RIGHT, i]), np.int64(boxes[BOX_BOTTOM, i])
            if draw_blocks(depth, ids, steps, values, i, left, right, top, bottom, face):
                f = np.uint32(face)
                _combine(normals, values, i, f, np.uint32(3), planes)
                planes[f, COLUMN_OF], planes[f, ROW_OF] = np.float32(left), np.float32(top)
                if has_varyings and kinds[f] != PLAIN:
                    _combine(attributes, values, i, f, np.uint32(4), varyings)
                    pixels = _ONE / (abs(values[SCALE, i]) * _SUB * _SUB)
                    levels[f] = _texture_level(texel_areas[f], pixels, count_of_levels)
    return left_over


@_jit_inline
def _combine(corners, values, i, face, size, out):
    """Set plane equations of ``face``, a chunk's ``i``-th, from ``size`` values a corner."""
    for step in range(3):
        at = WEIGHTS + 3 * step
        a, b = values[at, i], values[at + 1, i]
        c = values[at + 2, i]
        for k in range(size):
            first, second = corners[face, k], corners[face, size + k]
            third = corners[face, 2 * size + k]
            out[face, 4 * step + k] = a * first + b * second + c * third


@jit
def _texture_level(texels, pixels, count):
    """Return the mip level of a face: half the log2 of texels per pixel, rounded."""
    if texels <= pixels:
        return 0
    if pixels <= 0.0:
        return count - 1
    return min(int(0.5 * math.log2(texels / pixels) + 0.5), count - 1)


@jit
def _gather(begin, size, faces, screen, depths, corners, values):
    """Set corners and depth values of the faces from ``begin`` on."""
    for i in range(size):
        for k in range(3):
            vertex = np.uint32(faces[np.uint32(begin + i), k])
            corners[k, i], corners[3 + k, i] = screen[0, vertex], screen[1, vertex]
            values[DEPTHS + k, i] = depths[vertex]


@_jit_inline
def _edge_at(xa, ya, xb, yb, px, py, sign):
    """Return an edge function, what the top-left rule takes, its steps across and down."""
    ex, ey = _i32(sign * _i32(xb - xa)), _i32(sign * _i32(yb - ya))
    excluded = _i32(0) if (ey < 0) | ((ey == 0) & (ex > 0)) else _i32(1)
    e = _i32(_i32(ex * _i32(py - ya)) - _i32(ey * _i32(px - xa)))
    return e, excluded, _i32(-ey * _SUB), _i32(ex * _SUB)


@jit
def _find_boxes(size, width, height, corners, boxes):
    """Set the pixels whose centres the faces' boxes hold: first and last columns and rows."""
    for axis, length in enumerate((width, height)):
        at, end = 3 * axis, _i32(length - 1)
        a, b = corners[at, :size], corners[at + 1, :size]
        c = corners[at + 2, :size]
        first, last = boxes[BOX_LEFT + axis, :size], boxes[BOX_RIGHT + axis, :size]
        for i in range(size):
            first[i] = max(_i32(_i32(min(a[i], b[i], c[i]) + _HALF_LESS) >> _BITS), _i32(0))
            last[i] = min(_i32(_i32(max(a[i], b[i], c[i]) - _HALF_SUB) >> _BITS), end)


@jit
def _set_up(size, corners, boxes, values):
    """Set each face's STATE, first COLUMN and depth there, on the first row of its box."""
    # A face two pixels wide and high at most is drawn only if it holds the centre of one of them.
    # No branches and 32 bits alone, here and below, so that it is done in vectors.
    x0, y0 = corners[0, :size], corners[3, :size]
    x1, y1 = corners[1, :size], corners[4, :size]
    x2, y2 = corners[2, :size], corners[5, :size]
    left, top = boxes[BOX_LEFT, :size], boxes[BOX_TOP, :size]
    right, bottom = boxes[BOX_RIGHT, :size], boxes[BOX_BOTTOM, :size]
    z0, z1 = values[DEPTHS, :size], values[DEPTHS + 1, :size]
    z2, value = values[DEPTHS + 2, :size], values[VALUE, :size]
    across, along = values[ACROSS, :size], values[ALONG, :size]
    column, state = boxes[COLUMN, :size], boxes[STATE, :size]
    signed_scale, none = values[SCALE, :size], _i32(0)
    for i in range(size):
        area = _i32(
            _i32(_i32(x1[i] - x0[i]) * _i32(y2[i] - y0[i]))
            - _i32(_i32(x2[i] - x0[i]) * _i32(y1[i] - y0[i]))
        )
        sign = _i32(1) if area > none else _i32(-1)  # y runs down: a front has an area < 0
        px, py = _i32(_i32(left[i] * _SUB) + _HALF_SUB), _i32(_i32(top[i] * _SUB) + _HALF_SUB)
        e0, b0, r0, d0 = _edge_at(x1[i], y1[i], x2[i], y2[i], px, py, sign)
        e1, b1, r1, d1 = _edge_at(x2[i], y2[i], x0[i], y0[i], px, py, sign)
        e2, b2, r2, d2 = _edge_at(x0[i], y0[i], x1[i], y1[i], px, py, sign)
        scale = _ONE / np.float32(_i32(sign * area))
        s1, s2 = (z1[i] - z0[i]) * scale, (z2[i] - z0[i]) * scale
        slope = np.float32(r1) * s1 + np.float32(r2) * s2
        # Whole blocks: a block that was just written can be read again without waiting for it.
        begin = _i32(left[i] & _i32(-BLOCK))
        at_left = z0[i] + np.float32(e1) * s1 + np.float32(e2) * s2
        value[i] = at_left - np.float32(_i32(left[i] - begin)) * slope
        across[i] = slope
        along[i] = np.float32(d1) * s1 + np.float32(d2) * s2
        signed_scale[i] = np.float32(-sign) * scale  # normals point to the side that is seen
        f0, f1 = _i32(e0 - b0), _i32(e1 - b1)
        f2 = _i32(e2 - b2)
        outside = _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        f0, f1 = _i32(f0 + d0), _i32(f1 + d1)
        f2 = _i32(f2 + d2)
        outside &= _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        columns, rows = _i32(right[i] - left[i]), _i32(bottom[i] - top[i])
        is_drawn = (_i32(outside) >= none) | (max(columns, rows) > _i32(1))
        is_drawn &= (min(columns, rows) >= none) & (area != none)
        min_x, max_x = min(x0[i], x1[i], x2[i]), max(x0[i], x1[i], x2[i])
        min_y, max_y = min(y0[i], y1[i], y2[i]), max(y0[i], y1[i], y2[i])
        is_large = max(_i32(max_x - min_x), _i32(max_y - min_y)) > _i32(SMALL)
        is_large |= min(min_x, min_y) == OFF_SCREEN
        column[i] = begin
        state[i] = LARGE if is_large else (DRAWN if is_drawn else HIDDEN)


@jit
def _set_edge(size, k, weighs, corners, boxes, steps, values):
    """Set the edge function opposite corner ``k`` in ``steps`` and, weighed, in ``values``."""
    a, b = (k + 1) % 3, (k + 2) % 3
    xa, ya = corners[a, :size], corners[3 + a, :size]
    xb, yb = corners[b, :size], corners[3 + b, :size]
    column, top = boxes[COLUMN, :size], boxes[BOX_TOP, :size]
    scale, depth = values[SCALE, :size], values[DEPTHS + k, :size]
    edge, right = steps[EDGE + k, :size], steps[RIGHT + k, :size]
    down = steps[DOWN + k, :size]
    here, across = values[WEIGHTS + k, :size], values[WEIGHTS + 3 + k, :size]
    along, perspective = values[WEIGHTS + 6 + k, :size], weighs > _ZERO
    for i in range(size):
        px, py = _i32(_i32(column[i] * _SUB) + _HALF_SUB), _i32(_i32(top[i] * _SUB) + _HALF_SUB)
        sign = _i32(-1) if scale[i] > _ZERO else _i32(1)
        e, excluded, r, d = _edge_at(xa[i], ya[i], xb[i], yb[i], px, py, sign)
        edge[i] = _i32(e - excluded)
        right[i], down[i] = r, d
        weight = scale[i] * (weighs * depth[i] if perspective else _ONE)
        here[i], across[i] = np.float32(e) * weight, np.float32(r) * weight
        along[i] = np.float32(d) * weight


@jit
def _list_drawn(size, boxes):
    """List the columns of the faces that are drawn in row LISTED; returns their count."""
    state, listed = boxes[STATE], boxes[LISTED]
    count = np.uint32(0)
    for i in range(size):
        listed[count] = i
        count += np.uint32(1) if state[i] > 0 else np.uint32(0)
    return count


@jit
def _cut(large, shape, vertices, camera, planes, shading):
    """Cut ``large`` faces to faces (T,), corners (T, 3, 2) in 1/256 px, depths there (T, 3)."""
    faces, screen, depths, normals = shape
    kinds, attributes, texel_areas, count_of_levels, varyings, levels = shading
    size = MAX_PIECES * large.shape[0]
    owners, corners = np.empty(size, np.int32), np.empty((size, 3, 2), np.int64)
    values = np.empty((size, 3), np.float32)
    triangle, other = np.empty((8, 4)), np.empty((8, 4))  # (X, Y, W, d) of up to 8 corners
    near, pieces = camera[NEAR], 0
    for face in large:
        off = False
        for k in range(3):
            vertex = faces[face, k]
            _set_homogeneous(vertices, vertex, camera, triangle[k])
            off |= screen[0, vertex] == OFF_SCREEN or screen[1, vertex] == OFF_SCREEN
            corners[pieces, k, 0], corners[pieces, k, 1] = screen[0, vertex], screen[1, vertex]
            values[pieces, k] = depths[vertex]
        _set_plane(face, triangle, normals, planes)
        planes[face, COLUMN_OF] = planes[face, ROW_OF] = -0.5  # its centre is the origin
        if attributes.shape[0] > 1 and kinds[face] != PLAIN:
            _set_plane(face, triangle, attributes, varyings)
            area = _pixel_area(triangle)
            levels[face] = _texture_level(texel_areas[face], area, count_of_levels)
        owners[pieces] = face
        if not off:
            pieces += 1
            continue
        polygon, count = _clip(triangle, other, near)
        for i in range(2, count):
            for k, corner in enumerate((0, i - 1, i)):
                w = polygon[corner, 2]
                for axis in range(2):
                    snapped = math.floor(polygon[corner, axis] / w * SUBPIXELS + 0.5)
                    corners[pieces, k, axis] = np.int64(snapped)
                values[pieces, k] = 1.0 / w if near > 0.0 else polygon[corner, 3]
            owners[pieces] = face
            pieces += 1
    return owners[:pieces], corners[:pieces], values[:pieces]


@jit
def _set_homogeneous(vertices, vertex, camera, out):
    """Set ``out`` (4,): (X, Y, W, d) with u = X / W, v = Y / W; W is z or 1, d is -z."""
    a, b = vertices[0, vertex], vertices[1, vertex]
    c, t = vertices[2, vertex], TRANSLATION
    x = camera[0] * a + camera[1] * b + camera[2] * c + camera[t]
    y = camera[3] * a + camera[4] * b + camera[5] * c + camera[t + 1]
    z = camera[6] * a + camera[7] * b + camera[8] * c + camera[t + 2]
    w = z if camera[NEAR] > 0.0 else 1.0
    out[0] = camera[FOCAL] * x + camera[PRINCIPAL] * w
    out[1] = camera[FOCAL + 1] * y + camera[PRINCIPAL + 1] * w
    out[2], out[3] = w, -z


@jit
def _set_plane(face, polygon, corners, planes):
    """Set a face's plane equations from homogeneous corners, which hold behind the camera too."""
    # Olano and Greer, Triangle scan conversion using 2D homogeneous coordinates, 1997.
    weights, largest = np.empty((3, 3)), 1e-300
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        xj, xk = polygon[j, 0], polygon[k, 0]
        yj, yk = polygon[j, 1], polygon[k, 1]
        wj, wk = polygon[j, 2], polygon[k, 2]
        # Negative where the front is seen: so this is the side that is seen.
        weights[0, i] = xk * yj - xj * yk
        weights[1, i], weights[2, i] = wj * yk - wk * yj, wk * xj - wj * xk
        for step in range(3):
            largest = max(largest, abs(weights[step, i]))
    size = corners.shape[1] // 3
    for step in range(3):
        for axis in range(size):
            total = 0.0
            for i in range(3):
                total += weights[step, i] / largest * corners[face, size * i + axis]
            planes[face, 4 * step + axis] = total


@jit
def _pixel_area(polygon):
    """Return twice a triangle's area in the picture, px; infinite if it is partly behind."""
    if min(polygon[0, 2], polygon[1, 2], polygon[2, 2]) <= 0.0:
        return np.inf
    x, y = polygon[0, 0] / polygon[0, 2], polygon[0, 1] / polygon[0, 2]
    ax, ay = polygon[1, 0] / polygon[1, 2] - x, polygon[1, 1] / polygon[1, 2] - y
    bx, by = polygon[2, 0] / polygon[2, 2] - x, polygon[2, 1] / polygon[2, 2] - y
    return abs(ax * by - bx * ay)


@jit
def _clip(polygon, other, near):
    """Clip a triangle at near plane and guard band (Sutherland and Hodgman)."""
    count, first = 3, 0 if near > 0.0 else 1
    for plane in range(first, 5):
        a = b = d = 0.0
        c = GUARD_PX  # inside: a X + b Y + c W + d >= 0
        if plane == 0:
            c, d = 1.0, -near
        elif plane < 3:
            a = 1.0 if plane == 1 else -1.0
        else:
            b = 1.0 if plane == 3 else -1.0
        kept = 0
        for i in range(count):
            j = (i + 1) % count
            here = a * polygon[i, 0] + b * polygon[i, 1] + c * polygon[i, 2] + d
            there = a * polygon[j, 0] + b * polygon[j, 1] + c * polygon[j, 2] + d
            # Entry by entry: a row's size is compared first, which takes long to compile.
            if here >= 0.0:
                for k in range(4):
                    other[kept, k] = polygon[i, k]
                kept += 1
            if (here >= 0.0) != (there >= 0.0):
                t = here / (here - there)
                for k in range(4):
                    other[kept, k] = polygon[i, k] + t * (polygon[j, k] - polygon[i, k])
                kept += 1
        polygon, other = other, polygon
        count = kept
    return polygon, count


@jit
def _draw_piece(corners, values, face, width, depth, ids):
    """Draw one triangle of any size, row by row in spans."""
    x0, y0 = corners[0, 0], corners[0, 1]
    x1, y1 = corners[1, 0], corners[1, 1]
    x2, y2 = corners[2, 0], corners[2, 1]
    d0, d1 = values[0], values[1]
    d2 = values[2]
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return
    sign = 1 if area > 0 else -1
    area *= sign
    first_column = max((min(x0, x1, x2) + 127) >> 8, 0)
    last_column = min((max(x0, x1, x2) - 128) >> 8, width - 1)
    first_row = max((min(y0, y1, y2) + 127) >> 8, 0)
    last_row = min((max(y0, y1, y2) - 128) >> 8, depth.shape[0] - 1)
    if first_column > last_column or first_row > last_row:
        return
    px, py = first_column * SUBPIXELS + SUBPIXELS // 2, first_row * SUBPIXELS + SUBPIXELS // 2
    e0, b0, right0, down0 = _wide_edge_at(x1, y1, x2, y2, px, py, sign)
    e1, b1, right1, down1 = _wide_edge_at(x2, y2, x0, y0, px, py, sign)
    e2, b2, right2, down2 = _wide_edge_at(x0, y0, x1, y1, px, py, sign)
    s1, s2 = (np.float64(d1) - d0) / area, (np.float64(d2) - d0) / area
    slope = right1 * s1 + right2 * s2
    for row in range(first_row, last_row + 1):
        first, last = _span(0, last_column - first_column, e0 - b0, right0)
        first, last = _span(first, last, e1 - b1, right1)
        first, last = _span(first, last, e2 - b2, right2)
        if first <= last:
            value = d0 + (e1 + first * right1) * s1 + (e2 + first * right2) * s2
            begin, end = first_column + first, first_column + last + 1
            _draw_span(depth[row, begin:end], ids[row, begin:end], value, slope, face)
        e0, e1 = e0 + down0, e1 + down1
        e2 = e2 + down2


@jit
def _wide_edge_at(xa, ya, xb, yb, px, py, sign):
    """Compute ``_edge_at`` in 64 bits."""
    ex, ey = sign * (xb - xa), sign * (yb - ya)
    excluded = 0 if (ey < 0) | ((ey == 0) & (ex > 0)) else 1
    return ex * (py - ya) - ey * (px - xa), excluded, -ey * SUBPIXELS, ex * SUBPIXELS


@jit
def _span(first, last, e, right):
    """Return the part of columns ``first`` to ``last`` where ``e`` + k ``right`` is >= 0."""
    if right > 0:
        return max(first, (right - 1 - e) // right) if e < 0 else first, last
    if e < 0:
        return first, first - 1
    return first, min(last, e // -right) if right < 0 else last


@jit
def _draw_span(depths, faces, d, slope, face):
    """Draw ``face`` along a row's pixels, where it is not behind what is there."""
    for k in range(depths.shape[0]):
        value, before = np.float32(d + np.int32(k) * slope), depths[k]
        face_before = faces[k]
        wins = (value > before) | ((value == before) & (face < face_before))
        depths[k] = value if wins else before
        faces[k] = face if wins else face_before
