"""Which face each pixel shows: a depth buffer. Arrays in, arrays out, without the GIL.

Vertices are snapped to 1/256 px and edges tested in integers with the top-left rule (J. Pineda, *A
parallel algorithm for polygon rasterization*, 1988), so that a pixel centre on a shared edge
belongs to exactly one face. A depth value is 1/z under perspective, -z in parallel projection:
linear in the picture, and the greater the nearer. Of two faces at the same depth the first is seen.

Each face that is seen has a *plane* (PLANE,) float32: entries 0 to 2 are the normal, of any length,
at the pixel of entries COLUMN_OF and ROW_OF, 4 to 6 and 8 to 10 what a column and a row more add.
Its *paint* (PAINT,) is the like, of R, G, B or u, v, 0, and of a fourth number that these are
divided by. The last row, of no face, is zeros.

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
from poseviewer.render.software.kernel import kernel

SUBPIXELS = 256
GUARD_PX = float(1 << 20)
"""Beyond it, px, faces are clipped, so that edge functions fit into 64 bits."""
SMALL = 64 * SUBPIXELS
"""Size, 1/256 px, up to which a triangle's edge functions fit into 32 bits."""
OFF_SCREEN = np.int32(-(1 << 31))
"""The place of a vertex behind the near plane or beyond the guard band."""
NO_FACE = np.int32(-1)
PLAIN, GRADED, MAPPED = 0, 1, 2
"""Source of a face's reflectance: one colour, colours at its corners, a texture and one
colour. Negative they stand where there is no colour yet."""
COLUMN_OF, ROW_OF, GREY, PLANE, PAINT = 12, 13, 15, 16, 12
"""The entries of a face's plane that are the pixel which its first three are of, and its grey
reflectance; how many entries there are, and how many of its paint."""
MAX_PIECES = 6  # a triangle cut by five planes has eight corners

COLUMN, STATE, LISTED = 4, 5, 6  # rows of a chunk's boxes; 0 to 3: left, top, right, bottom
HIDDEN, DRAWN, LARGE = np.int32(0), np.int32(1), np.int32(2)  # states of a face
_i32 = np.int32  # sums of 32 bits would have 64, and vectors half the lanes
_SUB, _HALF_SUB, _HALF_LESS, _BITS = _i32(SUBPIXELS), _i32(128), _i32(127), _i32(8)
_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)

_jit: Any = kernel()
# For what is done for every face: a call costs more than it does.
_jit_inline: Any = kernel(forceinline=True)
# For loops over finite numbers: they vectorise. Sums keep their order, and nothing is contracted.
_jit_lanes: Any = kernel(fastmath={"nsz", "nnan"})


@_jit
def rasterise(drawn, surface, camera, width, workspace, picture):
    """Draw a model; sets the planes and paints of the faces that show.

    Args:
        drawn: what the last call returned.
        surface: (vertices (3, V), faces (F, 3), normals (F + 1, 9) at their corners).
        camera: (17,): camera_from_model's rotation, row by row, and translation; fx, fy, cx, cy;
            the least z under perspective, 0 for parallel projection.
        width: of the picture; its arrays have whole BLOCKs of columns.
        workspace: (screen (2, V), depths (V,), large (F,), planes, painting), with painting =
            (kinds (F,), paint at corners (F + 1, 12), texel areas (F,), count of texture levels,
            paints, levels (F + 1,)).
        picture: (depth float32, ids int32), (height, width).

    Returns:
        (left, top, right, bottom), whole px, ends excluded: outside the picture is empty.
    """
    vertices, faces, normals = surface
    screen, depths, large, planes, painting = workspace
    depth, ids = picture
    left, top, right, bottom = drawn
    depth[top:bottom, left:right] = -np.inf
    ids[top:bottom, left:right] = NO_FACE
    box = _project(vertices, camera, screen, depths, width, depth.shape[0])
    near, distance = camera[16], camera[11]
    weighs = np.float32(max(distance, near) if near > 0.0 else -1.0)
    shape = faces, screen, depths, normals
    count = _draw_small(shape, weighs, planes, painting, width, large, picture)
    if count > 0:
        owners, places, values = _cut(large[:count], shape, vertices, camera, planes, painting)
        for i in range(owners.shape[0]):
            _draw_piece(places[i], values[i], owners[i], width, depth, ids)
    return box


@_jit_lanes
def _project(vertices, camera, screen, depths, width, height):
    """Set ``screen`` (2, V), 1/256 px, and ``depths`` (V,); returns the box of pixels touched."""
    x, y, z, near = vertices[0], vertices[1], vertices[2], np.float32(camera[16])
    r0, r1, r2 = np.float32(camera[6]), np.float32(camera[7]), np.float32(camera[8])
    shift, perspective = np.float32(camera[11]), near > _ZERO
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
    x, y, z, near = vertices[0], vertices[1], vertices[2], np.float32(camera[16])
    r0, r1 = np.float32(camera[3 * axis]), np.float32(camera[3 * axis + 1])
    r2, shift = np.float32(camera[3 * axis + 2]), np.float32(camera[9 + axis])
    focal, centre = np.float32(camera[12 + axis]), np.float32(camera[14 + axis])
    perspective = near > _ZERO
    nearest = _ONE / near if perspective else np.float32(np.inf)
    least, most, off = np.int32(2**31 - 1), -np.int32(2**31 - 1), np.int32(0)
    for i in range(x.shape[0]):
        along = focal * (r0 * x[i] + r1 * y[i] + r2 * z[i] + shift)
        place = along * (depths[i] if perspective else _ONE) + centre
        outside = (abs(place) > np.float32(GUARD_PX)) | (depths[i] >= nearest)
        snapped = np.int32(np.floor((_ZERO if outside else place) * np.float32(SUBPIXELS) + _HALF))
        off |= np.int32(1) if outside else np.int32(0)
        least, most = min(least, snapped), max(most, snapped)
        out[i] = OFF_SCREEN if outside else snapped
    return least, most, off


@_jit
def _draw_small(shape, weighs, planes, painting, width, large, picture):
    """Draw faces with corners' weights ``weighs`` x depth (negative: 1); list the large ones."""
    (faces, screen, depths, normals), (depth, ids) = shape, picture
    kinds, paint, texel_areas, count_of_levels, paints, levels = painting
    corners, boxes = np.empty((6, CHUNK), np.int32), np.empty((7, CHUNK), np.int32)
    steps, values = np.empty((STEPS, CHUNK), np.int32), np.empty((VALUES, CHUNK), np.float32)
    is_painted, left_over = paint.shape[0] > 1, 0
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
            left, top = np.int64(boxes[COLUMN, i]), np.int64(boxes[1, i])
            right, bottom = np.int64(boxes[2, i]), np.int64(boxes[3, i])
            if draw_blocks(depth, ids, steps, values, i, left, right, top, bottom, face):
                f = np.uint32(face)
                _combine(normals, values, i, f, np.uint32(3), planes)
                planes[f, COLUMN_OF], planes[f, ROW_OF] = np.float32(left), np.float32(top)
                if is_painted and kinds[f] != PLAIN:
                    _combine(paint, values, i, f, np.uint32(4), paints)
                    pixels = _ONE / (abs(values[SCALE, i]) * _SUB * _SUB)
                    levels[f] = _texture_level(texel_areas[f], pixels, count_of_levels)
    return left_over


@_jit_inline
def _combine(corners, values, i, face, size, out):
    """Set the plane or paint of ``face``, a chunk's ``i``-th, from ``size`` numbers a corner."""
    for step in range(3):
        at = WEIGHTS + 3 * step
        a, b, c = values[at, i], values[at + 1, i], values[at + 2, i]
        for k in range(size):
            one, two, three = corners[face, k], corners[face, size + k], corners[face, 2 * size + k]
            out[face, 4 * step + k] = a * one + b * two + c * three


@_jit
def _texture_level(texels, pixels, count):
    """Mip level of a face: half the log2 of texels per pixel, rounded, from the two areas."""
    if texels <= pixels:
        return 0
    if pixels <= 0.0:
        return count - 1
    return min(int(0.5 * math.log2(texels / pixels) + 0.5), count - 1)


@_jit
def _gather(begin, size, faces, screen, depths, corners, values):
    """Set corners and depth values of the faces from ``begin`` on."""
    for i in range(size):
        f = np.uint32(begin + i)
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        corners[0, i], corners[1, i], corners[2, i] = screen[0, a], screen[0, b], screen[0, c]
        corners[3, i], corners[4, i], corners[5, i] = screen[1, a], screen[1, b], screen[1, c]
        values[0, i], values[1, i], values[2, i] = depths[a], depths[b], depths[c]


@_jit_inline
def _edge_at(xa, ya, xb, yb, px, py, sign):
    """Edge function between corners, what the top-left rule takes, its steps across and down."""
    ex, ey = _i32(sign * _i32(xb - xa)), _i32(sign * _i32(yb - ya))
    excluded = _i32(0) if (ey < 0) | ((ey == 0) & (ex > 0)) else _i32(1)
    e = _i32(_i32(ex * _i32(py - ya)) - _i32(ey * _i32(px - xa)))
    return e, excluded, _i32(-ey * _SUB), _i32(ex * _SUB)


@_jit
def _find_boxes(size, width, height, corners, boxes):
    """The pixels whose centres the faces' boxes hold: left, top, right, bottom, ends included."""
    for axis, length in enumerate((width, height)):
        at, end = 3 * axis, _i32(length - 1)
        a, b, c = corners[at, :size], corners[at + 1, :size], corners[at + 2, :size]
        first, last = boxes[axis, :size], boxes[2 + axis, :size]
        for i in range(size):
            first[i] = max(_i32(_i32(min(a[i], b[i], c[i]) + _HALF_LESS) >> _BITS), _i32(0))
            last[i] = min(_i32(_i32(max(a[i], b[i], c[i]) - _HALF_SUB) >> _BITS), end)


@_jit
def _set_up(size, corners, boxes, values):
    """Set each face's STATE, first COLUMN and depth ``values`` there, on the first row of its box.

    A face two pixels wide and high at most is drawn only if it holds the centre of one of the four.
    No branches and 32 bits alone, here and below, so that it is done in vectors.
    """
    x0, x1, x2 = corners[0, :size], corners[1, :size], corners[2, :size]
    y0, y1, y2 = corners[3, :size], corners[4, :size], corners[5, :size]
    left, top, right, bottom = boxes[0, :size], boxes[1, :size], boxes[2, :size], boxes[3, :size]
    z0, z1, z2 = values[0, :size], values[1, :size], values[2, :size]
    column, state = boxes[COLUMN, :size], boxes[STATE, :size]
    value, across, along = values[VALUE, :size], values[ACROSS, :size], values[ALONG, :size]
    turned = values[SCALE, :size]
    none = _i32(0)
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
        turned[i] = np.float32(-sign) * scale  # normals shall point to the side that is seen
        f0, f1, f2 = _i32(e0 - b0), _i32(e1 - b1), _i32(e2 - b2)
        outside = _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        f0, f1, f2 = _i32(f0 + d0), _i32(f1 + d1), _i32(f2 + d2)
        outside &= _i32(f0 | f1 | f2) & _i32(_i32(f0 + r0) | _i32(f1 + r1) | _i32(f2 + r2))
        wide, tall = _i32(right[i] - left[i]), _i32(bottom[i] - top[i])
        drawn = (_i32(outside) >= none) | (max(wide, tall) > _i32(1))
        drawn &= (min(wide, tall) >= none) & (area != none)
        least, most = min(x0[i], x1[i], x2[i]), max(x0[i], x1[i], x2[i])
        lowest, highest = min(y0[i], y1[i], y2[i]), max(y0[i], y1[i], y2[i])
        large = max(_i32(most - least), _i32(highest - lowest)) > _i32(SMALL)
        large |= min(least, lowest) == OFF_SCREEN
        column[i] = begin
        state[i] = LARGE if large else (DRAWN if drawn else HIDDEN)


@_jit
def _set_edge(size, k, weighs, corners, boxes, steps, values):
    """Set the edge function opposite corner ``k`` in ``steps`` and, weighed, in ``values``."""
    one, two = (k + 1) % 3, (k + 2) % 3
    xa, ya = corners[one, :size], corners[3 + one, :size]
    xb, yb = corners[two, :size], corners[3 + two, :size]
    column, top = boxes[COLUMN, :size], boxes[1, :size]
    scale, depth = values[SCALE, :size], values[k, :size]
    edge, right, down = steps[EDGE + k, :size], steps[RIGHT + k, :size], steps[DOWN + k, :size]
    here, across = values[WEIGHTS + k, :size], values[WEIGHTS + 3 + k, :size]
    along, perspective = values[WEIGHTS + 6 + k, :size], weighs > _ZERO
    for i in range(size):
        px, py = _i32(_i32(column[i] * _SUB) + _HALF_SUB), _i32(_i32(top[i] * _SUB) + _HALF_SUB)
        sign = _i32(-1) if scale[i] > _ZERO else _i32(1)
        e, b, r, d = _edge_at(xa[i], ya[i], xb[i], yb[i], px, py, sign)
        edge[i], right[i], down[i] = _i32(e - b), r, d
        weight = scale[i] * (weighs * depth[i] if perspective else _ONE)
        here[i], across[i] = np.float32(e) * weight, np.float32(r) * weight
        along[i] = np.float32(d) * weight


@_jit
def _list_drawn(size, boxes):
    """List the places of the faces that are drawn in row LISTED of ``boxes``; how many they are."""
    state, listed = boxes[STATE], boxes[LISTED]
    count = np.uint32(0)
    for i in range(size):
        listed[count] = i
        count += np.uint32(1) if state[i] > 0 else np.uint32(0)
    return count


@_jit
def _cut(large, shape, vertices, camera, planes, painting):
    """Cut ``large`` faces into triangles; sets their planes and paints.

    Returns their faces (T,), corners (T, 3, 2) in 1/256 px, and depth values there (T, 3).
    """
    faces, screen, depths, normals = shape
    kinds, paint, texel_areas, count_of_levels, paints, levels = painting
    size = MAX_PIECES * large.shape[0]
    owners, places = np.empty(size, np.int32), np.empty((size, 3, 2), np.int64)
    values = np.empty((size, 3), np.float32)
    one, other, near, pieces = np.empty((8, 4)), np.empty((8, 4)), camera[16], 0
    for face in large:
        off = False
        for k in range(3):
            corner = faces[face, k]
            _set_homogeneous(vertices, corner, camera, one[k])
            off |= screen[0, corner] == OFF_SCREEN or screen[1, corner] == OFF_SCREEN
            places[pieces, k, 0], places[pieces, k, 1] = screen[0, corner], screen[1, corner]
            values[pieces, k] = depths[corner]
        _set_plane(face, one, normals, planes)
        planes[face, COLUMN_OF] = planes[face, ROW_OF] = -0.5  # its centre is the origin
        if paint.shape[0] > 1 and kinds[face] != PLAIN:
            _set_plane(face, one, paint, paints)
            levels[face] = _texture_level(texel_areas[face], _pixel_area(one), count_of_levels)
        owners[pieces] = face
        if not off:
            pieces += 1
            continue
        polygon, count = _clip(one, other, near)
        for i in range(2, count):
            for k, corner in enumerate((0, i - 1, i)):
                w = polygon[corner, 2]
                for axis in range(2):
                    place = math.floor(polygon[corner, axis] / w * SUBPIXELS + 0.5)
                    places[pieces, k, axis] = np.int64(place)
                values[pieces, k] = 1.0 / w if near > 0.0 else polygon[corner, 3]
            owners[pieces] = face
            pieces += 1
    return owners[:pieces], places[:pieces], values[:pieces]


@_jit
def _set_homogeneous(vertices, index, camera, out):
    """``out`` (4,): (X, Y, W, d) with u = X / W, v = Y / W; W is z or 1, d linear in the others."""
    a, b, c = vertices[0, index], vertices[1, index], vertices[2, index]
    x = camera[0] * a + camera[1] * b + camera[2] * c + camera[9]
    y = camera[3] * a + camera[4] * b + camera[5] * c + camera[10]
    z = camera[6] * a + camera[7] * b + camera[8] * c + camera[11]
    w = z if camera[16] > 0.0 else 1.0
    out[0], out[1] = camera[12] * x + camera[14] * w, camera[13] * y + camera[15] * w
    out[2], out[3] = w, -z


@_jit
def _set_plane(face, polygon, corners, planes):
    """Set a face's plane from homogeneous corners, which hold behind the camera too.

    Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, 1997.
    """
    weights, most = np.empty((3, 3)), 1e-300
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        xj, yj, wj = polygon[j, 0], polygon[j, 1], polygon[j, 2]
        xk, yk, wk = polygon[k, 0], polygon[k, 1], polygon[k, 2]
        # Negative where the front is seen: so this is the side that is seen.
        weights[0, i] = xk * yj - xj * yk
        weights[1, i], weights[2, i] = wj * yk - wk * yj, wk * xj - wj * xk
        for step in range(3):
            most = max(most, abs(weights[step, i]))
    size = corners.shape[1] // 3
    for step in range(3):
        for axis in range(size):
            total = 0.0
            for i in range(3):
                total += weights[step, i] / most * corners[face, size * i + axis]
            planes[face, 4 * step + axis] = total


@_jit
def _pixel_area(polygon):
    """Twice a triangle's area in the picture, px; without bound if it reaches behind the camera."""
    if min(polygon[0, 2], polygon[1, 2], polygon[2, 2]) <= 0.0:
        return np.inf
    x, y = polygon[0, 0] / polygon[0, 2], polygon[0, 1] / polygon[0, 2]
    ax, ay = polygon[1, 0] / polygon[1, 2] - x, polygon[1, 1] / polygon[1, 2] - y
    bx, by = polygon[2, 0] / polygon[2, 2] - x, polygon[2, 1] / polygon[2, 2] - y
    return abs(ax * by - bx * ay)


@_jit
def _clip(polygon, other, near):
    """Clip a triangle at the near plane and guard band (Sutherland and Hodgman); corners, count."""
    count, first = 3, 0 if near > 0.0 else 1
    for plane in range(first, 5):
        a, b, c, d = 0.0, 0.0, GUARD_PX, 0.0  # kept is a X + b Y + c W + d >= 0
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
            # Number by number: a row's size is looked at first, which takes long to compile.
            if here >= 0.0:
                for k in range(4):
                    other[kept, k] = polygon[i, k]
                kept += 1
            if (here >= 0.0) != (there >= 0.0):
                t = here / (here - there)
                for k in range(4):
                    other[kept, k] = polygon[i, k] + t * (polygon[j, k] - polygon[i, k])
                kept += 1
        polygon, other, count = other, polygon, kept
    return polygon, count


@_jit
def _draw_piece(places, values, face, width, depth, ids):
    """One triangle of any size, row by row in spans."""
    x0, y0, x1, y1 = places[0, 0], places[0, 1], places[1, 0], places[1, 1]
    x2, y2 = places[2, 0], places[2, 1]
    d0, d1, d2 = values[0], values[1], values[2]
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
            _fill_row(depth[row, begin:end], ids[row, begin:end], value, slope, face)
        e0, e1, e2 = e0 + down0, e1 + down1, e2 + down2


@_jit
def _wide_edge_at(xa, ya, xb, yb, px, py, sign):
    """``_edge_at`` in 64 bits."""
    ex, ey = sign * (xb - xa), sign * (yb - ya)
    excluded = 0 if (ey < 0) | ((ey == 0) & (ex > 0)) else 1
    return ex * (py - ya) - ey * (px - xa), excluded, -ey * SUBPIXELS, ex * SUBPIXELS


@_jit
def _span(first, last, e, right):
    """Part of columns ``first`` to ``last`` where an edge function ``e`` + k ``right`` is >= 0."""
    if right > 0:
        return max(first, (right - 1 - e) // right) if e < 0 else first, last
    if e < 0:
        return first, first - 1
    return first, min(last, e // -right) if right < 0 else last


@_jit
def _fill_row(depths, faces, d, slope, face):
    """Draw ``face`` all along a row's pixels, where it is not behind what is there."""
    for k in range(depths.shape[0]):
        value, before, face_before = np.float32(d + np.int32(k) * slope), depths[k], faces[k]
        wins = (value > before) | ((value == before) & (face < face_before))
        depths[k] = value if wins else before
        faces[k] = face if wins else face_before
