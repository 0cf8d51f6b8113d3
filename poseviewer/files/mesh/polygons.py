"""Polygons and strips into triangles."""

import numpy as np
from numpy.typing import NDArray

CONCAVE = -1e-9
"""Cross product at a corner, in the whole polygon's, below which the corner points inwards."""


def polygon_corners(counts: NDArray, points: NDArray) -> NDArray[np.int64]:
    """(T, 3) corners of the triangles that polygons with ``counts`` corners (N,) at ``points``
    (C, 3) fall into: fans of convex polygons, ears of others.

    Corners are numbered through all polygons; polygons of fewer than 3 corners give none.
    """
    counts = np.asarray(counts, dtype=np.int64)
    triangles = np.maximum(counts - 2, 0)
    ends = np.cumsum(triangles)
    starts = np.repeat(np.cumsum(counts) - counts, triangles)
    step = np.arange(len(starts)) - np.repeat(ends - triangles, triangles)
    corners = np.stack([starts, starts + step + 1, starts + step + 2], axis=1)
    for polygon in np.flatnonzero(counts > 3)[_is_concave(counts, points)]:
        first = int(counts[:polygon].sum())
        flat = _flattened(points[first : first + counts[polygon]])
        corners[ends[polygon] - triangles[polygon] : ends[polygon]] = first + _ears(flat)
    return corners


def strip_corners(indices: NDArray) -> NDArray[np.int64]:
    """(T, 3) triangles of strips with -1 between them; every second one is turned."""
    indices = np.asarray(indices, np.int64)
    windows = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    ends = np.flatnonzero(indices < 0)
    start = np.concatenate([[0], ends + 1])
    step = np.arange(len(windows)) - start[np.searchsorted(ends, np.arange(len(windows)))]
    windows[step % 2 == 1] = windows[step % 2 == 1][:, [1, 0, 2]]
    return windows[(windows >= 0).all(axis=1)]


def _is_concave(counts: NDArray, points: NDArray) -> NDArray[np.bool_]:
    """Whether a corner points inwards, of each polygon of more than 3 corners."""
    large = np.repeat(counts > 3, counts)
    points, counts = points[large], counts[counts > 3]
    if not len(counts):
        return np.zeros(0, bool)
    starts = np.cumsum(counts) - counts
    after = np.arange(1, len(points) + 1)
    after[starts + counts - 1] = starts
    before = np.empty_like(after)
    before[after] = np.arange(len(points))
    centred = points - np.repeat(points[starts], counts, axis=0)
    normals = np.add.reduceat(np.cross(centred, centred[after]), starts)
    turns = np.cross(points - points[before], points[after] - points)
    each = np.einsum("cd,cd->c", turns, np.repeat(normals, counts, axis=0))
    return np.minimum.reduceat(each, starts) < CONCAVE * np.einsum("nd,nd->n", normals, normals)


def _flattened(points: NDArray) -> NDArray:
    """(n, 2): a polygon in its own plane, counter-clockwise."""
    centred = points - points[0]
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    x = np.cross(axis, normal)
    return centred @ np.stack([x, np.cross(normal, x)], axis=1)


def _ears(flat: NDArray) -> NDArray[np.int64]:
    """(n - 2, 3): triangles of a simple polygon (Meisters 1975); of another, a fan at the end."""
    left, triangles, at, tried = list(range(len(flat))), [], 0, 0
    while len(left) > 3 and tried < len(left):
        at %= len(left)
        ear = [left[at - 1], left[at], left[(at + 1) % len(left)]]
        corners = flat[ear]
        if _side(corners[0], corners[1], corners[2]) > 0.0 and not _holds(corners, flat[left]):
            triangles.append(ear)
            del left[at]
            at, tried = at - 1, 0
        else:
            at, tried = at + 1, tried + 1
    triangles += [[left[0], left[i], left[i + 1]] for i in range(1, len(left) - 1)]
    return np.array(triangles)


def _side(a: NDArray, b: NDArray, points: NDArray) -> NDArray:
    """Twice the area between a line and points: above 0 on its left."""
    ahead, aside = b - a, points - a
    return ahead[..., 0] * aside[..., 1] - ahead[..., 1] * aside[..., 0]


def _holds(corners: NDArray, points: NDArray) -> bool:
    """Whether a triangle holds one of the points, but for its own corners."""
    inside = np.ones(len(points), bool)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        inside &= _side(corners[first], corners[second], points) >= 0.0
    own = (points[:, None] == corners).all(axis=2).any(axis=1)
    return bool((inside & ~own).any())
