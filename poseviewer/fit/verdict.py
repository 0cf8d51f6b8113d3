"""The verdict on a pose that a search ended in."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from poseviewer.fit.weights import FOUND_FROM, LOST_BELOW
from poseviewer.geometry.pose_covariance import PoseCovariance

Word = Literal["found", "doubtful", "lost"]

WORDS: tuple[Word, ...] = ("lost", "doubtful", "found")
"""From bad to good."""


@dataclass(frozen=True, slots=True)
class Features:
    """Numbers that tell right poses from wrong ones; all finite."""

    turn_margin: float
    """Loss that a turn of the model by 15 to 45 degrees about an axis of its own adds, in robust
    standard deviations of the losses of wrong poses; below 0 where such a turn is better."""
    spread_percent: float
    """Median distance from the pose at which descents from near by ended, in per cent of the
    model's size in the photo."""
    outline: float
    """Share of the outline with an edge of its direction in the photo, in [0, 1]."""
    seen: float
    """Share of the model's picture that lies on pixels that count, in [0, 1]."""


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
    """Covariance of the pose, if it is right; None for a lost one, and where it is not known."""
    views: tuple[Verdict, ...] = field(default=(), compare=False)
    """Verdicts by each of several photos alone."""

    def __str__(self) -> str:
        return self.word

    @property
    def share_right(self) -> str:
        """Clause with the ``percent_right``, as people read it behind the word."""
        share = percent_right(self.word, self.probability)
        return f"{share} % of comparable calibration fits were right"


def percent_right(word: str, probability: float) -> int:
    """Probability of a verdict in whole per cent, kept within the bounds of its word and below 100.

    The word asks for more than the number where something hides the model, and where photos
    disagree; a reader sees one answer.
    """
    found, lost = math.ceil(100.0 * FOUND_FROM), math.ceil(100.0 * LOST_BELOW)
    low, high = {"found": (found, 99), "lost": (0, lost - 1)}.get(word, (lost, found - 1))
    return min(max(math.floor(100.0 * probability), low), high)
