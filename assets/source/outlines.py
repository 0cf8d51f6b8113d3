"""Outlines of windows, lamps and grilles, each in the view in which `panels` cuts it. Metres."""

from __future__ import annotations

import numpy as np
from curves import Points, rounded_polygon


def mirror(points: Points) -> Points:
    """Outline symmetric about the middle line, from its half with y > 0."""
    return [*points, *((-y, z) for y, z in reversed(points))]


DAYLIGHT = rounded_polygon(
    [
        (0.755, 0.952),
        (0.49, 1.145),
        (0.225, 1.315),
        (0.05, 1.366),
        (-0.45, 1.384),
        (-0.95, 1.371),
        (-1.33, 1.325),
        (-1.475, 1.125),
        (-1.05, 0.978),
        (-0.3, 0.962),
    ],
    [0.03, 0.12, 0.12, 0.15, 0.15, 0.15, 0.07, 0.04, 0.10, 0.15],
)
SCREEN = rounded_polygon(
    mirror(
        [(0.0, 1.388), (0.28, 1.384), (0.525, 1.362), (0.668, 0.995), (0.655, 0.965), (0.3, 0.952)]
    ),
    [0.1, 0.1, 0.05, 0.02, 0.03, 0.1, 0.1, 0.03, 0.02, 0.05, 0.1, 0.1],
)
REAR_GLASS = rounded_polygon(
    mirror([(0.25, 1.352), (0.515, 1.325), (0.635, 1.075), (0.60, 1.045), (0.3, 1.03)]),
    [0.1, 0.05, 0.04, 0.04, 0.1, 0.1, 0.04, 0.04, 0.05, 0.1],
)
HEADLAMP = rounded_polygon(
    [
        (-0.905, 0.655),
        (-0.90, 0.632),
        (-0.64, 0.598),
        (-0.40, 0.655),
        (-0.255, 0.745),
        (-0.44, 0.732),
        (-0.64, 0.710),
        (-0.80, 0.682),
    ],
    [0.01, 0.02, 0.10, 0.06, 0.012, 0.08, 0.08, 0.05],
)
TAILLAMP = rounded_polygon(
    [
        (-1.09, 0.865),
        (-1.07, 0.825),
        (-0.80, 0.775),
        (-0.68, 0.785),
        (-0.545, 0.895),
        (-0.60, 0.915),
        (-0.80, 0.912),
        (-1.04, 0.895),
    ],
    [0.02, 0.03, 0.05, 0.04, 0.02, 0.03, 0.08, 0.04],
)
UPPER_GRILLE = rounded_polygon(
    mirror([(0.25, 0.655), (0.435, 0.648), (0.415, 0.612), (0.25, 0.585)]),
    [0.05, 0.012, 0.02, 0.08, 0.08, 0.02, 0.012, 0.05],
)
INTAKE = rounded_polygon(mirror([(0.50, 0.405), (0.43, 0.285)]), 0.035)
FOG_POCKET = rounded_polygon([(-0.80, 0.405), (-0.55, 0.43), (-0.60, 0.345), (-0.79, 0.31)], 0.03)
REFLECTOR = rounded_polygon([(-1.05, 0.47), (-0.82, 0.49), (-0.82, 0.515), (-1.05, 0.50)], 0.01)
VALANCE = rounded_polygon(mirror([(0.52, 0.39), (0.62, 0.10)]), 0.05)


def disc(field_axes: np.ndarray) -> np.ndarray:
    """Polygon of a disc given as (across, z, radius)."""
    a, z, r = field_axes
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return np.stack([a + r * np.cos(t), z + r * np.sin(t)], 1)
