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

from poseviewer.render.kernel_compiler import kernel

SUBPIXELS = 256
BLOCK = 16  # pixels of a row that are done at a time
SMALL = 64 * SUBPIXELS  # in triangles of this size edge functions fit into 32 bits

_ONE, _ZERO = np.float32(1.0), np.float32(0.0)

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


@_jit
def _span(start, first, last, e, right):
    """The part of columns ``first`` to ``last`` where an edge may be inside, a pixel to spare.

    The edge function is ``e`` at column ``start``, and grows by ``right`` a column.
    """
    if right > 0:
        first = max(first, start - 1 + int(-e / right)) if e < 0 else first
    elif e < 0:
        last = start - 1
    elif right < 0:
        last = min(last, start + 1 + int(e / -right))
    return first, last


@_jit
def _draw_wide_row(row, first, last, edges, rights, d, slope, face, depth, ids):
    """A row of a triangle of any size, columns ``first`` to ``last``."""
    f0, f1, f2 = edges
    for column in range(first, last + 1):
        value = np.float32(d)
        d += slope
        if f0 | f1 | f2 >= 0:
            before = depth[row, column]
            if value > before or (value == before and face < ids[row, column]):
                depth[row, column] = value
                ids[row, column] = face
        f0, f1, f2 = f0 + rights[0], f1 + rights[1], f2 + rights[2]


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
def _edges(x0, y0, x1, y1, x2, y2, first_column, first_row, sign):
    """Edge functions at a pixel centre, and what a column and a row more add to each.

    In 1/256 px squared; edge i lies opposite corner i. Inside, all three are positive.
    """
    px, py = first_column * SUBPIXELS + SUBPIXELS // 2, first_row * SUBPIXELS + SUBPIXELS // 2
    ex0, ey0 = sign * (x2 - x1), sign * (y2 - y1)
    ex1, ey1 = sign * (x0 - x2), sign * (y0 - y2)
    ex2, ey2 = sign * (x1 - x0), sign * (y1 - y0)
    e0 = ex0 * (py - y1) - ey0 * (px - x1)
    e1 = ex1 * (py - y2) - ey1 * (px - x2)
    e2 = ex2 * (py - y0) - ey2 * (px - x0)
    right = (-ey0 * SUBPIXELS, -ey1 * SUBPIXELS, -ey2 * SUBPIXELS)
    down = (ex0 * SUBPIXELS, ex1 * SUBPIXELS, ex2 * SUBPIXELS)
    # Points on a top or left edge are inside, on the others outside.
    b0 = ~(((ey0 << 32) - ex0) >> 63)
    b1 = ~(((ey1 << 32) - ex1) >> 63)
    b2 = ~(((ey2 << 32) - ex2) >> 63)
    return (e0, e1, e2), right, down, (b0, b1, b2)


@_jit_inline
def _weigh(sign, area, weighs, d0, d1, d2):
    """The weights of a triangle's corners; normals then point to the side that is seen."""
    q = np.float32(-sign) / np.float32(area)
    if weighs > _ZERO:
        return q * (weighs * d0), q * (weighs * d1), q * (weighs * d2)
    return q, q, q


@_jit
def _draw_piece(x0, y0, d0, x1, y1, d1, x2, y2, d2, face, two_sided, width, depth, ids):
    """One triangle of any size, in 1/256 px, with depth values d, linear in the picture."""
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0 or (area > 0 and not two_sided):
        return
    sign = 1 if area > 0 else -1
    area *= sign
    first_column = max((min(x0, x1, x2) + 127) >> 8, 0)
    last_column = min((max(x0, x1, x2) - 128) >> 8, width - 1)
    first_row = max((min(y0, y1, y2) + 127) >> 8, 0)
    last_row = min((max(y0, y1, y2) - 128) >> 8, depth.shape[0] - 1)
    if first_column > last_column or first_row > last_row:
        return
    (e0, e1, e2), right, down, (b0, b1, b2) = _edges(
        x0, y0, x1, y1, x2, y2, first_column, first_row, sign
    )
    s1, s2 = (np.float64(d1) - d0) / area, (np.float64(d2) - d0) / area
    slope = right[1] * s1 + right[2] * s2
    for row in range(first_row, last_row + 1):
        first, last = _span(first_column, first_column, last_column, e0, right[0])
        first, last = _span(first_column, first, last, e1, right[1])
        first, last = _span(first_column, first, last, e2, right[2])
        skip = first - first_column
        f1, f2 = e1 + skip * right[1], e2 + skip * right[2]
        edges = (e0 + b0 + skip * right[0], f1 + b1, f2 + b2)
        value = d0 + f1 * s1 + f2 * s2
        _draw_wide_row(row, first, last, edges, right, value, slope, face, depth, ids)
        e0, e1, e2 = e0 + down[0], e1 + down[1], e2 + down[2]


@_jit
def draw_pieces(owners, places, values, two_sided, width, depth, ids):
    """Draw triangles of any size, as ``kernel_pieces.cut`` gives them."""
    for i in range(owners.shape[0]):
        x0, y0, x1, y1 = places[i, 0, 0], places[i, 0, 1], places[i, 1, 0], places[i, 1, 1]
        x2, y2, d0, d1, d2 = (
            places[i, 2, 0],
            places[i, 2, 1],
            values[i, 0],
            values[i, 1],
            values[i, 2],
        )
        _draw_piece(x0, y0, d0, x1, y1, d1, x2, y2, d2, owners[i], two_sided, width, depth, ids)


@_jit
def draw_listed(
    count,
    listed,
    faces,
    corners,
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

    Both are (height, ``width`` rounded up to whole BLOCKs). Sets the planes of the faces that show.
    ``weighs`` times a corner's depth value is its weight; where it is negative all weigh 1.
    Returns how many faces are left for ``kernel_pieces`` to cut: they are then listed first.
    """
    large, height, stride = 0, depth.shape[0], depth.shape[1]
    for index in range(count):
        face = listed[index]
        f = np.uint32(face)
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        x0, x1, x2 = np.int64(screen[0, a]), np.int64(screen[0, b]), np.int64(screen[0, c])
        y0, y1, y2 = np.int64(screen[1, a]), np.int64(screen[1, b]), np.int64(screen[1, c])
        least_x, most_x = min(x0, x1, x2), max(x0, x1, x2)
        least_y, most_y = min(y0, y1, y2), max(y0, y1, y2)
        if max(most_x - least_x, most_y - least_y) > SMALL:  # also where a vertex is off screen
            listed[large] = face
            large += 1
            continue
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0 or (area > 0 and not two_sided):  # y runs down: a front has an area < 0
            continue
        sign = 1 if area > 0 else -1
        area *= sign
        # Whole blocks: a block that was just written can be read again without waiting for it.
        first_column = max((least_x + 127) >> 8, 0) & -BLOCK
        last_column = min((most_x - 128) >> 8, width - 1)
        first_row = max((least_y + 127) >> 8, 0)
        last_row = min((most_y - 128) >> 8, height - 1)
        if first_column > last_column or first_row > last_row:
            continue
        d0, d1, d2 = depths[a], depths[b], depths[c]
        (e0, e1, e2), right, down, (b0, b1, b2) = _edges(
            x0, y0, x1, y1, x2, y2, first_column, first_row, sign
        )
        scale = _ONE / np.float32(area)
        s1, s2 = (d1 - d0) * scale, (d2 - d0) * scale
        slope = np.float32(right[1]) * s1 + np.float32(right[2]) * s2
        fall = np.float32(down[1]) * s1 + np.float32(down[2]) * s2
        d = d0 + np.float32(e1) * s1 + np.float32(e2) * s2
        low, high = min(d0, d1, d2), max(d0, d1, d2)
        r0, r1, r2 = np.int32(right[0]), np.int32(right[1]), np.int32(right[2])
        is_seen = False
        for block in range(first_column, last_column + 1, BLOCK):
            skip = block - first_column
            f0, f1, f2 = e0 + b0 + skip * r0, e1 + b1 + skip * r1, e2 + b2 + skip * r2
            value = d + np.float32(skip) * slope
            at = first_row * stride + block
            for _ in range(first_row, last_row + 1):
                is_seen |= _draw_block(
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
        if is_seen:
            weights = _weigh(sign, area, weighs, d0, d1, d2)
            _set_plane(
                face, planes, corners, (e0, e1, e2), right, down, weights, first_column, first_row
            )
    return large
