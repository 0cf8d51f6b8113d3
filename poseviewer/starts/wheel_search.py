"""Wheels looked for in a rectangle of a photo: ellipses in pairs that a car can have.

A proposal, not a verdict: what is found is to be looked at, and other starts are there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import QuickStartError
from poseviewer.starts.ellipse_search import Supported, find_ellipses
from poseviewer.vehicle.ellipses import Ellipse

MOST_PAIRS = 10


@dataclass(frozen=True, slots=True)
class FoundPair:
    """Two ellipses that may be the wheels of one side, the left one in the photo first."""

    left: Ellipse
    right: Ellipse
    score: float
    """Mean support of both, less what sets them apart."""


def find_wheel_pairs(
    grey: NDArray[np.float32], rectangle: tuple[int, int, int, int]
) -> tuple[FoundPair, ...]:
    """The likeliest pairs in a rectangle (left, top, width, height) of a photo (height, width) in
    [0, 1], the best first.

    Raises:
        QuickStartError: the rectangle is not in the photo, or shows no two such ellipses.
    """
    left, top, width, height = rectangle
    inside = grey[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
    if min(inside.shape) < 16:
        raise QuickStartError(
            f"The rectangle {left},{top},{width},{height} has no 16x16 px in the photo of "
            f"{grey.shape[1]}x{grey.shape[0]} px; give left,top,width,height around the car."
        )
    corner = max(left, 0), max(top, 0)
    ellipses = [_shifted(found, corner) for found in find_ellipses(inside)]
    pairs = [pair for two in combinations(ellipses, 2) if (pair := _pair(*two)) is not None]
    if not pairs:
        raise QuickStartError(
            f"No two wheels were found in {left},{top},{width},{height}; lay the rectangle closer "
            "about the car, or outline the wheels yourself (--wheels)."
        )
    return tuple(sorted(pairs, key=lambda pair: -pair.score)[:MOST_PAIRS])


def _pair(one: Supported, other: Supported) -> FoundPair | None:
    """Two ellipses as a pair of wheels; None for two that no car has."""
    (a, support_a), (b, support_b) = sorted(
        ((found.ellipse, found.support) for found in (one, other)), key=lambda found: found[0].cx
    )
    across, down = b.cx - a.cx, abs(b.cy - a.cy)
    size = 0.5 * (a.a + b.a)
    taller = abs(float(np.log((a.a * a.b) / (b.a * b.b)))) / 2.0
    flatter = abs(a.b / a.a - b.b / b.a)
    base = float(np.hypot(across, down)) / size
    if not 2.5 <= base <= 14.0 or down > 0.6 * across or taller > 0.6 or flatter > 0.35:
        return None
    return FoundPair(a, b, 0.5 * (support_a + support_b) - 0.3 * taller - 0.3 * flatter)


def _shifted(found: Supported, corner: tuple[int, int]) -> Supported:
    ellipse = found.ellipse
    x, y = ellipse.cx + corner[0], ellipse.cy + corner[1]
    return replace(found, ellipse=replace(ellipse, cx=x, cy=y))
