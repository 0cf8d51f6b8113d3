"""What is marked on the maps of the loss: the pose, the search's simplex and the way it went."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from poseviewer.fit.landscape import Slice
from poseviewer.geometry.arrays import FloatArray, frozen_array

LONGEST_TRAIL = 60
"""Points of a trail that are drawn, at most, on each map."""


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Places in the space of the chart's d numbers."""

    pose: FloatArray
    """(d,): the current pose."""
    simplex: FloatArray | None = None
    """(d + 1, d): the corners of the search's simplex."""
    trail: FloatArray | None = None
    """(t, d): the poses that the search came through, the oldest first."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen_array(self.pose, (-1,)))
        for name in ("simplex", "trail"):
            points = getattr(self, name)
            if points is not None:
                object.__setattr__(self, name, frozen_array(points, (-1, len(self.pose))))


def on_map(piece: Slice, parameters: FloatArray) -> FloatArray:
    """(..., 2): where numbers (..., d) lie on a slice's map, from its left and lower border, as
    shares of its width and height; beyond 0 and 1 they lie beside it.
    """
    parameters = np.asarray(parameters, dtype=float)
    x, y = piece.first_values, piece.second_values
    u = (parameters[..., piece.first] - x[0]) / (x[-1] - x[0])
    v = (parameters[..., piece.second] - y[0]) / (y[-1] - y[0])
    return np.stack([u, v], axis=-1)


def simplex_outline(piece: Slice, simplex: FloatArray) -> FloatArray:
    """(h, 2): the hull of a simplex's corners (d + 1, d) on the map, corner by corner."""
    corners = np.clip(on_map(piece, simplex), -10.0, 10.0).astype(np.float32)
    return cv2.convexHull(corners)[:, 0].astype(float)


def short_trail(trail: FloatArray) -> FloatArray:
    """(at most LONGEST_TRAIL, d): the trail (t, d) thinned evenly; its ends stay."""
    kept = np.linspace(0, len(trail) - 1, min(len(trail), LONGEST_TRAIL)).round().astype(int)
    return trail[kept]
