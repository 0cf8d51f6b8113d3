"""All that is done for one pose, in two calls. Arrays in, arrays out, without the GIL.

Between calls a thread needs the interpreter's lock, and who waits for it is woken late: with a call
for each part of the work two threads were no quicker than one on the pictures of coarse levels.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.render.software.kernel_attributes import fill_planes
from poseviewer.render.software.kernel_buffers import clear
from poseviewer.render.software.kernel_compiler import kernel
from poseviewer.render.software.kernel_coverage import draw_listed
from poseviewer.render.software.kernel_moments import add_surroundings, as_moments, of_classes
from poseviewer.render.software.kernel_pieces import cut, draw_pieces
from poseviewer.render.software.kernel_structure import class_sums, edge_sums
from poseviewer.render.software.kernel_sums import accumulate
from poseviewer.render.software.kernel_visibility import CLUSTER_BITS, list_others, list_recent

MEMORY = 8
"""A face seen in one of so many last pictures is drawn first."""

_jit: Any = kernel()


@_jit
def rasterise(now, drawn, surface, camera, weighs, two_sided, width, memory, room, picture):
    """Draw a model into ``picture`` (depth, ids): first what was seen a moment ago, then what is
    not behind it. Returns the box outside which it is empty.

    Args:
        now: the number of this picture, one more than that of the last.
        drawn: what the last call returned.
        surface: (vertices, faces, corners, cluster_start, cluster_box) of a ``Surface``.
        camera: see ``list_recent``.
        weighs: see ``draw_listed``.
        two_sided: whether faces are seen from behind, too.
        width: of the picture; its arrays may have more columns.
        memory: (seen, cluster_seen): the number of the picture that showed each, see ``clear``.
        room: (wanted, bounds, listed, screen, depths, planes, painting, chunk, row_least, tiles).
        picture: see ``draw_listed``.
    """
    vertices, faces, corners, cluster_start, cluster_box = surface
    wanted, bounds, listed, screen, depths, planes, painting, chunk, row_least, tiles = room
    seen, cluster_seen = memory
    depth, ids = picture
    clear(drawn, now, CLUSTER_BITS, depth, ids, seen, cluster_seen)
    oldest, seen, cluster_seen = now - MEMORY, seen[:-1], cluster_seen[:-1]
    listing = (
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
    )
    count, any_off = list_recent(*listing)
    drawing = listed, screen, depths, planes, painting, chunk
    _draw(count, vertices, faces, corners, camera, weighs, two_sided, width, drawing, picture)
    count, any_off, box = list_others(
        any_off, cluster_box, row_least, tiles, depth, width, *listing
    )
    _draw(count, vertices, faces, corners, camera, weighs, two_sided, width, drawing, picture)
    return box


@_jit
def _draw(count, vertices, faces, corners, camera, weighs, two_sided, width, drawing, picture):
    """Draw the first ``count`` of the listed faces."""
    listed, screen, depths, planes, painting, chunk = drawing
    depth, ids = picture
    large = draw_listed(
        count,
        listed,
        chunk,
        faces,
        corners,
        weighs,
        screen,
        depths,
        planes,
        painting,
        two_sided,
        width,
        depth,
        ids,
    )
    if large > 0:
        owners, places, values = cut(
            large, listed, faces, corners, vertices, camera, screen, depths, planes, painting
        )
        draw_pieces(owners, places, values, two_sided, width, depth, ids)


@_jit
def sum_up(box, ids, of_faces, of_model, grey, photo, photo_origin, model, room, region, rotation):
    """The moments of photo and model: pixels, their weight, mean (n + m,) and covariance.

    ``region`` is (whether P is the whole of it, and if so the ``RegionSums``); ``rotation`` (3, 3)
    turns normals into the camera's frame. The others are as for ``accumulate``.
    """
    n = photo_origin.shape[0]
    size = n + model
    first, second, origin = np.zeros(size), np.zeros((size, size)), np.zeros(size)
    for i in range(n):
        origin[i] = photo_origin[i]
    pixels, weight = accumulate(
        box, ids, of_faces, of_model, grey, photo, origin, model, room, first, second
    )
    is_whole, region_weight, region_first, region_second = region
    if is_whole:
        add_surroundings(n, weight, first, second, origin, region_first, region_second)
        weight = region_weight
    if weight <= 0.0:
        return 0, 0.0, np.zeros(size), np.zeros((size, size))
    mean, covariance = as_moments(n, weight, first, second, origin, rotation)
    return pixels, weight, mean, covariance


@_jit
def compare(
    box,
    ids,
    of_faces,
    of_model,
    grey,
    room,
    planes,
    sums,
    edges,
    photo,
    fixed,
    rotation,
    noise,
    taps,
):
    """The moments of classes, and the sums of edges: pixels, mean, covariance, likeness, length.

    ``planes`` is (spans, planes) and ``room`` as for ``fill_planes``, ``sums`` (run, joint, second)
    as for ``class_sums``, ``edges`` (room, across, target) as for ``edge_sums``, ``photo``
    (channels, labels, weights), and ``fixed`` (weight, mean, covariance) what no pose alters.
    """
    spans, out = planes
    run, joint, second = sums
    channels, labels, weights = photo
    rows, across, target = edges
    fill_planes(box, ids, of_faces, of_model, grey, room, spans, out)
    pixels = class_sums(spans, out, weights, channels, labels, rotation, run, joint, second)
    likeness, length = edge_sums(spans, out, noise, taps, weights, target, rows, across)
    mean, covariance = of_classes(fixed[0], fixed[1], fixed[2], joint, second)
    return pixels, mean, covariance, likeness, length
