"""What a search says of the pose that it ended in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from poseviewer.geometry.pose_covariance import PoseCovariance

Word = Literal["found", "doubtful", "lost"]

WORDS: tuple[Word, ...] = ("lost", "doubtful", "found")
"""From bad to good."""


@dataclass(frozen=True, slots=True)
class WeakDirection:
    """A motion of the pose that hardly changes the loss."""

    words: str
    """Such as ``turning about the picture's vertical``."""
    degrees: float
    """How far it can turn on the way, to each side."""
    percent: float
    """How far else: shift in per cent of the model's size, or change of distance or focal length.
    """
    motion: tuple[float, ...]
    """The unit motion, in the parameters of the free-body chart about the pose."""


@dataclass(frozen=True, slots=True)
class Features:
    """All finite. Margins are in robust standard deviations of the losses of wrong poses."""

    loss_margin: float
    """How far the loss is below that of typical wrong poses of this model on this photo."""
    turn_margin: float
    """How far it is below that of the model turned by 15 to 45 degrees about an axis of its own;
    below 0 where such a turn is better."""
    rival_margin: float
    """How far it is below the best other minimum that descents from wrong poses came to; below 0
    where that is better."""
    rival_percent: float
    """How far off that is: mean distance in the photo in per cent of the model's size."""
    agreement: float
    """Share of the descents from poses near by that came back to it, in [0, 1]."""
    spread_percent: float
    """Median distance from it at which these descents ended, in per cent of the size."""
    explained: float
    """Share of the model's pixels that light explains, in [0, 1]."""
    outline: float
    """Share of the outline with an edge of its direction in the photo, in [0, 1]."""
    seen: float
    """Share of the model's picture that lies on pixels that count, in [0, 1]."""
    pixels: float
    """Logarithm to base 10 of how many pixels the model covers where it was compared."""
    weak: tuple[WeakDirection, ...] = ()
    """The weakest first."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a pose is right, and why."""

    word: Word
    probability: float
    """That the pose is right, in [0, 1], as among the trials that the verdict was calibrated on."""
    reasons: tuple[str, ...]
    """Sentences."""
    features: Features | None
    """None where there was nothing to see."""
    covariance: PoseCovariance | None = field(default=None, compare=False)
    """How sure the pose is, if it is right; None for a lost one, and where it cannot be told."""
    views: tuple[Verdict, ...] = field(default=(), compare=False)
    """Of a pose on several photos: by each photo alone."""

    def __str__(self) -> str:
        return self.word
