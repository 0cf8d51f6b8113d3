"""Small 1-D and 2-D curve helpers for the demo car: splines, rounded polygons, distances.

All lengths are metres. Signed distances are negative inside.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

Points = list[tuple[float, float]]


class Spline:
    """Natural cubic spline through `(t, value)` points, extended straight beyond its ends."""

    def __init__(self, points: Points) -> None:
        self.t, self.v = np.array(sorted(points), dtype=float).T
        h = np.diff(self.t)
        n = len(self.t)
        system, right = np.eye(n), np.zeros(n)
        for i in range(1, n - 1):
            system[i, i - 1 : i + 2] = h[i - 1], 2 * (h[i - 1] + h[i]), h[i]
            right[i] = 6 * (
                (self.v[i + 1] - self.v[i]) / h[i] - (self.v[i] - self.v[i - 1]) / h[i - 1]
            )
        self.m = np.linalg.solve(system, right)
        self.h = h

    def __call__(self, t: np.ndarray | float) -> np.ndarray:
        """Value at `t`."""
        t = np.asarray(t, dtype=float)
        inside = np.clip(t, self.t[0], self.t[-1])
        i = np.clip(np.searchsorted(self.t, inside) - 1, 0, len(self.h) - 1)
        h, a, b = self.h[i], self.t[i + 1] - inside, inside - self.t[i]
        m0, m1, v0, v1 = self.m[i], self.m[i + 1], self.v[i], self.v[i + 1]
        value = (m0 * a**3 + m1 * b**3) / (6 * h)
        value += (v0 / h - m0 * h / 6) * a + (v1 / h - m1 * h / 6) * b
        slope = (m1 * b**2 - m0 * a**2) / (2 * h) + (v1 - v0) / h - (m1 - m0) * h / 6
        return value + slope * (t - inside)


def rounded_polygon(corners: Points, radius: float | list[float], steps: int = 7) -> np.ndarray:
    """Closed outline (n,2) of a polygon whose corners are replaced by smooth curves.

    `radius` is the length cut from both edges at a corner, one for all or one each.
    """
    p = np.array(corners, dtype=float)
    radii = np.full(len(p), radius) if np.isscalar(radius) else np.array(radius, dtype=float)
    new = (np.abs(p - np.roll(p, 1, axis=0)) > 1e-9).any(axis=1)  # a mirrored shape may repeat one
    p, radii = p[new], radii[new]
    s = np.linspace(0, 1, steps)[:, None]
    out = []
    for i, corner in enumerate(p):
        to_last, to_next = p[i - 1] - corner, p[(i + 1) % len(p)] - corner
        for_last = min(radii[i] / np.linalg.norm(to_last), 0.49)
        for_next = min(radii[i] / np.linalg.norm(to_next), 0.49)
        a, b = corner + to_last * for_last, corner + to_next * for_next
        out.append((1 - s) ** 2 * a + 2 * s * (1 - s) * corner + s**2 * b)
    return np.concatenate(out)


def polyline_distance(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of 2-D points (n,2) to an open polyline (m,2)."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(line):
        edge = b - a
        length2 = float(edge @ edge)
        if length2 < 1e-16:
            continue
        t = np.clip((points - a) @ edge / length2, 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - t[:, None] * edge, axis=1))
    return best


def polyline_side(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance to an open polyline with the sign of its side; meant for points near it."""
    best, sign = np.full(len(points), np.inf), np.ones(len(points))
    for a, b in pairwise(line):
        edge = b - a
        t = np.clip((points - a) @ edge / float(edge @ edge), 0, 1)
        distance = np.linalg.norm(points - a - t[:, None] * edge, axis=1)
        side = edge[0] * (points[:, 1] - a[1]) - edge[1] * (points[:, 0] - a[0])
        sign = np.where(distance < best, np.where(side < 0, -1.0, 1.0), sign)
        best = np.minimum(best, distance)
    return best * sign


def polygon_distance(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Signed distance of 2-D points (n,2) to a closed outline (m,2), negative inside."""
    closed = np.vstack([outline, outline[:1]])
    distance = polyline_distance(points, closed)
    inside = np.zeros(len(points), dtype=bool)
    for a, b in pairwise(closed):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        dz = b[1] - a[1] if b[1] != a[1] else 1.0
        at = a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / dz
        inside ^= crosses & (points[:, 0] < at)
    return np.where(inside, -distance, distance)


def smooth_line(points: Points, steps: int = 8) -> np.ndarray:
    """Open Catmull-Rom curve (n,2) through 2-D points."""
    p = np.array(points, dtype=float)
    p = np.vstack([2 * p[0] - p[1], p, 2 * p[-1] - p[-2]])
    s = np.linspace(0, 1, steps, endpoint=False)[:, None]
    out = [
        0.5
        * (
            2 * b
            + (c - a) * s
            + (2 * a - 5 * b + 4 * c - d) * s**2
            + (3 * b - a - 3 * c + d) * s**3
        )
        for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True)
    ]
    return np.vstack([*out, p[-2:-1]])
