"""The rasteriser's first half: which face each pixel shows. Arrays in, arrays out, without the GIL.

Vertices are snapped to 1/256 px and edges tested in integers with the top-left rule, so that a
pixel centre on a shared edge belongs to exactly one face. Where two faces are equally near, the
one that comes first in the list is seen: pictures do not depend on the order of drawing.

With each face that is seen goes its *plane*, a row of ``planes`` (F + 1, 16) float32: the normal
at a pixel, of any length, is linear in the picture. Entries 0 to 2 are the normal at the pixel
(column, row) of entries 12 and 13, 4 to 6 and 8 to 10 what a column and a row more add; 3, 7 and
11 are of no account. Under
perspective a corner weighs its edge function over its depth; both are of the snapped triangle, so
that inside it no weight is negative.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseviewer.render.software.kernel_blocks import (
    ACROSS,
    ALONG,
    BLOCK,
    CHUNK,
    COLUMN_OF,
    DOWN,
    EDGE,
    PLAIN,
    RIGHT,
    ROW_OF,
    SCALE,
    STEPS,
    VALUE,
    VALUES,
    WEIGHTS,
    draw_blocks,
    set_paint,
    set_plane,
)
from poseviewer.render.software.kernel_compiler import kernel
from poseviewer.render.software.kernel_visibility import OFF_SCREEN, SUBPIXELS

SMALL = 64 * SUBPIXELS  # in triangles of this size edge functions fit into 32 bits

_ONE, _ZERO = np.float32(1.0), np.float32(0.0)
COLUMN, WAY, LISTED = 4, 5, 6  # rows of a chunk's boxes; 0 to 3: left, top, right, bottom
DRAWN, LARGE = np.int32(1), np.int32(2)  # ways to draw a face; 0: not at all
_i32 = np.int32  # sums of 32 bits would have 64, and vectors half the lanes
_SUB, _HALF, _HALF_LESS, _BITS = _i32(SUBPIXELS), _i32(SUBPIXELS // 2), _i32(127), _i32(8)

_jit: Any = kernel()
# For what is done for every face: a call costs more than it does.
_jit_inline: Any = kernel(forceinline=True)


@_jit
def texture_level(texels, pixels, count):
    """Mip level of a face: half the log2 of texels per pixel, rounded, from the two areas."""
    if texels <= pixels:
        return 0
    if pixels <= 0.0:
        return count - 1
    return min(int(0.5 * math.log2(texels / pixels) + 0.5), count - 1)


@_jit
def _gather(begin, end, listed, faces, screen, depths, corners, values):
    """Corners (6, CHUNK) and depth values (6, CHUNK), of the faces listed from ``begin`` on."""
    for i in range(end - begin):
        f = np.uint32(listed[begin + i])
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        corners[0, i], corners[1, i], corners[2, i] = screen[0, a], screen[0, b], screen[0, c]
        corners[3, i], corners[4, i], corners[5, i] = screen[1, a], screen[1, b], screen[1, c]
        values[0, i], values[1, i], values[2, i] = depths[a], depths[b], depths[c]


@_jit_inline
def _edge_at(xa, ya, xb, yb, px, py, sign):
    """The edge function from one corner to the next, what the top-left rule takes from it, and
    what a column and a row more add.
    """
    ex, ey = _i32(sign * _i32(xb - xa)), _i32(sign * _i32(yb - ya))
    excluded = _i32(0) if (ey < 0) | ((ey == 0) & (ex > 0)) else _i32(1)
    e = _i32(_i32(ex * _i32(py - ya)) - _i32(ey * _i32(px - xa)))
    return e, excluded, _i32(-ey * _SUB), _i32(ex * _SUB)


@_jit
def _find_boxes(size, width, height, corners, boxes):
    """The pixels whose centres the faces' boxes hold: left, top, right, bottom, ends included."""
    x0, x1, x2 = corners[0, :size], corners[1, :size], corners[2, :size]
    y0, y1, y2 = corners[3, :size], corners[4, :size], corners[5, :size]
    left, top, right, bottom = boxes[0, :size], boxes[1, :size], boxes[2, :size], boxes[3, :size]
    columns, rows = _i32(width - 1), _i32(height - 1)
    for i in range(size):
        left[i] = max(_i32(_i32(min(x0[i], x1[i], x2[i]) + _HALF_LESS) >> _BITS), _i32(0))
        right[i] = min(_i32(_i32(max(x0[i], x1[i], x2[i]) - _HALF) >> _BITS), columns)
    for i in range(size):
        top[i] = max(_i32(_i32(min(y0[i], y1[i], y2[i]) + _HALF_LESS) >> _BITS), _i32(0))
        bottom[i] = min(_i32(_i32(max(y0[i], y1[i], y2[i]) - _HALF) >> _BITS), rows)


@_jit
def _set_up(size, two_sided, corners, boxes, values):
    """How each face is drawn (row WAY of ``boxes``), from which column on (row COLUMN), and on the
    first row of its box from there on its depth ``values``.

    A face whose box is two pixels wide and high at most is drawn only if it holds the centre of one
    of the four: most faces of a detailed model lie between the centres. Here and in what follows
    all is done without a branch and in 32 bits, so that it is done in vectors; of large faces only
    that they are large is told.
    """
    x0, x1, x2 = corners[0, :size], corners[1, :size], corners[2, :size]
    y0, y1, y2 = corners[3, :size], corners[4, :size], corners[5, :size]
    left, top, right, bottom = boxes[0, :size], boxes[1, :size], boxes[2, :size], boxes[3, :size]
    z0, z1, z2 = values[0, :size], values[1, :size], values[2, :size]
    column, way = boxes[COLUMN, :size], boxes[WAY, :size]
    value, across, along = values[VALUE, :size], values[ACROSS, :size], values[ALONG, :size]
    turned = values[SCALE, :size]
    none, both = _i32(0), _i32(1 if two_sided else 0)
    for i in range(size):
        area = _i32(
            _i32(_i32(x1[i] - x0[i]) * _i32(y2[i] - y0[i]))
            - _i32(_i32(x2[i] - x0[i]) * _i32(y1[i] - y0[i]))
        )
        sign = _i32(1) if area > none else _i32(-1)  # y runs down: a front has an area < 0
        px, py = _i32(_i32(left[i] * _SUB) + _HALF), _i32(_i32(top[i] * _SUB) + _HALF)
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
        turned[i] = np.float32(-sign) * scale  # normals shall point to the side that is seen
        f0, f1, f2 = _i32(e0 - b0), _i32(e1 - b1), _i32(e2 - b2)
        outside = _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        f0, f1, f2 = _i32(f0 + d0), _i32(f1 + d1), _i32(f2 + d2)
        outside &= _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        wide, tall = _i32(right[i] - left[i]), _i32(bottom[i] - top[i])
        drawn = (_i32(outside) >= none) | (max(wide, tall) > _i32(1))
        drawn &= (min(wide, tall) >= none) & (area != none)
        drawn &= _i32(both - _i32(area >> _i32(31))) > none
        least, most = min(x0[i], x1[i], x2[i]), max(x0[i], x1[i], x2[i])
        lowest, highest = min(y0[i], y1[i], y2[i]), max(y0[i], y1[i], y2[i])
        large = max(_i32(most - least), _i32(highest - lowest)) > _i32(SMALL)
        large |= min(least, lowest) == OFF_SCREEN
        column[i] = begin
        way[i] = LARGE if large else (DRAWN if drawn else none)


@_jit
def _set_edge(size, k, weighs, corners, boxes, steps, values):
    """A face's edge function opposite corner ``k``: its rows of ``steps`` and, weighed, of
    ``values``.
    """
    one, two = (k + 1) % 3, (k + 2) % 3
    xa, ya = corners[one, :size], corners[3 + one, :size]
    xb, yb = corners[two, :size], corners[3 + two, :size]
    column, top = boxes[COLUMN, :size], boxes[1, :size]
    scale, depth = values[SCALE, :size], values[k, :size]
    edge, right, down = steps[EDGE + k, :size], steps[RIGHT + k, :size], steps[DOWN + k, :size]
    here, across = values[WEIGHTS + k, :size], values[WEIGHTS + 3 + k, :size]
    along, perspective = values[WEIGHTS + 6 + k, :size], weighs > _ZERO
    for i in range(size):
        px, py = _i32(_i32(column[i] * _SUB) + _HALF), _i32(_i32(top[i] * _SUB) + _HALF)
        sign = _i32(-1) if scale[i] > _ZERO else _i32(1)
        e, b, r, d = _edge_at(xa[i], ya[i], xb[i], yb[i], px, py, sign)
        edge[i], right[i], down[i] = _i32(e - b), r, d
        weight = scale[i] * (weighs * depth[i] if perspective else _ONE)
        here[i], across[i] = np.float32(e) * weight, np.float32(r) * weight
        along[i] = np.float32(d) * weight


@_jit
def _list_drawn(size, boxes):
    """List the places of the faces that are drawn in row LISTED of ``boxes``; how many they are."""
    way, listed = boxes[WAY], boxes[LISTED]
    count = np.uint32(0)
    for i in range(size):
        listed[count] = i
        count += np.uint32(1) if way[i] > 0 else np.uint32(0)
    return count


Room = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]


def make_room() -> Room:
    """What ``draw_listed`` needs to look at a chunk of faces: corners, boxes, steps and values."""
    return (
        np.empty((6, CHUNK), np.int32),
        np.empty((7, CHUNK), np.int32),
        np.empty((STEPS, CHUNK), np.int32),
        np.empty((VALUES, CHUNK), np.float32),
    )


@_jit
def draw_listed(
    count,
    listed,
    room,
    faces,
    normals,
    weighs,
    screen,
    depths,
    planes,
    painting,
    two_sided,
    width,
    depth,
    ids,
):
    """Draw the first ``count`` of the ``listed`` faces into ``depth`` float32 and ``ids`` int32.

    Both are (height, ``width`` rounded up to whole BLOCKs). Sets the planes of the faces that show,
    from the ``normals`` (F + 1, 9) at their corners. ``weighs`` times a corner's depth value is its
    weight; where it is negative all weigh 1. ``room`` is that of ``make_room``. ``painting`` is
    (kinds (F,), paint of corners (F + 1, 12), texel areas (F,), how many levels a texture has,
    paints (F + 1, PAINT), levels (F + 1,)): of faces that show the last two are set as well.
    Returns how many faces are left for ``kernel_pieces`` to cut: they are then listed first.
    """
    large, (corners, boxes, steps, values) = 0, room
    kinds, paint, texel_areas, count_of_levels, paints, levels = painting
    is_painted = paint.shape[0] > 1
    for begin in range(0, count, CHUNK):
        end = min(begin + CHUNK, count)
        _gather(begin, end, listed, faces, screen, depths, corners, values)
        _find_boxes(end - begin, width, depth.shape[0], corners, boxes)
        _set_up(end - begin, two_sided, corners, boxes, values)
        for k in range(3):
            _set_edge(end - begin, k, weighs, corners, boxes, steps, values)
        for k in range(_list_drawn(end - begin, boxes)):
            i = np.int64(boxes[LISTED, k])
            face = listed[begin + i]
            if boxes[WAY, i] == LARGE:
                listed[large] = face
                large += 1
                continue
            left, top = np.int64(boxes[COLUMN, i]), np.int64(boxes[1, i])
            right, bottom = np.int64(boxes[2, i]), np.int64(boxes[3, i])
            if draw_blocks(depth, ids, steps, values, i, left, right, top, bottom, face):
                set_plane(planes, normals, values, i, np.uint32(face))
                planes[np.uint32(face), COLUMN_OF] = np.float32(left)
                planes[np.uint32(face), ROW_OF] = np.float32(top)
                if is_painted and kinds[np.uint32(face)] != PLAIN:
                    set_paint(paints, paint, values, i, np.uint32(face))
                    pixels = _ONE / (abs(values[SCALE, i]) * _SUB * _SUB)
                    levels[np.uint32(face)] = texture_level(
                        texel_areas[np.uint32(face)], pixels, count_of_levels
                    )
    return large
