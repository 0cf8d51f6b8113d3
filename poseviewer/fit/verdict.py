"""What a search says of the pose that it ended in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Word = Literal["found", "doubtful", "lost"]

WORDS: tuple[Word, ...] = ("lost", "doubtful", "found")
"""From bad to good."""


@dataclass(frozen=True, slots=True)
class WeakDirection:
    """A way in which the pose can move without the photo minding."""

    words: str
    """Such as ``turning about the picture's vertical``."""
    degrees: float
    """How far it can turn on the way, to each side."""
    percent: float
    """How far else: shift in per cent of the model's size, or change of distance or focal length.
    """
    motion: tuple[float, ...]
    """The unit motion, in the numbers of the free-body chart about the pose."""


@dataclass(frozen=True, slots=True)
class Features:
    """All finite. Margins are in standard deviations (robust ones) of what wrong poses cost."""

    loss_margin: float
    """How much less the pose costs than wrong poses of this model on this photo typically do."""
    edge_margin: float
    """The same of the agreement of edges alone."""
    light_margin: float
    """The same of what light and classes of colour leave unexplained."""
    turn_margin: float
    """How much less it costs than the model turned by 15 to 45 degrees about an axis of its own;
    below 0 where such a turn is better."""
    rival_margin: float
    """How much less it costs than the best place that descents from wrong poses came to; below 0
    where they found a better one."""
    rival_percent: float
    """How far that place is off: mean distance in the photo in per cent of the model's size."""
    agreement: float
    """Share of the descents from poses near by that came back to it, in [0, 1]."""
    spread_percent: float
    """How far apart these descents ended from it, their median, in per cent of the size."""
    drift_percent: float
    """How far off the coarse level's own minimum is, in per cent of the size."""
    edges: float
    """Cosine between the edges of photo and model, in [-1, 1]."""
    explained: float
    """Share of the model's pixels that light explains, in [0, 1]."""
    light: float
    """Share of the photo's variance on the model that light explains, in [0, 1]."""
    outline: float
    """Share of the outline with an edge of its direction in the photo, in [0, 1]."""
    outline_excess: float
    """How much more edge there is on the outline than beside it, in [-1, 1]."""
    outline_shift_percent: float
    """How far beside the outline the photo's edges are strongest, in per cent of the size."""
    seen: float
    """Share of the model's picture that lies on pixels that count, in [0, 1]."""
    pixels: float
    """Logarithm to base 10 of how many pixels the model covers where it was compared."""
    weak: tuple[WeakDirection, ...] = ()
    """Directions that the photo hardly tells, the weakest first."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What to think of a pose."""

    word: Word
    probability: float
    """That the pose is right, in [0, 1], as among the trials that the verdict was calibrated on."""
    reasons: tuple[str, ...]
    """Sentences."""
    features: Features | None
    """None where there was nothing to see."""

    def __str__(self) -> str:
        return self.word
