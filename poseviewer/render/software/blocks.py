"""Drawing a face in blocks of pixels at once, in LLVM's own vectors.

The compiler does not find them by itself: as loops in numba the same took the rasteriser twice the
time. Of a face there stand numbers in ``steps`` (STEPS, CHUNK) int32 and ``values`` (VALUES, CHUNK)
float32, a column for each face of a chunk.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

CHUNK = 512  # faces that are looked at together
BLOCK = 16  # pixels of a row that are done at a time

EDGE, RIGHT, DOWN, STEPS = 0, 3, 6, 9
"""Rows of ``steps``: the three edge functions at a face's first pixel, the top-left rule applied,
what a column more adds to each, and what a row more adds."""

VALUE, ACROSS, ALONG, SCALE, WEIGHTS, VALUES = 3, 4, 5, 6, 7, 16
"""Rows of ``values``: 0 to 2 are the corners' depth values; that of the first pixel, and what a
column and a row more add; one over the area, positive for a front; and nine as those of ``steps``,
the rule not applied, times the corners' weights."""

_whole, _real, _size = ir.IntType(32), ir.FloatType(), ir.IntType(64)
_wholes, _reals = ir.VectorType(_whole, BLOCK), ir.VectorType(_real, BLOCK)
_intrinsic: Any = intrinsic


@_intrinsic
def draw_blocks(typing, depth, ids, steps, values, i, left, right, top, bottom, face):  # noqa: ARG001
    """Draw the ``i``-th face of a chunk into ``depth`` and ``ids``; whether it shows anywhere.

    Blocks run from column ``left`` to that of column ``right``; the first pixel is (left, top).
    """
    signature = types.boolean(depth, ids, steps, values, *[types.int64] * 5, types.int32)
    return signature, _emit_draw


def _emit_draw(context, builder, signature, args):
    depth, ids, steps, values = (_array(context, builder, signature, args, k) for k in range(4))
    i, left, right, top, bottom, face = args[4:]

    def step(row):
        return _alike(builder, _entry(builder, steps, row, i))

    def keep(number):
        return cgutils.alloca_once_value(builder, number)

    rights, downs = [step(RIGHT + k) for k in range(3)], [step(DOWN + k) for k in range(3)]
    lanes, block = (ir.Constant(_wholes, row) for row in (list(range(BLOCK)), [BLOCK] * BLOCK))
    edges = [builder.add(step(EDGE + k), builder.mul(rights[k], lanes)) for k in range(3)]
    value, slope, fall = (_entry(builder, values, row, i) for row in (VALUE, ACROSS, ALONG))
    low, high = _least_and_greatest(builder, [_entry(builder, values, k, i) for k in range(3)])
    columns = ir.Constant(_reals, [float(lane) for lane in range(BLOCK)])
    slopes = builder.fmul(_alike(builder, slope), columns)
    of_face = slopes, _alike(builder, low), _alike(builder, high)
    of_face = *of_face, _alike(builder, face)

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
    """Draw one row of a block from entry ``at`` on; a bit for each pixel that shows the face."""
    slopes, low, high, faces = of_face
    depth_at, id_at = (
        builder.bitcast(builder.gep(data, [at]), kind.as_pointer())
        for data, kind in zip(picture, (_reals, _wholes), strict=True)
    )
    signs = builder.or_(builder.or_(edges[0], edges[1]), edges[2])
    inside = builder.icmp_signed(">=", signs, ir.Constant(_wholes, [0] * BLOCK))
    d = builder.fadd(_alike(builder, value), slopes)
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


def _array(context, builder, signature, args, position):
    return context.make_array(signature.args[position])(context, builder, args[position])


def _entry(builder, array, row, i):
    """Load a face's entry in a ``row`` of its chunk's numbers."""
    return builder.load(builder.gep(array.data, [builder.add(i, _size(row * CHUNK))]))


def _least_and_greatest(builder, numbers):
    low = high = numbers[0]
    for one in numbers[1:]:
        low = builder.select(builder.fcmp_ordered("<", one, low), one, low)
        high = builder.select(builder.fcmp_ordered(">", one, high), one, high)
    return low, high


def _alike(builder, scalar):
    """A vector whose lanes are all ``scalar``."""
    kind = ir.VectorType(scalar.type, BLOCK)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, _whole(0))
    first = ir.Constant(_wholes, [0] * BLOCK)
    return builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), first)
