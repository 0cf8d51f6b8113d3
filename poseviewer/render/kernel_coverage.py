"""The rasteriser's first half: which face each pixel shows. Arrays in, arrays out, without the GIL.

Vertices are snapped to 1/256 px and edges tested in integers with the top-left rule, so that a
pixel centre on a shared edge belongs to exactly one face. Where two faces are equally near, the
one that comes first in the list is seen: pictures do not depend on the order of drawing.

With each face that is seen goes its *plane*, a row of ``planes`` (F + 1, 16) float32: the normal
at a pixel, of any length, is linear in the picture. Entries 0 to 2 are the normal at the pixel
(column, row) of entries 12 and 13, 4 to 6 and 8 to 10 what a column and a row more add. Under
perspective a corner weighs its edge function over its depth; both are of the snapped triangle, so
that inside it no weight is negative.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from poseviewer.render.kernel_compiler import kernel
from poseviewer.render.kernel_visibility import OFF_SCREEN, SUBPIXELS

CHUNK = 256  # faces that are looked at together
LOOKED_AT = 64  # in a box of so many pixels, each is compared before a face is drawn
BLOCK = 16  # pixels of a row that are done at a time
SMALL = 64 * SUBPIXELS  # in triangles of this size edge functions fit into 32 bits

_ONE, _ZERO = np.float32(1.0), np.float32(0.0)
DRAWN, LARGE = np.int32(1), np.int32(2)  # ways to draw a face; 0: not at all
_i32 = np.int32  # sums of 32 bits would have 64, and vectors half the lanes
_SUB, _HALF, _HALF_LESS, _BITS = _i32(SUBPIXELS), _i32(SUBPIXELS // 2), _i32(127), _i32(8)

_jit: Any = kernel()
_intrinsic: Any = intrinsic
# For what is done for every face: a call costs more than it does.
_jit_inline: Any = kernel(forceinline=True)


@_intrinsic
def _draw_block(typing, depth, ids, at, e0, e1, e2, r0, r1, r2, d, slope, low, high, face):  # noqa: ARG001
    """A row of a small triangle inside a block, from entry ``at`` of ``depth`` and ``ids`` on.

    All of the block's pixels are done at once, in vectors: the compiler does not find this out by
    itself. Edge functions are e_i, and r_i a column more, int32; depth values d, and ``slope`` a
    column more, kept from ``low`` to ``high``. Returns whether the face shows in any pixel.
    """
    whole, real = types.int32, types.float32
    signature = types.boolean(depth, ids, types.int64, *[whole] * 6, *[real] * 4, whole)
    return signature, _emit_block


def _emit_block(context, builder, signature, args):
    whole, real = (ir.VectorType(kind, BLOCK) for kind in (ir.IntType(32), ir.FloatType()))
    first = ir.Constant(whole, [0] * BLOCK)

    def all_alike(scalar, kind):
        one = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, ir.IntType(32)(0))
        return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), first)

    def place(position, kind):
        array = context.make_array(signature.args[position])(context, builder, args[position])
        return builder.bitcast(builder.gep(array.data, [args[2]]), kind.as_pointer())

    def choose(condition, one, other):
        return builder.select(condition, one, other)

    steps = ir.Constant(whole, list(range(BLOCK)))
    edges = [
        builder.add(
            all_alike(args[3 + i], whole), builder.mul(all_alike(args[6 + i], whole), steps)
        )
        for i in range(3)
    ]
    inside = builder.icmp_signed(">=", builder.or_(builder.or_(*edges[:2]), edges[2]), first)
    d, slope, low, high = (all_alike(arg, real) for arg in args[9:13])
    columns = ir.Constant(real, [float(step) for step in range(BLOCK)])
    value = builder.fadd(d, builder.fmul(slope, columns))
    value = choose(builder.fcmp_ordered("<", value, low), low, value)
    value = choose(builder.fcmp_ordered(">", value, high), high, value)
    depths, ids, face = place(0, real), place(1, whole), all_alike(args[13], whole)
    before, shown = builder.load(depths, align=4), builder.load(ids, align=4)
    same = builder.and_(
        builder.fcmp_ordered("==", value, before), builder.icmp_signed("<", face, shown)
    )
    nearer = builder.or_(builder.fcmp_ordered(">", value, before), same)
    wins = builder.and_(inside, nearer)
    builder.store(choose(wins, value, before), depths, align=4)
    builder.store(choose(wins, face, shown), ids, align=4)
    bits = builder.bitcast(wins, ir.IntType(BLOCK))
    return builder.icmp_unsigned("!=", bits, ir.IntType(BLOCK)(0))


@_jit_inline
def _set_plane(face, planes, corners, e, right, down, weights, column, row):
    """The plane of a face from edge functions at a pixel, ``weights`` of the corners, and
    ``corners`` (F, 9): the normals.
    """
    f = np.uint32(face)
    q0, q1, q2 = np.float32(weights[0]), np.float32(weights[1]), np.float32(weights[2])
    e0, e1, e2 = np.float32(e[0]) * q0, np.float32(e[1]) * q1, np.float32(e[2]) * q2
    r0, r1, r2 = np.float32(right[0]) * q0, np.float32(right[1]) * q1, np.float32(right[2]) * q2
    d0, d1, d2 = np.float32(down[0]) * q0, np.float32(down[1]) * q1, np.float32(down[2]) * q2
    ax, ay, az = corners[f, 0], corners[f, 1], corners[f, 2]
    bx, by, bz = corners[f, 3], corners[f, 4], corners[f, 5]
    cx, cy, cz = corners[f, 6], corners[f, 7], corners[f, 8]
    planes[f, 0] = e0 * ax + e1 * bx + e2 * cx
    planes[f, 1] = e0 * ay + e1 * by + e2 * cy
    planes[f, 2] = e0 * az + e1 * bz + e2 * cz
    planes[f, 4] = r0 * ax + r1 * bx + r2 * cx
    planes[f, 5] = r0 * ay + r1 * by + r2 * cy
    planes[f, 6] = r0 * az + r1 * bz + r2 * cz
    planes[f, 8] = d0 * ax + d1 * bx + d2 * cx
    planes[f, 9] = d0 * ay + d1 * by + d2 * cy
    planes[f, 10] = d0 * az + d1 * bz + d2 * cz
    planes[f, 12], planes[f, 13] = np.float32(column), np.float32(row)


@_jit_inline
def _weigh(sign, area, weighs, d0, d1, d2):
    """The weights of a triangle's corners; normals then point to the side that is seen."""
    q = np.float32(-sign) / np.float32(area)
    if weighs > _ZERO:
        return q * (weighs * d0), q * (weighs * d1), q * (weighs * d2)
    return q, q, q


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
    """How each face is drawn (row 4 of ``boxes``), and its depth value at the box's first pixel and
    what a column and a row more add (rows 3 to 5 of ``values``).

    A face whose box is two pixels wide and high at most is drawn only if it holds the centre of one
    of the four: most faces of a detailed model lie between the centres. All is done without a
    branch and in 32 bits, so that it is done in vectors; of large faces only that they are large
    is told.
    """
    x0, x1, x2 = corners[0, :size], corners[1, :size], corners[2, :size]
    y0, y1, y2 = corners[3, :size], corners[4, :size], corners[5, :size]
    left, top, right, bottom = boxes[0, :size], boxes[1, :size], boxes[2, :size], boxes[3, :size]
    z0, z1, z2 = values[0, :size], values[1, :size], values[2, :size]
    way, value, slope, fall = boxes[4, :size], values[3, :size], values[4, :size], values[5, :size]
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
        value[i] = z0[i] + np.float32(e1) * s1 + np.float32(e2) * s2
        slope[i] = np.float32(r1) * s1 + np.float32(r2) * s2
        fall[i] = np.float32(d1) * s1 + np.float32(d2) * s2
        f0, f1, f2 = _i32(e0 - b0), _i32(e1 - b1), _i32(e2 - b2)
        outside = _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        f0, f1, f2 = _i32(f0 + d0), _i32(f1 + d1), _i32(f2 + d2)
        outside &= _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        across, along = _i32(right[i] - left[i]), _i32(bottom[i] - top[i])
        drawn = (_i32(outside) >= none) | (max(across, along) > _i32(1))
        drawn &= (min(across, along) >= none) & (area != none)
        drawn &= _i32(both - _i32(area >> _i32(31))) > none
        least, most = min(x0[i], x1[i], x2[i]), max(x0[i], x1[i], x2[i])
        lowest, highest = min(y0[i], y1[i], y2[i]), max(y0[i], y1[i], y2[i])
        large = max(_i32(most - least), _i32(highest - lowest)) > _i32(SMALL)
        large |= min(least, lowest) == OFF_SCREEN
        way[i] = LARGE if large else (DRAWN if drawn else none)


@_jit
def _list_drawn(size, boxes):
    """List the places of the faces that are drawn in row 5 of ``boxes``; returns their number."""
    way, listed = boxes[4], boxes[5]
    count = np.uint32(0)
    for i in range(size):
        listed[count] = i
        count += np.uint32(1) if way[i] > 0 else np.uint32(0)
    return count


@_jit_inline
def _is_hidden(i, boxes, values, depth):
    """Whether all that is drawn in a face's box is nearer; False for a box of many pixels."""
    left, top, right, bottom = boxes[0, i], boxes[1, i], boxes[2, i], boxes[3, i]
    if (right - left + 1) * (bottom - top + 1) > LOOKED_AT:
        return False
    nearest = max(values[0, i], values[1, i], values[2, i])
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            if depth[np.uint32(row), np.uint32(column)] <= nearest:
                return False
    return True


@_jit_inline
def _draw_in_blocks(face, i, inside, right, down, boxes, values, depth, ids):
    """Draw a face of at most SMALL; whether it shows in any pixel. The edge functions ``inside``,
    the top-left rule applied, are those at the first pixel of its box's first block.
    """
    stride, first_row = depth.shape[1], boxes[1, i]
    low = min(values[0, i], values[1, i], values[2, i])
    high = max(values[0, i], values[1, i], values[2, i])
    slope, fall = values[4, i], values[5, i]
    # Whole blocks: a block that was just written can be read again without waiting for it.
    first_column = boxes[0, i] & -BLOCK
    d = values[3, i] - np.float32(boxes[0, i] - first_column) * slope
    r0, r1, r2 = right
    shown = False
    for block in range(first_column, boxes[2, i] + 1, BLOCK):
        skip = block - first_column
        f0, f1, f2 = inside[0] + skip * r0, inside[1] + skip * r1, inside[2] + skip * r2
        value = d + np.float32(skip) * slope
        at = first_row * stride + block
        for _ in range(first_row, boxes[3, i] + 1):
            shown |= _draw_block(
                depth,
                ids,
                at,
                np.int32(f0),
                np.int32(f1),
                np.int32(f2),
                r0,
                r1,
                r2,
                value,
                slope,
                low,
                high,
                face,
            )
            f0, f1, f2, at = f0 + down[0], f1 + down[1], f2 + down[2], at + stride
            value += fall
    return shown


@_jit_inline
def _draw_small(face, i, room, normals, weighs, planes, depth, ids):
    """Draw the face that is the ``i``-th in ``room``; set its plane if it shows."""
    corners, boxes, values = room
    x0, x1, x2 = corners[0, i], corners[1, i], corners[2, i]
    y0, y1, y2 = corners[3, i], corners[4, i], corners[5, i]
    area = _i32(_i32(x1 - x0) * _i32(y2 - y0)) - _i32(_i32(x2 - x0) * _i32(y1 - y0))
    sign = _i32(1) if area > 0 else _i32(-1)
    column, row = boxes[0, i] & -BLOCK, boxes[1, i]
    px, py = _i32(_i32(column * _SUB) + _HALF), _i32(_i32(row * _SUB) + _HALF)
    e0, b0, r0, d0 = _edge_at(x1, y1, x2, y2, px, py, sign)
    e1, b1, r1, d1 = _edge_at(x2, y2, x0, y0, px, py, sign)
    e2, b2, r2, d2 = _edge_at(x0, y0, x1, y1, px, py, sign)
    right, down = (r0, r1, r2), (d0, d1, d2)
    inside = (e0 - b0, e1 - b1, e2 - b2)
    if not _draw_in_blocks(face, i, inside, right, down, boxes, values, depth, ids):
        return
    weights = _weigh(sign, sign * area, weighs, values[0, i], values[1, i], values[2, i])
    _set_plane(face, planes, normals, (e0, e1, e2), right, down, weights, column, row)


def make_room() -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float32]]:
    """What ``draw_listed`` needs to look at a chunk of faces."""
    return (
        np.empty((6, CHUNK), np.int32),
        np.empty((6, CHUNK), np.int32),
        np.empty((6, CHUNK), np.float32),
    )


@_jit
def draw_listed(
    count,
    listed,
    culls,
    room,
    faces,
    normals,
    weighs,
    screen,
    depths,
    planes,
    two_sided,
    width,
    depth,
    ids,
):
    """Draw the first ``count`` of the ``listed`` faces into ``depth`` float32 and ``ids`` int32.

    Both are (height, ``width`` rounded up to whole BLOCKs). Sets the planes of the faces that show,
    from the ``normals`` (F, 9) at their corners. ``weighs`` times a corner's depth value is its
    weight; where it is negative all weigh 1. ``culls``: whether most of them are expected to be
    hidden by what is drawn already. ``room`` is that of ``make_room``.
    Returns how many faces are left for ``kernel_pieces`` to cut: they are then listed first.
    """
    large, (corners, boxes, values) = 0, room
    for begin in range(0, count, CHUNK):
        end = min(begin + CHUNK, count)
        _gather(begin, end, listed, faces, screen, depths, corners, values)
        _find_boxes(end - begin, width, depth.shape[0], corners, boxes)
        _set_up(end - begin, two_sided, corners, boxes, values)
        for k in range(_list_drawn(end - begin, boxes)):
            i = np.uint32(boxes[5, k])
            face = listed[begin + i]
            if boxes[4, i] == LARGE:
                listed[large] = face
                large += 1
            elif not (culls and _is_hidden(i, boxes, values, depth)):
                _draw_small(face, i, room, normals, weighs, planes, depth, ids)
    return large
