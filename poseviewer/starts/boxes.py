"""Where in a photo a model may be, if nobody says: squares of a few sizes, each tried with a few
views. A guess that holds for a large object on a calm ground; small ones in clutter it does not
find.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from poseviewer.fit.loss import registration_loss
from poseviewer.geometry.camera import Pose
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import sketch_level
from poseviewer.render.types import PhotoAttributes, Renderer
from poseviewer.starts.box_fit import Box, BoxFits

SIDES = (0.25, 0.4, 0.6, 0.85)
"""Of the squares, as shares of the photo's shorter side."""
STRIDE = 0.5
"""From one square to the next, as a share of its side."""
LONGER_PX = 160.0
"""Longer side of the photo on the level that they are tried on."""
VIEWS = 16
"""Tried in each square."""
BOXES = 3
"""Of the best that lie apart are proposed."""

Views = Callable[[Box, int], BoxFits]
"""So many views that fill a rectangle."""


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    box: Box
    loss: float


def find_boxes(
    photo: PhotoAttributes,
    views: Views,
    renderer: Renderer,
    begin: Callable[[], None] | None = None,
) -> tuple[Box, ...]:
    """The likeliest places of the model in a photo, as squares, the best first; on all cores."""
    height, width = (side * photo.factor for side in photo.weights.shape)
    boxes = candidate_boxes(width, height)
    factor = max(1, round(max(photo.weights.shape) / LONGER_PX))
    area = float(np.median([box.width * box.height for box in boxes])) / photo.factor**2
    level = sketch_level(photo, renderer, factor, area)

    def judge(own: Renderer, pose: Pose) -> float:
        return registration_loss(own.moments(pose, level.photo))

    tried = []
    with RendererPool(level.renderer, begin=begin) as pool:
        for box in boxes:
            losses = list(pool.map(judge, views(box, VIEWS).poses))
            tried.append(_Tried(box, min(losses)))
    return _apart(tried)


def candidate_boxes(width: float, height: float) -> tuple[Box, ...]:
    """Squares of all ``SIDES`` that cover a photo, ``STRIDE`` apart or less."""
    found = []
    for share in SIDES:
        side = share * min(width, height)
        across, down = (_starts(length, side) for length in (width, height))
        found += [Box(float(u), float(v), side, side) for v in down for u in across]
    return tuple(found)


def _starts(length: float, side: float) -> Sequence[float]:
    count = int(np.ceil((length - side) / (STRIDE * side))) + 1
    return np.linspace(0.0, length - side, count).tolist()


def _apart(tried: Sequence[_Tried]) -> tuple[Box, ...]:
    kept: list[Box] = []
    for one in sorted(tried, key=lambda this: this.loss):
        if all(_overlap(one.box, other) < 0.3 for other in kept):
            kept.append(one.box)
        if len(kept) == BOXES:
            break
    return tuple(kept)


def _overlap(one: Box, other: Box) -> float:
    """Share of both rectangles' area that both have."""
    across = min(one.left + one.width, other.left + other.width) - max(one.left, other.left)
    down = min(one.top + one.height, other.top + other.height) - max(one.top, other.top)
    both = max(across, 0.0) * max(down, 0.0)
    return both / (one.width * one.height + other.width * other.height - both)
