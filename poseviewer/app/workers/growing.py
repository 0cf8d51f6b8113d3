"""From a scribble on a thing to all of the thing: GrabCut in the scribble's neighbourhood."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.hiding import Grow, PaintFound, Stroke
from poseviewer.app.state.session import Session
from poseviewer.app.workers.tasks import Found, Task
from poseviewer.errors import QuickStartError
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.rectangle import Rectangle

REACH = 1.0
"""How far the neighbourhood reaches beyond the scribble's box, in its longer side."""
LEAST_REACH = 0.05
"""The same at the least, in the photo's longer side: a thing that was merely tapped."""
SIDE_PX = 320
"""Longer side of the picture that is cut: GrabCut takes half a second there."""
ROUNDS = 5
"""Of GrabCut: more change next to nothing."""


def grow(asked: Grow) -> Task:
    """The task that hides the thing below a scribble, or brings it back."""

    def run(session: Session) -> Iterator[Found]:
        photo, stroke = session.document.registration.photo, asked.stroke
        yield Found((PaintFound(photo, grown(photo, stroke), stroke.erase),))

    return run


def grown(photo: Photo, stroke: Stroke) -> NDArray[np.bool_]:
    """(height, width): the thing that a scribble lies on, to its edge, as the colours of the
    neighbourhood tell it (C. Rother, V. Kolmogorov, A. Blake, *GrabCut*, 2004).

    Raises:
        QuickStartError: the scribble is not on the photo.
    """
    drawn = stroke.covers(photo.width, photo.height)
    if not drawn.any():
        raise QuickStartError("That scribble is beside the photo; draw it on the thing in front.")
    (left, top), (right, bottom) = stroke.points.min(axis=0), stroke.points.max(axis=0)
    longer = max(right - left, bottom - top)
    reach = max(REACH * longer, LEAST_REACH * max(photo.width, photo.height))
    box = Rectangle.from_corners(left - reach, top - reach, right + reach, bottom + reach)
    rows = slice(max(int(box.top), 0), min(int(box.bottom) + 1, photo.height))
    columns = slice(max(int(box.left), 0), min(int(box.right) + 1, photo.width))
    found = np.zeros_like(drawn)
    found[rows, columns] = _cut(photo, drawn, rows, columns)
    return found | drawn


def _cut(photo: Photo, drawn: NDArray[np.bool_], rows: slice, columns: slice) -> NDArray[np.bool_]:
    """The thing within these rows and columns."""
    pixels = photo.pixels[rows, columns]
    pixels = pixels if pixels.dtype == np.uint8 else (pixels >> 8).astype(np.uint8)
    pixels = np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels
    height, width = pixels.shape[:2]
    share = min(1.0, SIDE_PX / max(height, width))
    size = max(1, round(share * width)), max(1, round(share * height))
    small = np.ascontiguousarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))
    seeds = cv2.resize(drawn[rows, columns].astype(np.float32), size, interpolation=cv2.INTER_AREA)
    labels = np.full(small.shape[:2], cv2.GC_PR_BGD, np.uint8)
    # What lies at the neighbourhood's border is not of the thing; the photo's own may cut it off.
    inside = rows.start > 0, rows.stop < photo.height, columns.start > 0, columns.stop < photo.width
    borders = (0, slice(None)), (-1, slice(None)), (slice(None), 0), (slice(None), -1)
    for border, is_inside in zip(borders, inside, strict=True):
        if is_inside:
            labels[border] = cv2.GC_BGD
    seeded = seeds >= min(0.5, float(seeds.max()))
    labels[seeded] = cv2.GC_FGD
    if np.all(seeded):
        return np.ones((height, width), bool)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(small, labels, (0, 0, 1, 1), *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    thing = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)).astype(np.uint8)
    _, pieces = cv2.connectedComponents(thing, connectivity=4)
    thing = (np.isin(pieces, np.unique(pieces[seeded])) & (thing > 0)).astype(np.float32)
    thing = cv2.dilate(thing, np.ones((3, 3), np.uint8))  # the edge is blurred
    return cv2.resize(thing, (width, height), interpolation=cv2.INTER_LINEAR) >= 0.5
