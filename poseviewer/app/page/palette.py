"""The colours of the loss: bright is low, so that basins stand out of a dark page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.geometry.arrays import FloatArray

LEVELS = 128
"""Steps of colour: more cannot be told apart, and make every picture larger."""


def _palette() -> NDArray[np.uint8]:
    """(LEVELS, 3): viridis, which is perceptually even and safe for the colour-blind, reversed."""
    along = np.linspace(255, 0, LEVELS).round().astype(np.uint8)
    colours = cv2.applyColorMap(along[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    return np.ascontiguousarray(colours, np.uint8)


def _hex(colour: NDArray[np.uint8]) -> str:
    return "#" + bytes(colour.tolist()).hex()


PALETTE = _palette()
"""(LEVELS, 3) sRGB, the colour of the lowest loss first."""


@dataclass(frozen=True, slots=True)
class LossRange:
    """The losses that get the first and the last colour."""

    low: float
    high: float

    def levels(self, losses: FloatArray) -> NDArray[np.uint8]:
        """Index of each loss's colour; losses beyond the range get the nearest colour."""
        width = max(self.high - self.low, 1e-12)
        share = np.clip((losses - self.low) / width, 0.0, 1.0)
        return (share * (LEVELS - 1)).round().astype(np.uint8)


def loss_range(losses: Sequence[FloatArray]) -> LossRange | None:
    """From the least to the greatest known loss of all arrays; None if none is known."""
    known = np.concatenate([np.zeros(0), *(a[np.isfinite(a)] for a in losses)])
    return LossRange(float(known.min()), float(known.max())) if known.size else None


def loss_png(losses: FloatArray, scale: LossRange) -> bytes:
    """An 8-bit palette PNG of losses (k, k) without gaps, the LAST row at the top: values grow
    to the right and upwards.
    """
    image = Image.fromarray(scale.levels(losses)[::-1])
    image.putpalette(PALETTE.tobytes())
    memory = BytesIO()
    image.save(memory, "PNG", bits=8, compress_level=9)
    return memory.getvalue()


def css_gradient(stops: int = 9) -> str:
    """The palette from left (low) to right (high), as a CSS image."""
    colours = PALETTE[np.linspace(0, LEVELS - 1, stops).round().astype(int)]
    return f"linear-gradient(90deg,{','.join(_hex(c) for c in colours)})"


def colour_scale(stops: int = 17) -> list[tuple[float, str]]:
    """The palette as Plotly takes it: (share of the range, colour)."""
    shares = np.linspace(0.0, 1.0, stops)
    colours = PALETTE[(shares * (LEVELS - 1)).round().astype(int)]
    return [(float(share), _hex(c)) for share, c in zip(shares, colours, strict=True)]
