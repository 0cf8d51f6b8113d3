"""The paper's method as it stands, a reference that other methods are measured against.

Jayawardena, Hutter and Brewer (2010): grey photo (n = 1), four attributes of the model (m = 4), P
either what the model covers ("clipped") or the whole photo, where all attributes are 0 beside the
model; one downhill simplex on the photo itself, rebuilt where it ended until that gains nothing.

The paper leaves open how large the simplex is and when to give up. What served it best on drawn
photos is taken: over the whole photo a simplex as wide as the deviations that it is to mend (it
found all of five starts 16 % off on black ground, relative, where the usual small one found four);
clipped, where the loss tells nothing from far, the small one; and three restarts in turn that gain
nothing.
"""

from __future__ import annotations

from dataclasses import replace

from poseviewer.fit.loss import lighting_loss
from poseviewer.fit.stages import Stage
from poseviewer.optimise.restarts import RestartOptions
from poseviewer.render.pyramid.levels import Level
from poseviewer.render.types import Moments, PhotoAttributes, Renderer

WHOLE_STEP = 0.3
"""Edge of the simplex over the whole photo, in units of each number's span."""
PATIENCE = 3
"""So many restarts that gain nothing end the search."""


def paper_loss(moments: Moments, clipped: bool) -> float:
    """The loss in [0, min(n, m)], without the attribute that tells model and surroundings apart.

    ``clipped``: whether P is what the model covers, where there is no such attribute.
    """
    return lighting_loss(moments if clipped else _without_indicator(moments))


def paper_stages(
    photo: PhotoAttributes, renderer: Renderer, rules: RestartOptions
) -> tuple[Stage, ...]:
    """One stage: the photo itself, without scouts."""
    step = rules.step if photo.clipped else WHOLE_STEP
    searched = replace(rules, scouts=0, step=step, patience=PATIENCE)
    return (Stage(Level(1, photo, renderer), searched),)


def _without_indicator(moments: Moments) -> Moments:
    """It is the last attribute: see ``PhotoAttributes.clipped``."""
    return replace(moments, mean=moments.mean[:-1], covariance=moments.covariance[:-1, :-1])
