"""The illumination-invariant loss of Jayawardena, Hutter and Brewer (2010), from moments alone.

Any lighting of a diffuse surface is a linear map ``F = A M + b`` of the model's attributes M to
the photo's F. The loss is what the best such map leaves unexplained, measured so that no regular
affine change of F or of M alters it::

    loss = min(n, m) - tr[ C_FM C_MM^-1 C_MF C_FF^-1 ],    0 <= loss <= min(n, m)

The trace is the sum of the squared canonical correlations between F and M.
"""

from __future__ import annotations

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.render.moments import Moments, PhotoAttributes

CONSTANT_VARIANCE = 1e-12
"""A channel whose variance is below this share of its mean square counts as constant."""
RANK_TOLERANCE = 1e-7
"""Eigenvalues of a correlation matrix below this share of the greatest count as zero: sums in
float32 are no more exact, and no light is so strong that what varies 3,000 times less than the
rest would show. Where a channel varies so little that its rounding to float32 weighs more, that is
the limit."""
EDGE_WEIGHT = 1.5
"""Of the edges' disagreement, in [0, 2], beside the loss. Photos of cars want more, small blurred
ones less."""
PIXELS_PER_ATTRIBUTE = 4
"""With fewer pixels than this for each of the n + m attributes, any lighting fits by chance."""


def worst_loss(moments: Moments) -> float:
    """``min(n, m)``: nothing of the photo is explained, or nothing is seen."""
    n = moments.photo_channels
    return float(min(n, len(moments.mean) - n))


def fewest_pixels(attributes: int) -> int:
    """How many pixels the loss needs of a photo and a model with n + m ``attributes``."""
    return PIXELS_PER_ATTRIBUTE * attributes


def lighting_loss(moments: Moments) -> float:
    """The loss in [0, min(n, m)]; never nan.

    Singular covariances (a constant photo or reflectance, a flat model) are inverted on their
    range only, with ``RANK_TOLERANCE``; what is constant explains nothing. A pose that shows no
    model, or too few pixels of it, costs ``min(n, m)``.
    """
    worst = worst_loss(moments)
    if moments.pixels < fewest_pixels(len(moments.mean)):
        return worst
    n, covariance, mean = moments.photo_channels, moments.covariance, moments.mean
    photo = whitening(covariance[:n, :n], mean[:n])
    model = whitening(covariance[n:, n:], mean[n:])
    correlations = (photo @ covariance[:n, n:] @ model.T).ravel()
    explained = float(correlations @ correlations)
    return min(max(worst - explained, 0.0), worst)


def worst_registration_loss(photo: PhotoAttributes) -> float:
    """What a pose costs that shows nothing of the model."""
    worst = float(min(photo.photo_channels, photo.model_channels))
    return worst if photo.structure is None else worst + 2.0 * EDGE_WEIGHT


def registration_loss(moments: Moments) -> float:
    """What a search minimises: ``lighting_loss``, and where edges are compared what they disagree.

        loss = lighting_loss + EDGE_WEIGHT * (1 - edge cosine)

    In [0, ``worst_registration_loss``]; the worst where too little of the model is seen.
    """
    loss = lighting_loss(moments)
    if moments.edge_cosine is None:
        return loss
    unseen = loss >= worst_loss(moments)
    return loss + EDGE_WEIGHT * (2.0 if unseen else 1.0 - moments.edge_cosine)


def whitening(covariance: FloatArray, mean: FloatArray) -> FloatArray:
    """W (rank, k) with ``W C W^T = I`` on the range of the covariance C (k, k).

    ``W^T W`` is the pseudo-inverse of C, in which tolerances apply to the correlation matrix: a
    channel measured in other units is not a smaller channel.
    """
    variance = covariance.diagonal()
    rounding = CONSTANT_VARIANCE * (variance + mean * mean)
    varies = variance > rounding
    scale = varies / np.sqrt(np.where(varies, variance, 1.0))
    values, vectors = np.linalg.eigh(covariance * scale[:, None] * scale)
    noise = float((rounding * scale * scale).max())
    kept = values > max(RANK_TOLERANCE, noise) * max(float(values[-1]), 0.0)
    if not kept.all():
        values, vectors = values[kept], vectors[:, kept]
    return (vectors / np.sqrt(values)).T * scale
