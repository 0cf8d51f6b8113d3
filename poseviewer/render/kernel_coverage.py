"""The rasteriser's first half: which face each pixel shows. Arrays in, arrays out, without the GIL.

Vertices are snapped to 1/256 px and edges tested in integers with the top-left rule, so that a
pixel centre on a shared edge belongs to exactly one face. Where two faces are equally near, the
one that comes first in the list is seen: pictures do not depend on the order of drawing.

Clusters of faces (see ``clusters``) that are likely to be seen are drawn first; the others only
where they are not behind what is drawn, told by their boxes and the farthest depths of tiles of
the picture (N. Greene, M. Kass and G. Miller, *Hierarchical Z-buffer visibility*, 1993).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

SUBPIXELS = 256
GUARD_PX = float(1 << 20)  # beyond it faces are clipped, so that edge functions fit into 64 bits
OFF_SCREEN = np.int32(-(1 << 31))  # marks a vertex behind the near plane or beyond the guard band
TILE_BITS = 2  # a tile has 8 x 8 pixels
CLUSTER_BITS = 5  # a cluster has 32 faces
BLOCK = 8  # pixels of a row that are done at a time
SMALL = 64 * SUBPIXELS  # in triangles of this size edge functions fit into 32 bits
DEPTH_MARGIN = 1e-6  # depth values are rounded to float32

_jit: Any = njit(nogil=True, cache=True, error_model="numpy")
# For loops over finite numbers that need not mind the order of sums: they vectorise.
_jit_sums: Any = njit(
    nogil=True, cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz", "nnan"}
)


@_jit_sums
def _project(begin, end, vertices, camera, homogeneous, snapped, bounds):
    """Vertices ``begin`` to ``end`` of ``vertices`` (V, 3) to ``homogeneous`` and ``snapped``.

    ``homogeneous`` (V, 4) is (X, Y, W, d): under perspective
    W is z and the depth value d is 1/z; under parallel projection they are 1 and -z: d is linear
    in the picture, and the greater the nearer. ``snapped`` (V, 2) is in 1/256 px. Widens
    ``bounds`` (left, top, right, bottom), px; returns whether any vertex needs clipping.
    """
    r00, r01, r02, r10, r11 = camera[0], camera[1], camera[2], camera[3], camera[4]
    r12, r20, r21, r22 = camera[5], camera[6], camera[7], camera[8]
    tx, ty, tz = camera[9], camera[10], camera[11]
    fx, fy, cx, cy, near = camera[12], camera[13], camera[14], camera[15], camera[16]
    perspective = near > 0.0
    left, top, right, bottom = bounds[0], bounds[1], bounds[2], bounds[3]
    any_off = 0
    for index in range(begin, end):
        i = np.uint32(index)
        a, b, c = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        x = r00 * a + r01 * b + r02 * c + tx
        y = r10 * a + r11 * b + r12 * c + ty
        z = r20 * a + r21 * b + r22 * c + tz
        w = z if perspective else 1.0
        # Behind the near plane any number does: it is not looked at.
        inverse = 1.0 / (w if w > near or not perspective else near)
        big_x, big_y = fx * x + cx * w, fy * y + cy * w
        u, v = big_x * inverse, big_y * inverse
        off = (w < near) & perspective | (abs(u) > GUARD_PX) | (abs(v) > GUARD_PX)
        homogeneous[i, 0], homogeneous[i, 1], homogeneous[i, 2] = big_x, big_y, w
        homogeneous[i, 3] = inverse if perspective else -z
        any_off |= 1 if off else 0
        u, v = 0.0 if off else u, 0.0 if off else v
        left, right = min(left, u), max(right, u)
        top, bottom = min(top, v), max(bottom, v)
        snapped_u = np.int32(math.floor(u * SUBPIXELS + 0.5))
        snapped[i, 0] = OFF_SCREEN if off else snapped_u
        snapped[i, 1] = np.int32(math.floor(v * SUBPIXELS + 0.5))
    bounds[0], bounds[1], bounds[2], bounds[3] = left, top, right, bottom
    return any_off > 0


@_jit
def _draw_row(row, first, count, edges, rights, d, slope, lo, hi, face, depth, ids):
    """A row of a small triangle, ``count`` (a multiple of BLOCK) pixels from column ``first`` on.

    It writes every pixel, most of them unchanged, so that a block is done at a time.
    """
    e0, e1, e2 = np.int32(edges[0]), np.int32(edges[1]), np.int32(edges[2])
    right0, right1, right2 = np.int32(rights[0]), np.int32(rights[1]), np.int32(rights[2])
    start, rise = np.float32(d), np.float32(slope)
    for k in range(count):
        column, step = np.uint32(first) + np.uint32(k), np.int32(k)
        f0 = np.int32(e0 + step * right0)
        f1 = np.int32(e1 + step * right1)
        f2 = np.int32(e2 + step * right2)
        value = min(max(start + np.float32(step) * rise, lo), hi)
        before, shown = depth[row, column], ids[row, column]
        nearer = (value > before) | ((value == before) & (face < shown))
        wins = ((f0 | f1 | f2) >= np.int32(0)) & nearer
        depth[row, column] = value if wins else before
        ids[row, column] = face if wins else shown


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
def _draw(x0, y0, d0, x1, y1, d1, x2, y2, d2, face, two_sided, width, depth, ids):
    """One triangle in 1/256 px, with depth values d (greater is nearer), linear in the picture."""
    x0, y0, x1, y1 = np.int64(x0), np.int64(y0), np.int64(x1), np.int64(y1)
    x2, y2 = np.int64(x2), np.int64(y2)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0 or (area > 0 and not two_sided):  # y runs down: faces towards us have area < 0
        return
    if area < 0:
        x1, y1, d1, x2, y2, d2 = x2, y2, d2, x1, y1, d1
        area = -area
    half = SUBPIXELS // 2
    least_x, most_x = min(x0, x1, x2), max(x0, x1, x2)
    least_y, most_y = min(y0, y1, y2), max(y0, y1, y2)
    first_column = max((least_x + half - 1) >> 8, 0)
    last_column = min((most_x - half) >> 8, width - 1)
    first_row = max((least_y + half - 1) >> 8, 0)
    last_row = min((most_y - half) >> 8, depth.shape[0] - 1)
    if first_column > last_column or first_row > last_row:
        return
    px, py = first_column * SUBPIXELS + half, first_row * SUBPIXELS + half
    e0 = (x2 - x1) * (py - y1) - (y2 - y1) * (px - x1)
    e1 = (x0 - x2) * (py - y2) - (y0 - y2) * (px - x2)
    e2 = (x1 - x0) * (py - y0) - (y1 - y0) * (px - x0)
    # Points on a top or left edge are inside, on the others outside.
    b0 = 0 if y2 < y1 or (y2 == y1 and x2 > x1) else -1
    b1 = 0 if y0 < y2 or (y0 == y2 and x0 > x2) else -1
    b2 = 0 if y1 < y0 or (y1 == y0 and x1 > x0) else -1
    right0, right1, right2 = (y1 - y2) * SUBPIXELS, (y2 - y0) * SUBPIXELS, (y0 - y1) * SUBPIXELS
    down0, down1, down2 = (x2 - x1) * SUBPIXELS, (x0 - x2) * SUBPIXELS, (x1 - x0) * SUBPIXELS
    scale = 1.0 / area
    s1, s2 = (d1 - d0) * scale, (d2 - d0) * scale
    slope = right1 * s1 + right2 * s2
    if max(most_x - least_x, most_y - least_y) <= SMALL:  # 32 bits suffice
        lo, hi = np.float32(min(d0, d1, d2)), np.float32(max(d0, d1, d2))
        # Whole blocks: a block that was just written can be read again without waiting for it.
        rights = (right0, right1, right2)
        start = first_column & -BLOCK
        skip = start - first_column
        e0, e1, e2 = e0 + skip * right0, e1 + skip * right1, e2 + skip * right2
        count = (last_column - start + BLOCK) & -BLOCK
        for row in range(first_row, last_row + 1):
            edges, d = (e0 + b0, e1 + b1, e2 + b2), d0 + e1 * s1 + e2 * s2
            at = np.uint32(row)
            _draw_row(at, start, count, edges, rights, d, slope, lo, hi, face, depth, ids)
            e0, e1, e2 = e0 + down0, e1 + down1, e2 + down2
        return
    for row in range(first_row, last_row + 1):
        first, last = _span(first_column, first_column, last_column, e0, right0)
        first, last = _span(first_column, first, last, e1, right1)
        first, last = _span(first_column, first, last, e2, right2)
        skip = first - first_column
        f0, f1, f2 = e0 + b0 + skip * right0, e1 + b1 + skip * right1, e2 + b2 + skip * right2
        d = d0 + (e1 + skip * right1) * s1 + (e2 + skip * right2) * s2
        for column in range(first, last + 1):
            value = np.float32(d)
            d += slope
            if f0 | f1 | f2 >= 0:
                before = depth[row, column]
                if value > before or (value == before and face < ids[row, column]):
                    depth[row, column] = value
                    ids[row, column] = face
            f0 += right0
            f1 += right1
            f2 += right2
        e0, e1, e2 = e0 + down0, e1 + down1, e2 + down2


@_jit
def _clip_plane(polygon, count, a, b, c, d, out):
    """Sutherland-Hodgman: keep ``a X + b Y + c W + d >= 0``; returns the new corner count."""
    kept = 0
    for i in range(count):
        j = (i + 1) % count
        here = a * polygon[i, 0] + b * polygon[i, 1] + c * polygon[i, 2] + d
        there = a * polygon[j, 0] + b * polygon[j, 1] + c * polygon[j, 2] + d
        if here >= 0.0:
            out[kept] = polygon[i]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            t = here / (here - there)
            for k in range(4):
                out[kept, k] = polygon[i, k] + t * (polygon[j, k] - polygon[i, k])
            kept += 1
    return kept


@_jit
def _clip_and_draw(homogeneous, a, b, c, face, near, two_sided, width, depth, ids):
    """A face that crosses the near plane or the guard band: clip it, draw what is left as a fan."""
    one, other, perspective = np.empty((8, 4)), np.empty((8, 4)), near > 0.0
    one[0], one[1], one[2] = homogeneous[a], homogeneous[b], homogeneous[c]
    count = 3
    if perspective:
        count = _clip_plane(one, count, 0.0, 0.0, 1.0, -near, other)
        one, other = other, one
    count = _clip_plane(one, count, 1.0, 0.0, GUARD_PX, 0.0, other)
    count = _clip_plane(other, count, -1.0, 0.0, GUARD_PX, 0.0, one)
    count = _clip_plane(one, count, 0.0, 1.0, GUARD_PX, 0.0, other)
    count = _clip_plane(other, count, 0.0, -1.0, GUARD_PX, 0.0, one)
    for i in range(2, count):
        x = np.empty(3, np.int64)
        y = np.empty(3, np.int64)
        d = np.empty(3)
        for k, corner in enumerate((0, i - 1, i)):
            x[k] = np.int64(math.floor(one[corner, 0] / one[corner, 2] * SUBPIXELS + 0.5))
            y[k] = np.int64(math.floor(one[corner, 1] / one[corner, 2] * SUBPIXELS + 0.5))
            d[k] = 1.0 / one[corner, 2] if perspective else one[corner, 3]
        _draw(
            x[0], y[0], d[0], x[1], y[1], d[1], x[2], y[2], d[2], face, two_sided, width, depth, ids
        )


@_jit
def _draw_faces(
    cluster, first, faces, near, two_sided, homogeneous, snapped, box, tiles, depth, ids, width
):
    """Draw a cluster's faces; after the ``first`` ones only those that ``tiles`` do not hide."""
    height = depth.shape[0]
    begin = cluster << CLUSTER_BITS
    for index in range(begin, min(begin + (1 << CLUSTER_BITS), faces.shape[0])):
        face = np.uint32(index)
        a, b, c = np.uint32(faces[face, 0]), np.uint32(faces[face, 1]), np.uint32(faces[face, 2])
        ax, bx, cx = snapped[a, 0], snapped[b, 0], snapped[c, 0]
        if ax == OFF_SCREEN or bx == OFF_SCREEN or cx == OFF_SCREEN:
            _clip_and_draw(
                homogeneous, a, b, c, np.int32(index), near, two_sided, width, depth, ids
            )
            continue
        # Most faces of a detailed model lie between pixel centres: leave them as early as can be.
        left, right = max((min(ax, bx, cx) + 127) >> 8, 0), (max(ax, bx, cx) - 128) >> 8
        if left > min(right, width - 1):
            continue
        ay, by, cy = snapped[a, 1], snapped[b, 1], snapped[c, 1]
        top, bottom = max((min(ay, by, cy) + 127) >> 8, 0), (max(ay, by, cy) - 128) >> 8
        if top > min(bottom, height - 1):
            continue
        da, db, dc = homogeneous[a, 3], homogeneous[b, 3], homogeneous[c, 3]
        if not first:
            nearest = max(da, db, dc)
            nearest += DEPTH_MARGIN * abs(nearest)
            if _is_behind(left, top, right, bottom, nearest, box, tiles):
                continue
        _draw(ax, ay, da, bx, by, db, cx, cy, dc, np.int32(index), two_sided, width, depth, ids)


@_jit
def _is_behind(left, top, right, bottom, nearest, box, tiles):
    """Whether all that ``tiles`` has on the pixels up to ``right``, ``bottom`` is nearer."""
    if left < box[0] or top < box[1] or right >= box[2] or bottom >= box[3]:
        return False
    for row in range(top >> TILE_BITS, (bottom >> TILE_BITS) + 1):
        for column in range(left >> TILE_BITS, (right >> TILE_BITS) + 1):
            if tiles[np.uint32(row), np.uint32(column)] <= nearest:
                return False
    return True


@_jit
def _find_farthest(box, width, depth, tiles):
    """The farthest depth value of each tile that meets ``box``, -inf where one is empty."""
    height = depth.shape[0]
    left, top, right, bottom = box
    size = 1 << TILE_BITS
    for tile_row in range(top >> TILE_BITS, (bottom + size - 1) >> TILE_BITS):
        for tile_column in range(left >> TILE_BITS, (right + size - 1) >> TILE_BITS):
            farthest = np.float32(np.inf)
            first = tile_column * size
            for row in range(tile_row * size, min((tile_row + 1) * size, height)):
                for column in range(first, min(first + size, width)):
                    farthest = min(farthest, depth[row, column])
            tiles[tile_row, tile_column] = farthest


@_jit
def _extent(cluster, cluster_box, axis, camera):
    """Least and greatest coordinate of a bounding box along one of the camera's axes."""
    c, k = np.uint32(cluster), np.uint32(3 * axis)
    r0, r1, r2 = camera[k], camera[k + 1], camera[k + 2]
    x, y, z = cluster_box[c, 0], cluster_box[c, 1], cluster_box[c, 2]
    middle = camera[9 + axis] + r0 * x + r1 * y + r2 * z
    x, y, z = cluster_box[c, 3], cluster_box[c, 4], cluster_box[c, 5]
    half = abs(r0) * x + abs(r1) * y + abs(r2) * z
    return middle - half, middle + half


@_jit
def _may_be_seen(cluster, cluster_box, camera, box, width, height, tiles):
    """False if no part of a cluster can be seen: outside the picture, or behind the tiles.

    Outside ``box`` nothing is drawn yet. Bounding boxes are widened to the camera's axes.
    """
    low_x, high_x = _extent(cluster, cluster_box, 0, camera)
    low_y, high_y = _extent(cluster, cluster_box, 1, camera)
    low_z, high_z = _extent(cluster, cluster_box, 2, camera)
    fx, fy, cx, cy, near = camera[12], camera[13], camera[14], camera[15], camera[16]
    if near > 0.0:
        if high_z < near:
            return False
        if low_z < near:
            return True
        one, other, nearest = 1.0 / low_z, 1.0 / high_z, 1.0 / low_z
    else:
        one, other, nearest = 1.0, 1.0, -low_z
    left = fx * min(low_x * one, low_x * other) + cx - 1.0
    right = fx * max(high_x * one, high_x * other) + cx + 1.0
    top = fy * min(low_y * one, low_y * other) + cy - 1.0
    bottom = fy * max(high_y * one, high_y * other) + cy + 1.0
    if right < 0.0 or bottom < 0.0 or left > width or top > height:
        return False
    nearest += DEPTH_MARGIN * abs(nearest)
    left, right = max(left, 0.0), min(right, width - 1.0)
    top, bottom = max(top, 0.0), min(bottom, height - 1.0)
    return not _is_behind(int(left), int(top), int(right), int(bottom), nearest, box, tiles)


@_jit
def draw(
    vertices,
    faces,
    cluster_start,
    cluster_box,
    camera,
    two_sided,
    likely,
    homogeneous,
    snapped,
    tiles,
    depth,
    ids,
    width,
):
    """Draw all that is seen into ``depth`` float32 and ``ids`` int32.

    Both are (height, ``width`` rounded up to whole BLOCKs) and must be clear (-inf, -1).
    ``camera`` is (17,): camera_from_model's rotation, row by row, and translation; fx, fy, cx, cy;
    the least z under perspective, 0 for parallel projection. ``likely`` (C,) is above 0 for the
    clusters to draw first: it changes the time only. ``tiles`` has an entry for each tile of the
    picture. Returns the box (left, top, right, bottom), whole px, ends excluded, outside which
    nothing was drawn. ``homogeneous`` is filled for the faces that are seen, at least.
    """
    height, near, points = depth.shape[0], camera[16], homogeneous
    bounds = np.array([np.inf, np.inf, -np.inf, -np.inf])
    any_off = False
    box = (0, 0, 0, 0)
    for first in (True, False):
        for cluster in range(cluster_box.shape[0]):
            if (likely[cluster] > 0) != first:
                continue
            if not first and not _may_be_seen(
                cluster, cluster_box, camera, box, width, height, tiles
            ):
                continue
            begin, end = cluster_start[cluster], cluster_start[cluster + 1]
            any_off |= _project(begin, end, vertices, camera, homogeneous, snapped, bounds)
            _draw_faces(
                cluster,
                first,
                faces,
                near,
                two_sided,
                points,
                snapped,
                box,
                tiles,
                depth,
                ids,
                width,
            )
        box = _pixel_box(bounds, any_off, width, height)
        if first:
            _find_farthest(box, width, depth, tiles)
    return box


@_jit
def _pixel_box(bounds, any_off, width, height):
    """All pixels that the bounds touch, with a pixel to spare for snapping; empty if outside."""
    if any_off:
        return 0, 0, width, height
    if bounds[0] > bounds[2]:
        return 0, 0, 0, 0
    left = min(max(math.floor(bounds[0]) - 1, 0), width)
    top = min(max(math.floor(bounds[1]) - 1, 0), height)
    right = max(min(math.ceil(bounds[2]) + 1, width), left)
    bottom = max(min(math.ceil(bounds[3]) + 1, height), top)
    return left, top, right, bottom
