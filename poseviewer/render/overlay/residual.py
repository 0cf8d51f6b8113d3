"""Picture of the residual: a diverging colour map over the greyed photo, with a colour bar."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray

_HEX = "053061 2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b 67001f"
STOPS = np.array([list(bytes.fromhex(colour)) for colour in _HEX.split()], float)
"""RGB from negative to positive: ColorBrewer's RdBu, 11 classes, reversed (colorbrewer2.org)."""
PERCENTILE = 95.0
"""Percentage of residuals that the colour map spans: the strongest few must not set its range."""
ROUND_RANGES = (2, 5, 10, 20, 30, 40, 50, 60, 80, 100, 125, 150, 200, 255)
"""Ranges of the colour map, in grey levels of 255, that are easy to read."""
MIN_SIDE_FOR_BAR_PX = 250
"""Shorter side, in px, of the smallest photo with room for a legible colour bar."""

Part = tuple[slice, slice]
"""Rows and columns of a part of the photo."""


def diverging_colours(values: FloatArray) -> FloatArray:
    """Map values (...) in [-1, 1] to RGB (..., 3) in [0, 255]: blue, white at 0, red."""
    position = np.clip(values, -1.0, 1.0) * 0.5 + 0.5
    stops = np.linspace(0.0, 1.0, len(STOPS))
    return np.stack([np.interp(position, stops, STOPS[:, i]) for i in range(3)], axis=-1)


def paint_residual(
    photo: NDArray[np.uint8], part: Part, residual: FloatArray, mask: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """Paint the residual over the greyed photo, with a colour bar.

    Args:
        photo: (H, W, 3): RGB.
        part: part of the photo about the model.
        residual: (h, w): photo minus model in the part, in grey levels of 255.
        mask: (h, w): pixels of the part that show the model.
    """
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
    # Of low contrast, so that colours stand out, and darker than the white of 0.
    backdrop = cv2.LUT(grey, np.linspace(40, 150, 256).astype(np.uint8))
    picture = np.repeat(np.asarray(backdrop, np.uint8)[..., None], 3, axis=2)
    limit = symmetric_range(residual[mask])
    colours = diverging_colours(residual / limit)
    picture[part] = np.where(mask[..., None], np.rint(colours), picture[part])
    covered = np.zeros(grey.shape, bool)
    covered[part] = mask
    _draw_bar(picture, covered, limit)
    return picture


def symmetric_range(residuals: FloatArray) -> int:
    """Choose the round number of grey levels at the ends of the colour map."""
    reach = np.percentile(np.abs(residuals), PERCENTILE) if residuals.size else 0.0
    return next((r for r in ROUND_RANGES if r >= reach), ROUND_RANGES[-1])


def _draw_bar(picture: NDArray[np.uint8], covered: NDArray[np.bool_], limit: int) -> None:
    """Draw the colour bar into the corner where it covers the model least."""
    height, width = picture.shape[:2]
    if min(height, width) < MIN_SIDE_FOR_BAR_PX:
        return
    bar = _bar(limit, max(0.42, max(height, width) / 2000.0), width)
    h, w = bar.shape[:2]
    gap = max(4, round(max(height, width) / 120))
    corners = [(y, x) for y in (gap, height - h - gap) for x in (gap, width - w - gap)]
    y, x = min(corners, key=lambda c: int(covered[c[0] : c[0] + h, c[1] : c[1] + w].sum()))
    picture[y : y + h, x : x + w] = bar


def _bar(limit: int, text_scale: float, photo_width: int) -> NDArray[np.uint8]:
    """(h, w, 3): a colour bar with ticks and title on a dark plate."""
    font, stroke = cv2.FONT_HERSHEY_SIMPLEX, max(1, round(text_scale * 1.6))
    title = "photo - model (0-255)"
    (width, _), _ = cv2.getTextSize(title, font, text_scale, stroke)
    text_scale *= min(1.0, 0.6 * photo_width / width)
    (title_width, line), _ = cv2.getTextSize(title, font, text_scale, stroke)
    pad = math.ceil(line * 0.8)
    plate = np.full((6 * pad + 2 * line, title_width + 2 * pad, 3), 24, np.uint8)
    ramp = diverging_colours(np.linspace(-1.0, 1.0, title_width))
    top = 2 * pad + line
    plate[top : top + 2 * pad, pad : pad + title_width] = np.rint(ramp)
    white = (235, 235, 235)
    cv2.putText(plate, title, (pad, pad + line), font, text_scale, white, stroke, cv2.LINE_AA)
    for label, place in ((f"-{limit}", 0.0), ("0", 0.5), (f"+{limit}", 1.0)):
        (label_width, _), _ = cv2.getTextSize(label, font, text_scale, stroke)
        at = (pad + round(place * (title_width - label_width)), top + 3 * pad + line)
        cv2.putText(plate, label, at, font, text_scale, white, stroke, cv2.LINE_AA)
    return plate
