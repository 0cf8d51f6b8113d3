"""A loss: its function of moments, the scale that people read it on, and what it compares."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeVar

if TYPE_CHECKING:  # help texts need no NumPy
    from poseviewer.geometry.arrays import FloatArray
    from poseviewer.render.attributes import Moments, PhotoAttributes

LossName = str
"""Name of a loss in ``LOSSES``."""
PixelsName = Literal["near", "whole", "clip"]
SearchName = Literal["simplex", "models"]
Losses = TypeVar("Losses", float, "FloatArray")

PIXELS_PER_ATTRIBUTE = 4
"""Pixels for each of the n + m attributes, at least: with fewer, lighting fits by chance."""


def min_pixels(attributes: int) -> int:
    """Return the number of pixels that a loss needs for n + m ``attributes``."""
    return PIXELS_PER_ATTRIBUTE * attributes


@dataclass(frozen=True, slots=True)
class LossScale:
    """Scale of the losses of all poses on one photo, from 0; people read the losses themselves."""

    worst: float
    """Loss of a pose that shows nothing of the model."""

    @property
    def name(self) -> str:
        """Name of the shown values, such as ``loss (of 1)``."""
        return f"loss (of {self.worst:g})"

    def as_unexplained(self, losses: Losses) -> Losses:
        """Convert losses to unexplained shares in [0, 1]; nan stays nan."""
        return losses / self.worst

    def as_shown(self, losses: Losses) -> Losses:
        """Convert losses to what people read."""
        return losses

    def text(self, loss: float) -> str:
        """Return a text such as ``loss 0.378 of 1``."""
        return f"loss {loss:.3f} of {self.worst:g}"

    def read(self, loss: float, moments: Moments) -> Unexplained:
        """Read the ``loss`` of a pose with these ``moments``, with its parts if it has any."""
        del moments
        return Unexplained(self, loss)


@dataclass(frozen=True, slots=True)
class Unexplained:
    """The loss of a pose on its scale."""

    scale: LossScale
    loss: float
    parts: tuple[float, ...] = ()
    """Shares of light, classes and edges, whose geometric mean is the total; empty if the loss has
    no such parts, or the model is behind the camera."""

    @property
    def total(self) -> float:
        """Unexplained share, in [0, 1]."""
        return self.scale.as_unexplained(self.loss)

    @property
    def text(self) -> str:
        """Text such as ``unexplained 0.170``; see ``LossScale.text``."""
        return self.scale.text(self.loss)

    @property
    def parts_text(self) -> str:
        """Text such as ``light 0.09, classes 0.20, edges 0.27``; empty if there are no parts."""
        named = zip(("light", "classes", "edges"), self.parts, strict=False)
        return ", ".join(f"{name} {share:.2f}" for name, share in named)


def mean_over(photos: Sequence[Unexplained]) -> Unexplained:
    """Return the mean loss over photos of one scale, and the geometric means of its parts."""
    count, parts = len(photos), zip(*(photo.parts for photo in photos), strict=False)
    shares = tuple(math.prod(part) ** (1.0 / count) for part in parts)
    return Unexplained(photos[0].scale, sum(photo.loss for photo in photos) / count, shares)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loss:
    """A loss that a search minimises, and all that depends on which one it is."""

    name: LossName
    """Name in files and on the command line."""
    label: str
    """Name for people."""
    hint: str
    """Sentence for people: what is compared."""
    of_moments: Callable[[Moments], float]
    """Function that is minimised, of the moments of a pose on a photo."""
    scale: Callable[[PhotoAttributes], LossScale]
    """Function that makes the scale of the losses on a photo."""
    pixels: tuple[PixelsName, ...] = ("near", "whole", "clip")
    """Pixels that can be compared, the default first."""
    search: SearchName = "models"
    """Search that is taken if none is named."""
    is_grey: bool = False
    """Whether grey is compared with the model's grey, in whatever colours both are."""
    has_structure: bool = False
    """Whether the photo's classes and edges are compared. Only then do searches refine the pose on
    a finer photo, leave out what stands in front, and start again from a pose without trust."""
    is_continued: bool = True
    """Whether a search that has moved the focal length far goes on from its end."""
    unit: float = 1.0 / 40.0
    """Change that goes with 1 of the default loss about the truth."""
    by_pixels: Mapping[PixelsName, Loss] = field(default_factory=dict)
    """Losses that stand in for this one on some pixels."""

    def on(self, pixels: PixelsName) -> Loss:
        """Return the loss that is minimised on these pixels."""
        return self.by_pixels.get(pixels, self)
