"""The paper's method as it stands, a reference that other methods are measured against.

Jayawardena, Hutter and Brewer (2010): grey photo (n = 1), four attributes of the model (m = 4), P
either what the model covers ("clipped") or the whole photo, where all attributes are 0 beside the
model; one downhill simplex on the photo itself, restarted where it ended until that gains nothing.
The paper leaves open how large the simplex is and when to give up; what served it best is taken.
"""

from __future__ import annotations

from dataclasses import replace

from poseviewer.fit.loss import lighting_loss
from poseviewer.optimise.restarts import RestartOptions
from poseviewer.render.types import Moments

WHOLE_STEP = 0.3
"""Edge of the simplex over the whole photo, in the parameters' scales: as wide as the deviations
that it is to mend. Clipped, the loss tells nothing from far, and the usual small one is better."""
PATIENCE = 3
"""Number of restarts in a row without improvement that ends the search."""


def paper_loss(moments: Moments, clipped: bool) -> float:
    """The loss in [0, min(n, m)], without the attribute that tells model and surroundings apart.

    ``clipped``: whether P is what the model covers, where there is no such attribute.
    """
    if not clipped:  # it is the last one: see ``PhotoAttributes.clipped``
        mean, covariance = moments.mean[:-1], moments.covariance[:-1, :-1]
        moments = replace(moments, mean=mean, covariance=covariance)
    return lighting_loss(moments)


def paper_options(options: RestartOptions, clipped: bool) -> RestartOptions:
    """How the photo is searched: from the start alone."""
    step = options.step if clipped else WHOLE_STEP
    return replace(options, multi_starts=0, step=step, patience=PATIENCE)
