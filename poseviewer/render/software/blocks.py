"""Drawing a face in blocks of pixels at once, in LLVM's own vectors.

The compiler does not find these vectors in loops, which took the rasteriser twice the time.
``steps`` (STEPS, CHUNK) int32 and ``values`` (VALUES, CHUNK) float32 have a column for each face.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

CHUNK = 512
"""Faces that are set up together."""
BLOCK = 16
"""Pixels of a row that are drawn at once: a vector of 512 bits."""

EDGE = 0
"""First of 3 rows of ``steps``: edge functions at the first pixel, the top-left rule applied."""
RIGHT = 3
"""First of 3 rows of ``steps``: what a column more adds to the edge functions."""
DOWN = 6
"""First of 3 rows of ``steps``: what a row more adds to the edge functions."""
STEPS = 9
"""Number of rows of ``steps``."""

DEPTHS = 0
"""First of 3 rows of ``values``: depth values at the corners."""
VALUE = 3
"""Row of ``values``: depth value at the first pixel."""
ACROSS = 4
"""Row of ``values``: what a column more adds to the depth value."""
ALONG = 5
"""Row of ``values``: what a row more adds to the depth value."""
SCALE = 6
"""Row of ``values``: one over the area, positive for a front."""
WEIGHTS = 7
"""First of 9 rows of ``values``: edge functions and their steps times the corners' weights."""
VALUES = 16
"""Number of rows of ``values``."""

_whole = ir.IntType(32)
_real = ir.FloatType()
_size = ir.IntType(64)
_wholes = ir.VectorType(_whole, BLOCK)
_reals = ir.VectorType(_real, BLOCK)
_intrinsic: Any = intrinsic


@_intrinsic
def draw_blocks(typing, depth, ids, steps, values, i, left, right, top, bottom, face):  # noqa: ARG001
    """Draw a face of a chunk into a picture; returns whether it shows anywhere.

    Args:
        typing: numba's.
        depth: (height, width) float32 of the picture.
        ids: (height, width) int32 of the picture.
        steps: (STEPS, CHUNK) int32.
        values: (VALUES, CHUNK) float32.
        i: column of the face.
        left: first column, that of a block.
        right: last column.
        top: first row.
        bottom: last row.
        face: index that is drawn.
    """
    signature = types.boolean(depth, ids, steps, values, *[types.int64] * 5, types.int32)
    return signature, _emit_draw


def _emit_draw(context, builder, signature, args):
    depth, ids, steps, values = (_array(context, builder, signature, args, k) for k in range(4))
    i, left, right, top, bottom, face = args[4:]

    def step(row):
        return _alike(builder, _entry(builder, steps, row, i))

    def variable(value):
        return cgutils.alloca_once_value(builder, value)

    rights, downs = [step(RIGHT + k) for k in range(3)], [step(DOWN + k) for k in range(3)]
    lanes, block = (ir.Constant(_wholes, row) for row in (list(range(BLOCK)), [BLOCK] * BLOCK))
    edges = [builder.add(step(EDGE + k), builder.mul(rights[k], lanes)) for k in range(3)]
    value, slope, fall = (_entry(builder, values, row, i) for row in (VALUE, ACROSS, ALONG))
    low, high = _extremes(builder, [_entry(builder, values, DEPTHS + k, i) for k in range(3)])
    columns = ir.Constant(_reals, [float(lane) for lane in range(BLOCK)])
    slopes = builder.fmul(_alike(builder, slope), columns)
    of_face = slopes, *(_alike(builder, scalar) for scalar in (low, high, face))

    stride = builder.extract_value(depth.shape, 1)
    first = builder.add(builder.mul(top, stride), left)
    rows = builder.add(builder.sub(bottom, top), _size(1))
    end = builder.add(builder.sub(right, left), _size(1))
    block_edges, row_edges = ([variable(edge) for edge in edges] for _ in range(2))
    row_value, shown = variable(value), variable(ir.IntType(BLOCK)(0))
    with cgutils.for_range_slice(builder, _size(0), end, _size(BLOCK)) as (skip, _):
        for here, begin in zip(row_edges, block_edges, strict=True):
            builder.store(builder.load(begin), here)
        shift = builder.fmul(builder.sitofp(skip, _real), slope)
        builder.store(builder.fadd(value, shift), row_value)
        with cgutils.for_range(builder, rows) as row:
            at = builder.add(builder.add(first, skip), builder.mul(row.index, stride))
            here, d = [builder.load(edge) for edge in row_edges], builder.load(row_value)
            bits = _draw_row(builder, (depth.data, ids.data), at, here, d, of_face)
            builder.store(builder.or_(builder.load(shown), bits), shown)
            for kept, edge, more in zip(row_edges, here, downs, strict=True):
                builder.store(builder.add(edge, more), kept)
            builder.store(builder.fadd(d, fall), row_value)
        for kept, more in zip(block_edges, rights, strict=True):
            builder.store(builder.add(builder.load(kept), builder.mul(more, block)), kept)
    return builder.icmp_unsigned("!=", builder.load(shown), ir.IntType(BLOCK)(0))


def _draw_row(builder, picture, at, edges, value, of_face):
    """Draw one row of a block from entry ``at`` on; returns a bit for each pixel shown."""
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
    """Load a face's entry in a ``row`` of its chunk's arrays."""
    return builder.load(builder.gep(array.data, [builder.add(i, _size(row * CHUNK))]))


def _extremes(builder, values):
    low = high = values[0]
    for value in values[1:]:
        low = builder.select(builder.fcmp_ordered("<", value, low), value, low)
        high = builder.select(builder.fcmp_ordered(">", value, high), value, high)
    return low, high


def _alike(builder, scalar):
    """Make a vector whose lanes are all ``scalar``."""
    kind = ir.VectorType(scalar.type, BLOCK)
    lane = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, _whole(0))
    first = ir.Constant(_wholes, [0] * BLOCK)
    return builder.shuffle_vector(lane, ir.Constant(kind, ir.Undefined), first)
