"""A scale to read losses on: the unexplained share, from 0 (all is explained) to 1 (nothing).

The search's loss adds logarithms, and its least and greatest values say nothing to a reader. The
scale is the geometric mean of three shares, each of what one question leaves unexplained::

    light   = prod_i (1 - p_i^2)                     Wilks' lambda of the colours with M
    classes = prod_i (1 - r_i^2) / light             of the classes, beyond what light explains
    edges   = exp(-EDGE_WEIGHT cos)
    unexplained = (light * classes * edges)^(1/3) = exp((loss - nothing) / 3)

p_i are the canonical correlations of the photo's colours with M, r_i those of all of F; for
1 - r^2 stands (1 - r^2 + NOISE) / (1 + NOISE), and ``nothing`` is the loss where all r_i and the
cosine are 0. So on one photo the order of poses is the loss's own. A pose that explains less than
nothing (edges across the photo's) has 1. Of the paper's loss it is the share of min(n, m).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from poseviewer.fit.loss import EDGE_WEIGHT, NOISE, canonical_squares, fewest_pixels
from poseviewer.geometry.arrays import FloatArray
from poseviewer.render.types import Moments, PhotoAttributes

Losses = TypeVar("Losses", float, FloatArray)
PARTS = 3
"""Light, classes, edges: shares whose geometric mean is taken."""


@dataclass(frozen=True, slots=True)
class LossScale:
    """The scale of the losses of all poses on one photo."""

    most: int
    """min(n, m), the number of canonical correlations."""
    colours: int
    """Channels of the photo's colour, 1 or 3; after them come the classes."""
    has_edges: bool
    """Whether classes and edges are compared too; if not, the loss is the paper's, in [0, most]."""

    @classmethod
    def of(cls, photo: PhotoAttributes) -> LossScale:
        """The scale of the losses on ``photo``."""
        most = min(photo.photo_channels, photo.model_channels)
        return cls(most, photo.channels.shape[2], photo.structure is not None)

    @property
    def name(self) -> str:
        """Name of the shown values: ``unexplained``, or ``loss (of 1)``."""
        return "unexplained" if self.has_edges else f"loss (of {self.most})"

    def unexplained(self, losses: Losses) -> Losses:
        """Shares in [0, 1] of losses; nan stays nan."""
        if not self.has_edges:
            return losses / self.most
        nothing = self.most * np.log1p(1.0 / NOISE) + EDGE_WEIGHT
        kind: Any = np.asarray if isinstance(losses, np.ndarray) else float
        return kind(np.exp(np.minimum(np.subtract(losses, nothing) / PARTS, 0.0)))

    def shown(self, losses: Losses) -> Losses:
        """Losses as shown to a person: unexplained, or the paper's own, in [0, min(n, m)]."""
        return self.unexplained(losses) if self.has_edges else losses

    def text(self, loss: float) -> str:
        """Text such as ``unexplained 0.170``, or for the paper's loss ``loss 0.378 of 1``."""
        shown = f"{self.shown(loss):.3f}"
        return f"unexplained {shown}" if self.has_edges else f"loss {shown} of {self.most}"

    def read(self, loss: float, moments: Moments) -> Unexplained:
        """The ``loss`` of a pose with these ``moments``, and its parts."""
        if moments.edge_cosine is None:
            return Unexplained(self, loss)
        if moments.pixels < fewest_pixels(len(moments.mean)):
            return Unexplained(self, loss, 1.0, 1.0, 1.0)
        light, both = (
            float(np.prod((1.0 - np.clip(squares, 0.0, 1.0) + NOISE) / (1.0 + NOISE)))
            for squares in (canonical_squares(moments, self.colours), canonical_squares(moments))
        )
        edges = min(float(np.exp(-EDGE_WEIGHT * moments.edge_cosine)), 1.0)
        return Unexplained(self, loss, light, min(both / light, 1.0), edges)


@dataclass(frozen=True, slots=True)
class Unexplained:
    """The loss of a pose on its scale; parts are None where light alone is compared."""

    scale: LossScale
    loss: float
    light: float | None = None
    classes: float | None = None
    edges: float | None = None

    @property
    def total(self) -> float:
        """Geometric mean of the parts, in [0, 1]."""
        return self.scale.unexplained(self.loss)

    @property
    def text(self) -> str:
        """Text such as ``unexplained 0.170``; see ``LossScale.text``."""
        return self.scale.text(self.loss)

    @property
    def parts_text(self) -> str:
        """Text such as ``light 0.09, classes 0.20, edges 0.27``; empty where light is all."""
        parts = {"light": self.light, "classes": self.classes, "edges": self.edges}
        return ", ".join(f"{name} {x:.2f}" for name, x in parts.items() if x is not None)


def mean_over(photos: Sequence[Unexplained]) -> Unexplained:
    """Mean loss over several photos of one scale, and geometric means of its parts."""
    losses = [one.loss for one in photos]
    parts = [[one.light, one.classes, one.edges] for one in photos]
    shares = [
        None if None in of_all else math.prod(of_all) ** (1.0 / len(photos))
        for of_all in zip(*parts, strict=True)
    ]
    return Unexplained(photos[0].scale, sum(losses) / len(losses), *shares)
