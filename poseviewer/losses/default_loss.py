"""The default loss: of light, colour classes and edges.

The photo's attributes F are colours and memberships in classes, M are the model's. With the
squared canonical correlations r_i^2 between them, a search minimises::

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
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from poseviewer.losses.loss import Loss, Losses, LossScale, Unexplained, min_pixels
from poseviewer.losses.paper_loss import PAPER, lighting_loss, lighting_scale

if TYPE_CHECKING:  # help texts need no NumPy
    from poseviewer.render.attributes import Moments, PhotoAttributes

EDGE_WEIGHT = 2.5
"""Weight of the edges' disagreement (1 - cosine); best over photos of many kinds."""
NOISE = 1e-3
"""Fraction of the variance that no pose explains: sensor noise, and what models lack."""
PARTS = 3
"""Number of shares in the geometric mean: light, classes and edges."""


def structure_loss(moments: Moments) -> float:
    """Return the default loss; the worst where too few pixels show the model."""
    import numpy as np

    assert moments.edge_cosine is not None  # the photo has its classes and edges
    if moments.pixels < min_pixels(len(moments.mean)):
        return _worst(moments.correlations)
    squares = np.minimum(moments.squared_correlations(), 1.0)
    unexplained = float(np.log1p((1.0 - squares) / NOISE).sum())
    return unexplained + EDGE_WEIGHT * (1.0 - moments.edge_cosine)


def _worst(correlations: int) -> float:
    return correlations * math.log1p(1.0 / NOISE) + 2.0 * EDGE_WEIGHT


@dataclass(frozen=True, slots=True)
class UnexplainedScale(LossScale):
    """Scale of the default losses, which people read as unexplained shares."""

    correlations: int
    """min(n, m), the number of canonical correlations."""
    colours: int
    """Channels of the photo's colour, 1 or 3; the classes follow them."""

    @classmethod
    def of(cls, photo: PhotoAttributes) -> UnexplainedScale:
        """Return the scale of the losses on ``photo``."""
        count = photo.correlations
        return cls(_worst(count), count, photo.channels.shape[2])

    @property
    def name(self) -> str:
        """Name of the shown values."""
        return "unexplained"

    def as_unexplained(self, losses: Losses) -> Losses:
        """Convert losses to unexplained shares in [0, 1]; nan stays nan."""
        import numpy as np

        nothing = self.correlations * math.log1p(1.0 / NOISE) + EDGE_WEIGHT
        kind: Any = np.asarray if isinstance(losses, np.ndarray) else float
        return kind(np.exp(np.minimum(np.subtract(losses, nothing) / PARTS, 0.0)))

    def as_shown(self, losses: Losses) -> Losses:
        """Convert losses to unexplained shares."""
        return self.as_unexplained(losses)

    def text(self, loss: float) -> str:
        """Return a text such as ``unexplained 0.170``."""
        return f"unexplained {self.as_unexplained(loss):.3f}"

    def read(self, loss: float, moments: Moments) -> Unexplained:
        """Split the ``loss`` of a pose with these ``moments`` into its parts."""
        import numpy as np

        assert moments.edge_cosine is not None
        if moments.pixels < min_pixels(len(moments.mean)):
            return Unexplained(self, loss, (1.0, 1.0, 1.0))
        light, both = (
            float(((1.0 - squares.clip(0.0, 1.0) + NOISE) / (1.0 + NOISE)).prod())
            for squares in map(moments.squared_correlations, (self.colours, None))
        )
        edges = min(float(np.exp(-EDGE_WEIGHT * moments.edge_cosine)), 1.0)
        return Unexplained(self, loss, (light, min(both / light, 1.0), edges))


_STRUCTURED = Loss(
    name="default",
    label="Default: light, colour, edges",
    hint="Default: what light, classes of colour and edges leave unexplained.",
    of_moments=structure_loss,
    scale=UnexplainedScale.of,
    has_structure=True,
    unit=1.0,
)
_CLIPPED = replace(
    _STRUCTURED,
    of_moments=lighting_loss,
    scale=lighting_scale,
    search="simplex",
    has_structure=False,
    unit=PAPER.unit,
)
DEFAULT = replace(_STRUCTURED, by_pixels={"clip": _CLIPPED})
"""The default; on clipped pixels, of light in colour alone."""
