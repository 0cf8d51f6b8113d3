"""The illumination-invariant loss of Jayawardena, Hutter and Brewer (2010), from moments alone.

Any lighting of a diffuse surface is a linear map ``F = A M + b`` of the model's attributes M to
the photo's F. The loss is what the best such map leaves unexplained, measured so that no regular
affine change of F or of M alters it::

    loss = min(n, m) - tr[ C_FM C_MM^-1 C_MF C_FF^-1 ],    0 <= loss <= min(n, m)

The trace is the sum of the squared canonical correlations between F and M.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.linear_algebra import squared_correlations
from poseviewer.render.types import Moments, PhotoAttributes

EDGE_WEIGHT = 2.5
"""Weight of the edges' disagreement, in [0, 2]. Photos of cars want more, blurred ones less."""
NOISE = 1e-3
"""Share of the variance that no pose explains: sensor noise, and what models leave out."""
PIXELS_PER_ATTRIBUTE = 4
"""With fewer pixels than this for each of the n + m attributes, any lighting fits by chance."""


def fewest_pixels(attributes: int) -> int:
    """Number of pixels that the loss needs for n + m ``attributes``."""
    return PIXELS_PER_ATTRIBUTE * attributes


def lighting_loss(moments: Moments) -> float:
    """The loss in [0, min(n, m)]; never nan.

    Singular covariances (a constant photo or reflectance, a flat model) are inverted on their
    range only, with ``RANK_TOLERANCE``; what is constant explains nothing. A pose that shows no
    model, or too few pixels of it, costs ``min(n, m)``.
    """
    worst = float(min(moments.photo_channels, len(moments.mean) - moments.photo_channels))
    if moments.pixels < fewest_pixels(len(moments.mean)):
        return worst
    return min(max(worst - float(canonical_squares(moments).sum()), 0.0), worst)


def registration_loss(moments: Moments) -> float:
    """The loss that a search minimises: ``lighting_loss``, or where edges are compared::

        loss = sum_i log(1 + (1 - r_i^2) / NOISE) + EDGE_WEIGHT * (1 - edge cosine)

    over the min(n, m) canonical correlations r_i between F and M. But for NOISE and a constant the
    sum is minus twice the mutual information of F and M, were they normal: the logarithm makes the
    last per cent of what is explained count as much as the first, so that where the light explains
    the photo the pose is told exactly, and where it does not, little is made of it.
    """
    if moments.edge_cosine is None:
        return lighting_loss(moments)
    worst = min(moments.photo_channels, len(moments.mean) - moments.photo_channels)
    if moments.pixels < fewest_pixels(len(moments.mean)):
        return _worst_with_edges(worst)
    squares = np.minimum(canonical_squares(moments), 1.0)
    unexplained = float(np.log1p((1.0 - squares) / NOISE).sum())
    return unexplained + EDGE_WEIGHT * (1.0 - moments.edge_cosine)


def paper_loss(moments: Moments, clipped: bool) -> float:
    """The paper's loss, in [0, 1], of a grey photo (n = 1) and four attributes of the model.

    ``clipped``: P is what the model covers. If not, P is the whole photo, beside the model all four
    are 0, and the attribute that tells model and surroundings apart is left out.
    """
    if not clipped:  # it is the last one: see ``PhotoAttributes.clipped``
        mean, covariance = moments.mean[:-1], moments.covariance[:-1, :-1]
        moments = replace(moments, mean=mean, covariance=covariance)
    return lighting_loss(moments)


def worst_registration_loss(photo: PhotoAttributes) -> float:
    """The loss of a pose that shows nothing of the model."""
    worst = min(photo.photo_channels, photo.model_channels)
    return float(worst) if photo.structure is None else _worst_with_edges(worst)


def _worst_with_edges(worst: int) -> float:
    return worst * float(np.log1p(1.0 / NOISE)) + 2.0 * EDGE_WEIGHT


def canonical_squares(moments: Moments, colours: int | None = None) -> FloatArray:
    """(min(n, m),): the squared canonical correlations of F and M; or (min(colours, m),): of the
    leading channels of F alone.
    """
    n, mean, covariance = moments.photo_channels, moments.mean, moments.covariance
    if colours is None:
        return squared_correlations(mean, covariance, n, moments.photo_whitening)
    kept = np.r_[:colours, n : len(mean)]
    return squared_correlations(mean[kept], covariance[np.ix_(kept, kept)], colours)
