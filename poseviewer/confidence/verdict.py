"""The verdict on a pose that a search ended in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct, field

from poseviewer.confidence.weights import FEATURES, FOUND_FROM, LOST_BELOW, OFFSET

MIN_VISIBLE_FRACTION = 0.35
"""Share of the model that must be seen: with less, poses far off look right too."""
PLAIN_FROM, PLAIN_OUTLINE, PLAIN_SEEN = 0.85, 0.9, 0.95
"""Share of the model of one look from which it is plain, and what a ``found`` one has at least of
its outline and of itself: inside it a larger thing of that look fits as well."""
SURE_FROM = 0.93
"""Probability from which a pose is neither continued nor, after an estimate, given up for it."""
SURE_BEHIND = 0.8
"""``SURE_FROM`` behind something: that makes the verdict less sure of right poses too."""
PROBABILITY_MARGIN = 0.1
"""Probability that a turned pose must gain, and that a continued one may lose."""
TURNED_THRESHOLD = 0.75
"""Probability that a turned pose must have: what none explains is not to be looked for far off."""
MIN_PROBABILITY = 0.01
"""Probability of one photo among several: none is sure enough to overrule all others."""
MAX_SCORE = 4.0
"""Standard deviations from the trials' mean at which a feature is cut off: it says no more then."""
SMALL_SPREAD_PERCENT = 3.0
"""Spread below which searches from near by have come back."""
LOW_TURN_MARGIN = 0.3
"""Turn margin that right poses seldom have."""
GOOD_OUTLINE, POOR_OUTLINE = 0.9, 0.75
"""Shares of the outline."""
MIN_OUTLINE = 0.65
"""Share of the outline of a ``found`` pose: plain and flat things fit others' insides, too."""
WHOLE_FROM = 0.9
"""Share of the model below which it is said to be hidden in part."""

Label = Literal["found", "doubtful", "lost"]

LABELS: tuple[Label, ...] = ("lost", "doubtful", "found")
"""From bad to good."""


@dataclass(frozen=True, slots=True)
class Features:
    """Numbers that tell right poses from wrong ones; all finite."""

    turn_margin: float
    """Loss that the best turn by 15 to 45 degrees about an axis of the model adds, in robust
    standard deviations of the losses of wrong poses."""
    spread_percent: float
    """Median distance of the ends of descents from near by, in per cent of the model's size."""
    outline: float
    """Share of the outline with an edge of its direction in the photo, in [0, 1]."""
    seen: float
    """Share of the model's picture that lies on pixels that count, in [0, 1]."""
    alike: float = 0.0
    """Share of the model's picture that has the median's normal and reflectance, in [0, 1]."""

    @property
    def is_plain(self) -> bool:
        """Whether little but its outline tells where the model is."""
        return self.alike >= PLAIN_FROM


class Verdict(Struct, frozen=True, omit_defaults=True):
    """Whether a pose is right, and why; probability: that it is, as among the trials that the
    verdict was calibrated on; reasons: sentences; evidence: the numbers that it comes from, by
    name; views: the verdicts by each of several compared views alone.
    """

    label: Label = field(name="word")
    probability: Annotated[float, Meta(ge=0.0, le=1.0)]
    reasons: tuple[str, ...] = ()
    features: Mapping[str, float] = field(name="evidence", default_factory=dict)
    views: tuple[Verdict, ...] = ()

    def __str__(self) -> str:
        return self.label

    @property
    def share_right(self) -> str:
        """Clause with the ``percent_right``, as people read it behind the label."""
        share = percent_right(self.label, self.probability)
        return f"{share} % of comparable calibration fits were right"


def percent_right(label: str, probability: float) -> int:
    """Probability of a verdict in whole per cent, within the bounds of its label and below 100.

    The label asks for more than the number where photos disagree; a reader sees one answer.
    """
    found, lost = math.ceil(100.0 * FOUND_FROM), math.ceil(100.0 * LOST_BELOW)
    low, high = {"found": (found, 99), "lost": (0, lost - 1)}.get(label, (lost, found - 1))
    return min(max(math.floor(100.0 * probability), low), high)


def judge(features: Features | None) -> Verdict:
    """Verdict by logistic regression on the features, of probability 0 where too little of the
    model is seen; None: it is not to be seen at the pose.
    """
    if features is None:
        return Verdict("lost", 0.0, ("Hardly anything of the model is to be seen there.",))
    score = OFFSET
    for name, (mean, deviation, weight) in FEATURES.items():
        away = (compress_feature(name, getattr(features, name)) - mean) / deviation
        score += weight * min(max(away, -MAX_SCORE), MAX_SCORE)
    probability = 1.0 / (1.0 + math.exp(-score)) if features.seen >= MIN_VISIBLE_FRACTION else 0.0
    outline, seen = (PLAIN_OUTLINE, PLAIN_SEEN) if features.is_plain else (MIN_OUTLINE, 0.0)
    is_found = features.outline >= outline and features.seen >= seen
    label = _label(is_found and probability >= FOUND_FROM, probability < LOST_BELOW)
    return Verdict(label, probability, reasons_for(features), asdict(features))


def _label(is_found: bool, is_lost: bool) -> Label:
    return "found" if is_found else "lost" if is_lost else "doubtful"


def judge_together(views: Sequence[Verdict]) -> Verdict:
    """Verdict on one pose by the mean log odds of its photos, as if they repeated each other.

    ``found`` needs half of them as probable, ``lost`` most of them as improbable: a few that no
    pose of the set explains contradict the others, and say little of the pose.
    """
    each = np.array([one.probability for one in views])
    odds = np.clip(each, MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
    probability = float(1.0 / (1.0 + np.exp(-np.mean(np.log(odds / (1.0 - odds))))))
    confirm, deny = float(np.mean(each >= FOUND_FROM)), float(np.mean(each < LOST_BELOW))
    is_found = probability >= FOUND_FROM and confirm >= 0.5
    label = _label(is_found, probability < LOST_BELOW and deny > 0.5)
    labels = [one.label for one in views]
    said = ", ".join(f"{labels.count(name)} {name}" for name in reversed(LABELS) if name in labels)
    reasons = (f"By each of the {len(views)} photos alone it is: {said}.",)
    return Verdict(label, probability, reasons, views=tuple(views))


def compress_feature(name: str, value: float) -> float:
    """Unbounded features by the inverse hyperbolic sine: a logarithm that takes 0 and less."""
    return math.asinh(value) if name.endswith(("_margin", "_percent")) else value


def reasons_for(features: Features) -> tuple[str, ...]:
    """Sentences for and against the pose."""
    spread, turn, outline = features.spread_percent, features.turn_margin, features.outline
    is_back = spread < SMALL_SPREAD_PERCENT
    end = "came back to it" if is_back else f"ended {spread:.0f} % of the model's size away"
    cost = "less on the coarse photo" if turn < 0.0 else "hardly more: it may be turned"
    how = "" if outline >= GOOD_OUTLINE else "only " if outline < POOR_OUTLINE else "some "
    sentences = {
        f"Searches from near by {end}.": True,
        f"Turned about one of its own axes the model costs {cost}.": turn < LOW_TURN_MARGIN,
        f"Along {how}{outline:.0%} of its outline the photo has an edge of that direction.": True,
        f"Only {features.seen:.0%} of the model is seen: the rest lies on pixels left out.": (
            features.seen < WHOLE_FROM
        ),
        "The model is flat and of one colour there: its outline alone tells where it is.": (
            features.is_plain
        ),
    }
    return tuple(sentence for sentence, holds in sentences.items() if holds)
