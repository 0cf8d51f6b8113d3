"""Polygons and strips into triangles."""

import numpy as np
from numpy.typing import NDArray

TURNED = -1e-9
"""Area of a triangle, in that of its polygon, below which it faces the other way."""


def polygon_corners(counts: NDArray, points: NDArray) -> NDArray[np.int64]:
    """Cut polygons of ``counts`` (N,) corners at ``points`` (C, 3) into triangles' corners (T, 3).

    They are fans, or ears where a fan leaves the polygon; corners count through all polygons.
    """
    counts = np.asarray(counts, dtype=np.int64)
    triangles, firsts = np.maximum(counts - 2, 0), np.cumsum(counts) - counts
    which, ends = np.repeat(np.arange(len(counts)), triangles), np.cumsum(triangles)
    step = np.arange(len(which)) - np.repeat(ends - triangles, triangles)
    corners = firsts[which][:, None] + np.stack([0 * step, step + 1, step + 2], axis=1)
    if counts.max(initial=0) <= 3:
        return corners
    a, b, c = points[corners].swapaxes(0, 1)
    areas = np.cross(b - a, c - a)  # a fan's add up to the polygon's, whatever its shape
    wholes = np.stack([np.bincount(which, axis, len(counts)) for axis in areas.T], axis=1)
    shares = np.einsum("td,td->t", areas, wholes[which])
    turned = shares < TURNED * np.einsum("nd,nd->n", wholes, wholes)[which]
    for polygon in np.unique(which[turned]):
        own = firsts[polygon] + np.arange(int(counts[polygon]))
        ears = _ears(_to_plane(points[own], wholes[polygon]))
        corners[ends[polygon] - triangles[polygon] : ends[polygon]] = own[ears]
    return corners


def strip_corners(indices: NDArray) -> NDArray[np.int64]:
    """Return triangles (T, 3) of strips with -1 between them; every second one is turned."""
    indices = np.asarray(indices, np.int64)
    windows = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    ends = np.flatnonzero(indices < 0)
    start = np.concatenate([[0], ends + 1])
    step = np.arange(len(windows)) - start[np.searchsorted(ends, np.arange(len(windows)))]
    windows[step % 2 == 1] = windows[step % 2 == 1][:, [1, 0, 2]]
    return windows[(windows >= 0).all(axis=1)]


def _to_plane(points: NDArray, normal: NDArray) -> NDArray:
    """Project a polygon into its own plane (n, 2), counter-clockwise."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    return (points - points[0]) @ np.stack([x, np.cross(normal, x)], axis=1)


def _ears(flat: NDArray) -> NDArray[np.int64]:
    """Cut ears off a simple polygon (Meisters 1975), (n - 2, 3); others end in a fan."""
    left = list(range(len(flat)))
    triangles = []
    at = 0
    tried = 0
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
    inside = np.ones(len(points), bool)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        inside &= _side(corners[first], corners[second], points) >= 0.0
    return bool((inside & ~(points[:, None] == corners).all(axis=2).any(axis=1)).any())
