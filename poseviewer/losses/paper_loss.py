"""The illumination-invariant loss of Jayawardena, Hutter and Brewer (2010), from moments.

Any lighting of a diffuse surface is a linear map ``F = A M + b`` of the model's attributes M to
the photo's F. The loss is what the best such map leaves unexplained. It is invariant to regular
affine changes of F and of M::

    loss = min(n, m) - tr[ C_FM C_MM^-1 C_MF C_FF^-1 ],    0 <= loss <= min(n, m)

The trace is the sum of the squared canonical correlations r_i^2 between F and M.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from poseviewer.losses.loss import Loss, LossScale, min_pixels

if TYPE_CHECKING:  # help texts need no NumPy
    from poseviewer.render.attributes import Moments, PhotoAttributes


def lighting_loss(moments: Moments) -> float:
    """Return the paper's loss, in [0, min(n, m)]; the worst where too few pixels show the model.

    Singular covariances (a constant photo or reflectance, a flat model) are inverted on their
    range only, with ``RANK_TOLERANCE``: constants explain nothing, and the loss is never nan.
    """
    worst = float(moments.correlations)
    if moments.pixels < min_pixels(len(moments.mean)):
        return worst
    return min(max(worst - float(moments.squared_correlations().sum()), 0.0), worst)


def whole_photo_loss(moments: Moments) -> float:
    """Return the paper's loss over the whole photo, in [0, 1].

    It is ``lighting_loss`` without the last attribute, which separates model and surroundings.
    """
    mean, covariance = moments.mean[:-1], moments.covariance[:-1, :-1]
    return lighting_loss(replace(moments, mean=mean, covariance=covariance))


def lighting_scale(photo: PhotoAttributes) -> LossScale:
    """Return the scale of ``lighting_loss`` on a photo."""
    return LossScale(float(photo.correlations))


_CLIPPED = Loss(
    name="paper",
    label="Paper (2010)",
    hint="Paper (2010): what light alone does, in grey.",
    of_moments=lighting_loss,
    scale=lighting_scale,
    pixels=("clip", "whole"),
    search="simplex",
    is_grey=True,
    is_continued=False,
)
PAPER = replace(_CLIPPED, by_pixels={"whole": replace(_CLIPPED, of_moments=whole_photo_loss)})
"""The paper's loss and search."""
