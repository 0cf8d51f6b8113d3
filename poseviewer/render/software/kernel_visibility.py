"""The rasteriser's choice of faces: those that may be seen. Arrays in, arrays out, without the GIL.

Faces that were seen a moment ago come first. When they are drawn, ``list_others`` lists those of
the clusters of faces (see ``clusters``) that are not behind them, told by the clusters' bounding
boxes and the farthest depths of tiles of the picture (N. Greene, M. Kass and G. Miller,
*Hierarchical Z-buffer visibility*, 1993). Nothing that can be seen is left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.software.kernel_compiler import kernel

SUBPIXELS = 256
GUARD_PX = float(1 << 20)  # beyond it faces are clipped, so that edge functions fit into 64 bits
OFF_SCREEN = np.int32(-(1 << 31))  # marks a vertex behind the near plane or beyond the guard band
TILE_BITS = 2  # a tile has 4 x 4 pixels
CLUSTER_BITS = 6  # a cluster has 64 faces
DEPTH_MARGIN = 1e-6  # depth values are float32

_HALF, _ONE, _ZERO = np.float32(0.5), np.float32(1.0), np.float32(0.0)
_SUB, _GUARD = np.float32(SUBPIXELS), np.float32(GUARD_PX)

_jit: Any = kernel()
# For loops over finite numbers: they vectorise. Sums keep their order, and nothing is contracted: a
# vertex has the same place in every cluster, in a vector or beside it.
_jit_lanes: Any = kernel(fastmath={"nsz", "nnan"})


@_jit_lanes
def _project(begin, end, vertices, camera, screen, depths, bounds):
    """Vertices ``begin`` to ``end`` of ``vertices`` (3, V): set ``screen`` (2, V), ``depths`` (V,).

    ``screen`` is in 1/256 px. A depth value is 1/z under perspective, -z in parallel projection:
    linear in the picture, and the greater the nearer. Widens ``bounds`` (left, top, right, bottom)
    in 1/256 px; returns whether any vertex needs clipping.
    """
    x, y, z = vertices[0, begin:end], vertices[1, begin:end], vertices[2, begin:end]
    u, v, d = screen[0, begin:end], screen[1, begin:end], depths[begin:end]
    r00, r01, r02 = np.float32(camera[0]), np.float32(camera[1]), np.float32(camera[2])
    r10, r11, r12 = np.float32(camera[3]), np.float32(camera[4]), np.float32(camera[5])
    r20, r21, r22 = np.float32(camera[6]), np.float32(camera[7]), np.float32(camera[8])
    tx, ty, tz = np.float32(camera[9]), np.float32(camera[10]), np.float32(camera[11])
    fx, fy, near = np.float32(camera[12]), np.float32(camera[13]), np.float32(camera[16])
    cx, cy = np.float32(camera[14]), np.float32(camera[15])
    perspective = near > _ZERO
    nearest = _ONE / near if perspective else np.float32(np.inf)
    for i in range(end - begin):
        distance = r20 * x[i] + r21 * y[i] + r22 * z[i] + tz
        d[i] = _ONE / max(distance, near) if perspective else -distance
    left, right, off = bounds[0], bounds[2], np.int32(0)
    for i in range(end - begin):
        across = fx * (r00 * x[i] + r01 * y[i] + r02 * z[i] + tx)
        place = across * (d[i] if perspective else _ONE) + cx
        outside = (abs(place) > _GUARD) | (d[i] >= nearest)
        snapped = np.int32(np.floor((_ZERO if outside else place) * _SUB + _HALF))
        off |= np.int32(1) if outside else np.int32(0)
        left, right = min(left, snapped), max(right, snapped)
        u[i] = OFF_SCREEN if outside else snapped
    top, bottom = bounds[1], bounds[3]
    for i in range(end - begin):
        down = fy * (r10 * x[i] + r11 * y[i] + r12 * z[i] + ty)
        place = down * (d[i] if perspective else _ONE) + cy
        outside = abs(place) > _GUARD
        snapped = np.int32(np.floor((_ZERO if outside else place) * _SUB + _HALF))
        off |= np.int32(1) if outside else np.int32(0)
        top, bottom = min(top, snapped), max(bottom, snapped)
        v[i] = OFF_SCREEN if outside else snapped
    bounds[0], bounds[1], bounds[2], bounds[3] = left, top, right, bottom
    return off > 0


@_jit
def _project_clusters(wanted, cluster_start, vertices, camera, screen, depths, bounds):
    """Project the clusters whose ``wanted`` is true, neighbours at one go."""
    any_off, cluster, count = False, 0, wanted.shape[0]
    while cluster < count:
        end = cluster
        while end < count and wanted[end]:
            end += 1
        if end > cluster:
            any_off |= _project(
                cluster_start[cluster], cluster_start[end], vertices, camera, screen, depths, bounds
            )
        cluster = end + 1
    return any_off


@_jit
def _list_unseen(oldest, wanted, seen, listed):
    """List the faces of the ``wanted`` clusters that were last seen before ``oldest``."""
    count = 0
    for cluster in range(wanted.shape[0]):
        if not wanted[cluster]:
            continue
        begin = cluster << CLUSTER_BITS
        for face in range(begin, min(begin + (1 << CLUSTER_BITS), seen.shape[0])):
            listed[count] = face
            count += 1 if seen[np.uint32(face)] < oldest else 0
    return count


@_jit
def _is_behind(left, top, right, bottom, nearest, box, tiles):
    """Whether all that ``tiles`` has on the pixels up to ``right``, ``bottom`` is nearer.

    Outside ``box`` nothing is drawn yet.
    """
    if left < box[0] or top < box[1] or right >= box[2] or bottom >= box[3]:
        return False
    for row in range(top >> TILE_BITS, (bottom >> TILE_BITS) + 1):
        for column in range(left >> TILE_BITS, (right >> TILE_BITS) + 1):
            if tiles[np.uint32(row), np.uint32(column)] <= nearest:
                return False
    return True


@_jit_lanes
def _find_farthest(box, depth, row_least, tiles):
    """The farthest depth value of each tile that meets ``box``, -inf where one is empty.

    ``row_least`` is room for a row of ``depth``.
    """
    left, top, right, bottom = box
    size = 1 << TILE_BITS
    begin, end = left >> TILE_BITS, (right + size - 1) >> TILE_BITS
    columns = depth.shape[1]
    for tile_row in range(top >> TILE_BITS, (bottom + size - 1) >> TILE_BITS):
        first = tile_row * size
        least = row_least[begin * size : min(end * size, columns)]
        values = depth[first, begin * size : min(end * size, columns)]
        for i in range(least.shape[0]):
            least[i] = values[i]
        for row in range(first + 1, min(first + size, depth.shape[0])):
            values = depth[row, begin * size : min(end * size, columns)]
            for i in range(least.shape[0]):
                least[i] = min(least[i], values[i])
        for column in range(begin, end):
            i = (column - begin) * size
            tiles[tile_row, column] = min(
                min(least[i], least[i + 1]), min(least[i + 2], least[i + 3])
            )


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


@_jit_lanes
def _has_unhidden(begin, end, screen, depths, width, height, box, tiles):
    """Whether faces of the vertices ``begin`` to ``end`` may be seen: what their bounding box in
    the picture and the nearest of them tell.
    """
    u, v, d = screen[0, begin:end], screen[1, begin:end], depths[begin:end]
    left, right, top, bottom, nearest = u[0], u[0], v[0], v[0], d[0]
    for i in range(1, end - begin):
        left, right = min(left, u[i]), max(right, u[i])
        top, bottom = min(top, v[i]), max(bottom, v[i])
        nearest = max(nearest, d[i])
    if min(left, top) == OFF_SCREEN:
        return True
    left, right = max((left + 127) >> 8, 0), min((right - 128) >> 8, width - 1)
    top, bottom = max((top + 127) >> 8, 0), min((bottom - 128) >> 8, height - 1)
    nearest += np.float32(DEPTH_MARGIN) * abs(nearest)
    return (
        left <= right
        and top <= bottom
        and not _is_behind(left, top, right, bottom, nearest, box, tiles)
    )


@_jit
def _pixel_box(bounds, any_off, width, height):
    """All pixels that the bounds touch, with a pixel to spare for snapping; empty if outside."""
    if any_off:
        return 0, 0, width, height
    if bounds[0] > bounds[2]:
        return 0, 0, 0, 0
    left = min(max((bounds[0] >> 8) - 1, 0), width)
    top = min(max((bounds[1] >> 8) - 1, 0), height)
    right = max(min((bounds[2] >> 8) + 2, width), left)
    bottom = max(min((bounds[3] >> 8) + 2, height), top)
    return left, top, right, bottom


@_jit
def list_recent(
    oldest,
    cluster_seen,
    seen,
    wanted,
    vertices,
    cluster_start,
    camera,
    bounds,
    listed,
    screen,
    depths,
):
    """List the faces that were seen at ``oldest`` or later, and project all of their clusters.

    ``seen`` (F,) and ``cluster_seen`` (C,) say when; ``listed`` (F + 1,) takes the faces.
    ``camera`` is (17,): camera_from_model's rotation, row by row, and translation; fx, fy, cx, cy;
    the least z under perspective, 0 for parallel projection. ``bounds`` (4,), of what is
    projected, is set, in 1/256 px.

    Returns how many faces are listed, and whether any vertex needs clipping.
    """
    most = np.int32(2**31 - 1)
    bounds[0], bounds[1], bounds[2], bounds[3] = most, most, -most, -most
    for cluster in range(wanted.shape[0]):
        wanted[cluster] = cluster_seen[cluster] >= oldest
    any_off = _project_clusters(wanted, cluster_start, vertices, camera, screen, depths, bounds)
    count = 0
    for cluster in range(wanted.shape[0]):
        if not wanted[cluster]:
            continue
        begin = cluster << CLUSTER_BITS
        for face in range(begin, min(begin + (1 << CLUSTER_BITS), seen.shape[0])):
            listed[count] = face
            count += 1 if seen[np.uint32(face)] >= oldest else 0
    return count, any_off


@_jit
def list_others(
    any_off,
    cluster_box,
    row_least,
    tiles,
    depth,
    width,
    oldest,
    cluster_seen,
    seen,
    wanted,
    vertices,
    cluster_start,
    camera,
    bounds,
    listed,
    screen,
    depths,
):
    """List what else may be seen, after what ``list_recent`` listed was drawn into ``depth``.

    ``any_off`` is what that told; from ``oldest`` on the arguments are the same.

    Returns how many faces are listed, whether any vertex needs clipping, and the box (left, top,
    right, bottom), whole px, ends excluded, outside which nothing is drawn.
    """
    height = depth.shape[0]
    box = _pixel_box(bounds, any_off, width, height)
    _find_farthest(box, depth, row_least, tiles)
    for cluster in range(wanted.shape[0]):
        wanted[cluster] = cluster_seen[cluster] < oldest and _may_be_seen(
            cluster, cluster_box, camera, box, width, height, tiles
        )
    any_off |= _project_clusters(wanted, cluster_start, vertices, camera, screen, depths, bounds)
    for cluster in range(wanted.shape[0]):
        if wanted[cluster]:
            begin, end = cluster_start[cluster], cluster_start[cluster + 1]
            wanted[cluster] = _has_unhidden(begin, end, screen, depths, width, height, box, tiles)
        else:
            wanted[cluster] = cluster_seen[cluster] >= oldest
    count = _list_unseen(oldest, wanted, seen, listed)
    return count, any_off, _pixel_box(bounds, any_off, width, height)
