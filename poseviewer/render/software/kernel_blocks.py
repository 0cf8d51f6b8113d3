"""The rasteriser's innermost steps in vectors, which the compiler does not find out by itself.

They are functions for other kernels, given as instructions (LLVM IR): a BLOCK of a row's pixels, or
the three axes of a normal, are done at once. What they need of a face stands in ``steps`` (STEPS,
CHUNK) int32 and ``values`` (VALUES, CHUNK) float32, a column for each face of a chunk.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

CHUNK = 512  # faces that are looked at together
BLOCK = 16  # pixels of a row that are done at a time
AXES = 4  # lanes of a normal; the last is of no account

EDGE, RIGHT, DOWN, STEPS = 0, 3, 6, 9
"""Rows of ``steps``: the three edge functions at a face's first pixel, the top-left rule applied,
what a column more adds to each, and what a row more adds."""

VALUE, ACROSS, ALONG, SCALE, WEIGHTS, VALUES = 3, 4, 5, 6, 7, 16
"""Rows of ``values``: 0 to 2 are the corners' depth values; that of the first pixel, and what a
column and a row more add; one over the area, positive for a front; and nine as those of ``steps``,
the rule not applied, times the corners' weights."""

PLAIN, GRADED, MAPPED, BOTH = 0, 1, 2, 3
"""Where a face has its reflectance from: one colour, colours at its corners, a texture and one
colour, a texture and colours at its corners. Negative they stand where there is no colour yet."""

NO_WEIGHT = 1e-20
"""A paint's fourth number that is no greater is that of no face, or of one seen edge-on."""

COLUMN_OF, ROW_OF, GREY, PLANE, PAINT = 12, 13, 15, 16, 12
"""The entries of a face's plane that are the pixel which its first three are of, and its grey
value; how many entries there are, and how many of its paint: the like of entries 0 to 11, of R, G,
B or u, v, 0, and of a fourth number. These are divided by that."""

_whole, _real, _size = ir.IntType(32), ir.FloatType(), ir.IntType(64)
_wholes, _reals = ir.VectorType(_whole, BLOCK), ir.VectorType(_real, BLOCK)
_axes = ir.VectorType(_real, AXES)
_intrinsic: Any = intrinsic


@_intrinsic
def draw_blocks(typing, depth, ids, steps, values, i, left, right, top, bottom, face):  # noqa: ARG001
    """Draw the ``i``-th face of a chunk into ``depth`` and ``ids``; whether it shows anywhere.

    Done is all of the blocks from the one that begins at column ``left`` to that with column
    ``right``, ends included. The face's first pixel is (``left``, ``top``).
    """
    signature = types.boolean(depth, ids, steps, values, *[types.int64] * 5, types.int32)
    return signature, _emit_draw


@_intrinsic
def set_plane(typing, planes, normals, values, i, face):  # noqa: ARG001
    """Set entries 0 to 11 of the plane of ``face``, the ``i``-th of a chunk, from the ``normals``
    (F + 1, 9) of its corners. Entries 3, 7 and 11 become whatever they become.
    """
    return types.void(planes, normals, values, types.int64, types.uint32), _emit_plane


@_intrinsic
def set_paint(typing, paints, corners, values, i, face):  # noqa: ARG001
    """Set the paint of ``face``, the ``i``-th of a chunk, from that of its corners (F + 1, 12)."""
    return types.void(paints, corners, values, types.int64, types.uint32), _emit_paint


@_intrinsic
def normals_of_four(typing, faces, k, column, row, planes, x, y, z, grey):  # noqa: ARG001
    """Normals and grey values of four pixels, that of ``faces[k]`` at (``column``, ``row``) and the
    next three in the row, from their faces' planes; -1 is the last plane's.

    Set are ``x``, ``y``, ``z`` and ``grey`` from ``k`` on.
    """
    signature = types.void(faces, *[types.int64] * 3, planes, x, y, z, grey)
    return signature, _emit_normals


@_intrinsic
def paints_of_four(typing, faces, k, column, row, planes, paints, x, y, z):  # noqa: ARG001
    """The same of their paints, divided: R, G, B or u, v, 0."""
    signature = types.void(faces, *[types.int64] * 3, planes, paints, x, y, z)
    return signature, _emit_paints


def _emit_draw(context, builder, signature, args):
    depth, ids, steps, values = (_array(context, builder, signature, args, k) for k in range(4))
    i, left, right, top, bottom, face = args[4:]

    def step(row):
        return _alike(builder, _entry(builder, steps, row, i), BLOCK)

    def keep(number):
        return cgutils.alloca_once_value(builder, number)

    rights, downs = [step(RIGHT + k) for k in range(3)], [step(DOWN + k) for k in range(3)]
    lanes, block = (ir.Constant(_wholes, row) for row in (list(range(BLOCK)), [BLOCK] * BLOCK))
    edges = [builder.add(step(EDGE + k), builder.mul(rights[k], lanes)) for k in range(3)]
    value, slope, fall = (_entry(builder, values, row, i) for row in (VALUE, ACROSS, ALONG))
    low, high = _least_and_greatest(builder, [_entry(builder, values, k, i) for k in range(3)])
    columns = ir.Constant(_reals, [float(lane) for lane in range(BLOCK)])
    slopes = builder.fmul(_alike(builder, slope, BLOCK), columns)
    of_face = slopes, _alike(builder, low, BLOCK), _alike(builder, high, BLOCK)
    of_face = *of_face, _alike(builder, face, BLOCK)

    stride = builder.extract_value(depth.shape, 1)
    first = builder.add(builder.mul(top, stride), left)
    rows = builder.add(builder.sub(bottom, top), _size(1))
    end = builder.add(builder.sub(right, left), _size(1))
    at_block, at_row = [keep(edge) for edge in edges], [keep(edge) for edge in edges]
    row_value, shown = keep(value), keep(ir.IntType(BLOCK)(0))
    with cgutils.for_range_slice(builder, _size(0), end, _size(BLOCK)) as (skip, _):
        for here, begin in zip(at_row, at_block, strict=True):
            builder.store(builder.load(begin), here)
        shift = builder.fmul(builder.sitofp(skip, _real), slope)
        builder.store(builder.fadd(value, shift), row_value)
        with cgutils.for_range(builder, rows) as row:
            at = builder.add(builder.add(first, skip), builder.mul(row.index, stride))
            here, d = [builder.load(edge) for edge in at_row], builder.load(row_value)
            bits = _draw_row(builder, (depth.data, ids.data), at, here, d, of_face)
            builder.store(builder.or_(builder.load(shown), bits), shown)
            for kept, edge, more in zip(at_row, here, downs, strict=True):
                builder.store(builder.add(edge, more), kept)
            builder.store(builder.fadd(d, fall), row_value)
        for kept, more in zip(at_block, rights, strict=True):
            builder.store(builder.add(builder.load(kept), builder.mul(more, block)), kept)
    return builder.icmp_unsigned("!=", builder.load(shown), ir.IntType(BLOCK)(0))


def _draw_row(builder, picture, at, edges, value, of_face):
    """One row of a block, from entry ``at`` of the ``picture`` on; a bit for each pixel that shows
    the face.
    """
    slopes, low, high, faces = of_face
    depth_at, id_at = (
        builder.bitcast(builder.gep(data, [at]), kind.as_pointer())
        for data, kind in zip(picture, (_reals, _wholes), strict=True)
    )
    signs = builder.or_(builder.or_(edges[0], edges[1]), edges[2])
    inside = builder.icmp_signed(">=", signs, ir.Constant(_wholes, [0] * BLOCK))
    d = builder.fadd(_alike(builder, value, BLOCK), slopes)
    d = builder.select(builder.fcmp_ordered("<", d, low), low, d)
    d = builder.select(builder.fcmp_ordered(">", d, high), high, d)
    before, face_before = (builder.load(place, align=4) for place in (depth_at, id_at))
    same = builder.and_(
        builder.fcmp_ordered("==", d, before), builder.icmp_signed("<", faces, face_before)
    )
    wins = builder.and_(inside, builder.or_(builder.fcmp_ordered(">", d, before), same))
    # Without it the compiler stores some lanes alone, and the next face waits for them.
    builder.fence("acq_rel", targetscope="singlethread")
    builder.store(builder.select(wins, d, before), depth_at, align=4)
    builder.store(builder.select(wins, faces, face_before), id_at, align=4)
    return builder.bitcast(wins, ir.IntType(BLOCK))


def _emit_plane(context, builder, signature, args):
    # The fourth number read of a corner is the next one's first: the plane's is of no account.
    return _combine(context, builder, signature, args, 9, 3, PLANE)


def _emit_paint(context, builder, signature, args):
    return _combine(context, builder, signature, args, 12, AXES, PAINT)


def _combine(context, builder, signature, args, width, step, out_width):
    """Weigh what a row of ``width`` has of each of three corners, each ``step`` after the last."""
    out, of_corners, values = (_array(context, builder, signature, args, k) for k in range(3))
    i, face = args[3], builder.zext(args[4], _size)
    corners = [
        builder.load(_axes_at(builder, of_corners, face, width, step * k), align=4)
        for k in range(3)
    ]
    for group in range(3):
        total = None
        for k, corner in enumerate(corners):
            weight = _entry(builder, values, WEIGHTS + 3 * group + k, i)
            part = builder.fmul(_alike(builder, weight, AXES), corner)
            total = part if total is None else builder.fadd(total, part)
        place = _axes_at(builder, out, face, out_width, AXES * group)
        builder.store(total, place, align=4)
    return context.get_dummy_value()


def _emit_normals(context, builder, signature, args):
    faces, planes = (_array(context, builder, signature, args, k) for k in (0, 4))
    out = [_array(context, builder, signature, args, k) for k in range(5, 9)]
    pixels = []
    for face, du, dv in _four_pixels(builder, faces, planes, *args[1:4]):
        normal = _linear(builder, planes, face, PLANE, du, dv)
        rest = builder.load(_axes_at(builder, planes, face, PLANE, COLUMN_OF), align=4)
        pixels.append(_shuffled(builder, normal, rest, [0, 1, 2, 7]))
    _store_turned(builder, pixels, out, args[1])
    return context.get_dummy_value()


def _emit_paints(context, builder, signature, args):
    faces, planes, paints = (_array(context, builder, signature, args, k) for k in (0, 4, 5))
    out = [_array(context, builder, signature, args, k) for k in range(6, 9)]
    pixels = []
    for face, du, dv in _four_pixels(builder, faces, planes, *args[1:4]):
        paint = _linear(builder, paints, face, PAINT, du, dv)
        weight = builder.extract_element(paint, _whole(3))
        is_some = builder.or_(
            builder.fcmp_ordered(">", weight, _real(NO_WEIGHT)),
            builder.fcmp_ordered("<", weight, _real(-NO_WEIGHT)),
        )
        weight = builder.select(is_some, weight, _real(1.0))
        pixels.append(builder.fdiv(paint, _alike(builder, weight, AXES)))
    _store_turned(builder, pixels, out, args[1])
    return context.get_dummy_value()


def _four_pixels(builder, faces, planes, k, column, row):
    """The faces of four pixels, and how far each is from the pixel of its face's plane."""
    none = builder.sub(builder.extract_value(planes.shape, 0), _size(1))
    down = builder.sitofp(row, _real)
    for q in range(AXES):
        face = builder.load(builder.gep(faces.data, [builder.add(k, _size(q))]))
        face = builder.sext(face, _size)
        face = builder.select(builder.icmp_signed("<", face, _size(0)), none, face)
        place = builder.load(_axes_at(builder, planes, face, PLANE, COLUMN_OF), align=4)
        here = builder.sitofp(builder.add(column, _size(q)), _real)
        du, dv = (
            _alike(builder, builder.fsub(one, builder.extract_element(place, _whole(lane))), AXES)
            for lane, one in enumerate((here, down))
        )
        yield face, du, dv


def _linear(builder, array, face, width, du, dv):
    here, across, along = (
        builder.load(_axes_at(builder, array, face, width, AXES * group), align=4)
        for group in range(3)
    )
    return builder.fadd(builder.fadd(here, builder.fmul(du, across)), builder.fmul(dv, along))


def _store_turned(builder, pixels, out, k):
    """Write the first lanes of four pixels to the first array of ``out``, and so on."""
    pairs = [(pixels[0], pixels[1]), (pixels[2], pixels[3])]
    low = [_shuffled(builder, one, other, [0, 4, 1, 5]) for one, other in pairs]
    high = [_shuffled(builder, one, other, [2, 6, 3, 7]) for one, other in pairs]
    for axis, array in enumerate(out):
        (one, other), begin = (low, high)[axis // 2], 2 * (axis % 2)
        lane = _shuffled(builder, one, other, [begin, begin + 1, begin + 4, begin + 5])
        to = builder.bitcast(builder.gep(array.data, [k]), _axes.as_pointer())
        builder.store(lane, to, align=4)


def _axes_at(builder, array, row, width, entry):
    at = builder.add(builder.mul(row, _size(width)), _size(entry))
    return builder.bitcast(builder.gep(array.data, [at]), _axes.as_pointer())


def _shuffled(builder, one, other, lanes):
    kind = ir.VectorType(_whole, len(lanes))
    return builder.shuffle_vector(one, other, ir.Constant(kind, lanes))


def _array(context, builder, signature, args, position):
    return context.make_array(signature.args[position])(context, builder, args[position])


def _entry(builder, array, row, i):
    """What a face has in a ``row`` of its chunk's numbers."""
    return builder.load(builder.gep(array.data, [builder.add(i, _size(row * CHUNK))]))


def _least_and_greatest(builder, numbers):
    low = high = numbers[0]
    for one in numbers[1:]:
        low = builder.select(builder.fcmp_ordered("<", one, low), one, low)
        high = builder.select(builder.fcmp_ordered(">", one, high), one, high)
    return low, high


def _alike(builder, scalar, size):
    """A vector whose lanes are all ``scalar``."""
    kind = ir.VectorType(scalar.type, size)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, _whole(0))
    first = ir.Constant(ir.VectorType(_whole, size), [0] * size)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), first)
