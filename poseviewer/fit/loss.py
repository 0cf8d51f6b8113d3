"""The illumination-invariant loss of Jayawardena, Hutter and Brewer (2010), from moments.

Any lighting of a diffuse surface is a linear map ``F = A M + b`` of the model's attributes M to
the photo's F. The loss is what the best such map leaves unexplained. It is invariant to regular
affine changes of F and of M::

    loss = min(n, m) - tr[ C_FM C_MM^-1 C_MF C_FF^-1 ],    0 <= loss <= min(n, m)

The trace is the sum of the squared canonical correlations r_i^2 between F and M. By default,
classes and edges are compared too, and a search minimises::

    loss = sum_i log(1 + (1 - r_i^2) / NOISE) + EDGE_WEIGHT * (1 - edge cosine)

Were F and M normal, the sum would be minus twice their mutual information, but for NOISE and a
constant. The last per cent of what is explained counts as much as the first.

People read that loss as the *unexplained* share, from 0 (all is explained) to 1 (nothing), the
geometric mean of three shares::

    light   = prod_i (1 - p_i^2)                     Wilks' lambda of the colours with M
    classes = prod_i (1 - r_i^2) / light             of the classes, beyond what light explains
    edges   = exp(-EDGE_WEIGHT cos)
    unexplained = (light * classes * edges)^(1/3) = exp((loss - nothing) / 3)

p_i are the canonical correlations of the photo's colours with M. Each 1 - r^2 is replaced by
(1 - r^2 + NOISE) / (1 + NOISE), and ``nothing`` is the loss at which all r_i and the cosine are 0.
A pose that explains less than nothing (edges across the photo's) has 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.linear_algebra import canonical_correlations_squared
from poseviewer.render.attributes import Moments, PhotoAttributes

EDGE_WEIGHT = 2.5
"""Weight of the edges' disagreement (1 - cosine); best over photos of many kinds."""
NOISE = 1e-3
"""Fraction of the variance that no pose explains: sensor noise, and what models lack."""
PIXELS_PER_ATTRIBUTE = 4
"""Pixels for each of the n + m attributes, at least: with fewer, lighting fits by chance."""
PARTS = 3
"""Number of shares in the geometric mean: light, classes and edges."""

Loss = Callable[[Moments], float]
"""Function that a search minimises, of the moments of a pose on a photo."""
Losses = TypeVar("Losses", float, FloatArray)


def min_pixels(attributes: int) -> int:
    """Return the number of pixels that the loss needs for n + m ``attributes``."""
    return PIXELS_PER_ATTRIBUTE * attributes


def lighting_loss(moments: Moments) -> float:
    """Return the paper's loss, in [0, min(n, m)]; the worst where too few pixels show the model.

    Singular covariances (a constant photo or reflectance, a flat model) are inverted on their
    range only, with ``RANK_TOLERANCE``: constants explain nothing, and the loss is never nan.
    """
    worst = float(_count(moments))
    if moments.pixels < min_pixels(len(moments.mean)):
        return worst
    return min(max(worst - float(_canonical_squares(moments).sum()), 0.0), worst)


def whole_photo_loss(moments: Moments) -> float:
    """Return the paper's loss over the whole photo, in [0, 1].

    It is ``lighting_loss`` without the last attribute, which separates model and surroundings.
    """
    mean, covariance = moments.mean[:-1], moments.covariance[:-1, :-1]
    return lighting_loss(replace(moments, mean=mean, covariance=covariance))


def registration_loss(moments: Moments) -> float:
    """Return the loss with classes and edges if these are compared, else ``lighting_loss``."""
    if moments.edge_cosine is None:
        return lighting_loss(moments)
    if moments.pixels < min_pixels(len(moments.mean)):
        return LossScale(_count(moments), 1, has_edges=True).worst
    squares = np.minimum(_canonical_squares(moments), 1.0)
    unexplained = float(np.log1p((1.0 - squares) / NOISE).sum())
    return unexplained + EDGE_WEIGHT * (1.0 - moments.edge_cosine)


def _count(moments: Moments) -> int:
    """Return min(n, m), the number of canonical correlations."""
    return min(moments.photo_channels, len(moments.mean) - moments.photo_channels)


def _canonical_squares(moments: Moments, colours: int | None = None) -> FloatArray:
    """(min(n, m),): squared canonical correlations of M and F, or its first ``colours``."""
    n = moments.photo_channels
    mean = moments.mean
    covariance = moments.covariance
    if colours is None:
        return canonical_correlations_squared(mean, covariance, n, moments.photo_whitening)
    kept = np.r_[:colours, n : len(mean)]
    return canonical_correlations_squared(mean[kept], covariance[np.ix_(kept, kept)], colours)


@dataclass(frozen=True, slots=True)
class LossScale:
    """The scale of the losses of all poses on one photo."""

    correlations: int
    """min(n, m), the number of canonical correlations."""
    colours: int
    """Channels of the photo's colour, 1 or 3; the classes follow them."""
    has_edges: bool
    """Whether classes and edges are compared; else the loss is the paper's, in [0, min(n, m)]."""

    @classmethod
    def of(cls, photo: PhotoAttributes) -> LossScale:
        """Return the scale of the losses on ``photo``."""
        correlations = min(photo.photo_channels, photo.model_channels)
        return cls(correlations, photo.channels.shape[2], photo.structure is not None)

    @property
    def worst(self) -> float:
        """The loss of a pose that shows nothing of the model."""
        if not self.has_edges:
            return float(self.correlations)
        return self.correlations * float(np.log1p(1.0 / NOISE)) + 2.0 * EDGE_WEIGHT

    @property
    def name(self) -> str:
        """Name of the shown values: ``unexplained``, or ``loss (of 1)``."""
        return "unexplained" if self.has_edges else f"loss (of {self.correlations})"

    def as_unexplained(self, losses: Losses) -> Losses:
        """Convert losses to unexplained shares in [0, 1]; nan stays nan."""
        if not self.has_edges:
            return losses / self.correlations
        nothing = self.correlations * np.log1p(1.0 / NOISE) + EDGE_WEIGHT
        kind: Any = np.asarray if isinstance(losses, np.ndarray) else float
        return kind(np.exp(np.minimum(np.subtract(losses, nothing) / PARTS, 0.0)))

    def as_shown(self, losses: Losses) -> Losses:
        """Convert losses to what people read: unexplained shares, or the paper's losses."""
        return self.as_unexplained(losses) if self.has_edges else losses

    def text(self, loss: float) -> str:
        """Return a text such as ``unexplained 0.170``, or ``loss 0.378 of 1`` for the paper's."""
        shown = f"{self.as_shown(loss):.3f}"
        return f"unexplained {shown}" if self.has_edges else f"loss {shown} of {self.correlations}"

    def read(self, loss: float, moments: Moments) -> Unexplained:
        """Split the ``loss`` of a pose with these ``moments`` into its parts."""
        if moments.edge_cosine is None:
            return Unexplained(self, loss)
        if moments.pixels < min_pixels(len(moments.mean)):
            return Unexplained(self, loss, (1.0, 1.0, 1.0))
        light, both = (
            float(np.prod((1.0 - np.clip(squares, 0.0, 1.0) + NOISE) / (1.0 + NOISE)))
            for squares in (_canonical_squares(moments, self.colours), _canonical_squares(moments))
        )
        edges = min(float(np.exp(-EDGE_WEIGHT * moments.edge_cosine)), 1.0)
        return Unexplained(self, loss, (light, min(both / light, 1.0), edges))


@dataclass(frozen=True, slots=True)
class Unexplained:
    """The loss of a pose on its scale."""

    scale: LossScale
    loss: float
    parts: tuple[float, ...] = ()
    """Shares of light, classes and edges, whose geometric mean is the total; empty if light alone
    is compared, or the model is behind the camera."""

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
