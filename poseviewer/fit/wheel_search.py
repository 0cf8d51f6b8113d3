"""Wheels looked for in a rectangle of a photo: ellipses on its edges, in pairs that a car can have.

A proposal, not a verdict: what is found is to be looked at, and other starts are there.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.ellipses import Ellipse

SMALLEST, LARGEST = 0.05, 0.2
"""Half axis of a wheel, as a share of the rectangle's width."""
LEAST_ASPECT = 0.25
REACH_PX = 1.5
"""An edge supports an ellipse within so many px."""
LEAST_SUPPORT = 0.45
"""Share of an ellipse's outline that lies on edges across which the photo's slope points."""
OUTLINE = 90
MOST_ELLIPSES, MOST_PAIRS = 24, 6
WORKING_WIDTH = 640
"""px: a wider rectangle is looked at smaller, where textures are no edges any more."""


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
    factor = min(1.0, WORKING_WIDTH / inside.shape[1])
    small = cv2.resize(inside, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    shift = np.array([max(left, 0), max(top, 0)], float)
    ellipses = [_back(e, factor, shift) for e in _ellipses(np.asarray(small, np.float32))]
    pairs = [pair for two in combinations(ellipses, 2) if (pair := _pair(*two)) is not None]
    if not pairs:
        raise QuickStartError(
            f"No two wheels were found in {left},{top},{width},{height}; lay the rectangle closer "
            "about the car, or outline the wheels yourself (--wheels)."
        )
    return tuple(sorted(pairs, key=lambda pair: -pair.score)[:MOST_PAIRS])


Supported = tuple[Ellipse, float]


def _ellipses(small: NDArray[np.float32]) -> list[Supported]:
    """The best supported ellipses, each with its support; of alike ones the best."""
    smooth = cv2.GaussianBlur(small, (0, 0), 1.0)
    slopes = np.stack([cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)])
    steep = np.hypot(*slopes)
    high = float(np.quantile(steep, 0.93))
    levels = np.rint(255 * smooth).astype(np.uint8)
    edges = cv2.Canny(levels, 255 * high * 0.4, 255 * high, apertureSize=3, L2gradient=True)
    away = cv2.distanceTransform(255 - edges, cv2.DIST_L2, 5)
    found: list[Supported] = []
    for ellipse in _proposals(edges, small.shape[1]):
        support = _support(ellipse, away, slopes)
        if support >= LEAST_SUPPORT:
            found.append((ellipse, support))
    found.sort(key=lambda one: -one[1] * one[0].a ** 0.25)
    kept: list[Supported] = []
    for ellipse, support in found:
        if all(_apart(ellipse, other) for other, _ in kept):
            kept.append((ellipse, support))
    return kept[:MOST_ELLIPSES]


def _proposals(edges: NDArray, width: int) -> list[Ellipse]:
    """Ellipses through pieces of edges, and through pieces that lie about the same middle."""
    contours, _ = cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    pieces = [c[:, 0].astype(np.float32) for c in contours if len(c) >= 12]
    low, high = SMALLEST * width, LARGEST * width
    singles = [e for piece in pieces if (e := _fitted(piece, low, high)) is not None]
    joined = []
    for ellipse in singles:
        near = [p for p in pieces if np.median(np.abs(ellipse.distances(p))) < 2.5]
        if len(near) > 1:
            points = np.concatenate(near)
            points = points[np.abs(ellipse.distances(points)) < 4.0]
            again = _fitted(points, low, high)
            if again is not None:
                joined.append(again)
    return [*singles, *joined]


def _fitted(points: NDArray, low: float, high: float) -> Ellipse | None:
    if len(points) < 12:
        return None
    (x, y), (one, other), degrees = cv2.fitEllipseDirect(np.asarray(points, np.float32))
    half = 0.5 * min(one, other), 0.5 * max(one, other)
    if not (low <= half[1] <= high and half[0] >= LEAST_ASPECT * half[1]):
        return None
    return Ellipse(x + 0.5, y + 0.5, 0.5 * one, 0.5 * other, float(np.radians(degrees)))


def _support(ellipse: Ellipse, away: NDArray, slopes: NDArray) -> float:
    """Share of the outline on an edge whose slope runs across it."""
    outline = ellipse.outline(OUTLINE)
    places = np.floor(outline).astype(int)
    height, width = away.shape
    inside = (places >= 0).all(axis=1) & (places[:, 0] < width) & (places[:, 1] < height)
    x, y = places[inside].T
    unit = ellipse.as_unit(outline[inside])
    c, s = np.cos(ellipse.angle), np.sin(ellipse.angle)
    along = np.column_stack([unit[:, 0] / ellipse.a, unit[:, 1] / ellipse.b])
    normals = along @ np.array([[c, s], [-s, c]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gradient = slopes[:, y, x].T
    steep = np.maximum(np.linalg.norm(gradient, axis=1), 1e-6)
    across = np.abs(np.sum(gradient * normals, axis=1)) / steep > 0.85
    return float(np.sum((away[y, x] <= REACH_PX) & across)) / OUTLINE


def _apart(one: Ellipse, other: Ellipse) -> bool:
    """Whether two ellipses are not nearly the same one."""
    middle = np.hypot(one.cx - other.cx, one.cy - other.cy) > 0.12 * one.a
    return bool(middle or abs(np.log(one.a / other.a)) > 0.08)


def _pair(one: Supported, other: Supported) -> FoundPair | None:
    """Two ellipses as a pair of wheels; None for two that no car has."""
    (a, support_a), (b, support_b) = sorted((one, other), key=lambda e: e[0].cx)
    across, down = b.cx - a.cx, abs(b.cy - a.cy)
    size = 0.5 * (a.a + b.a)
    taller = abs(float(np.log((a.a * a.b) / (b.a * b.b)))) / 2.0
    flatter = abs(a.b / a.a - b.b / b.a)
    base = float(np.hypot(across, down)) / size
    if not 2.5 <= base <= 14.0 or down > 0.6 * across or taller > 0.6 or flatter > 0.35:
        return None
    return FoundPair(a, b, 0.5 * (support_a + support_b) - 0.3 * taller - 0.3 * flatter)


def _back(found: Supported, factor: float, shift: FloatArray) -> Supported:
    ellipse, support = found
    x, y = np.array([ellipse.cx, ellipse.cy]) / factor + shift
    return (
        Ellipse(float(x), float(y), ellipse.a / factor, ellipse.b / factor, ellipse.angle),
        support,
    )
