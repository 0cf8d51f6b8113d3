"""The verdict on a search's final pose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct, field, structs

from poseviewer.errors import percent

# Written by ``python -m tests.measure.calibrate --write`` from 156 trials, 123 of them right:
FEATURES: dict[str, tuple[float, float, float]] = {
    "rival_margin": (1.077, 0.6585, 1.584),
    "spread_percent": (1.679, 0.544, -0.9448),
    "outline": (0.8347, 0.1425, 0.9164),
    "seen": (1, 0.166, 1.265),
}
"""Mean and standard deviation of each feature among the trials, and its weight."""
OFFSET = 2.63
"""Log odds of a pose whose features are the means."""
FOUND_FROM = 0.81
"""Probability from which the verdict is ``found``."""
LOST_BELOW = 0.5
"""Probability below which the verdict is ``lost``."""
# End of what is written.
MIN_VISIBLE_FRACTION = 0.35
"""Visible fraction that a right pose needs: with less, poses far off look right, too."""
MIN_OUTLINE = 0.65
"""Edge support that a ``found`` pose needs: plain things fit inside others, too."""
KNOWN_DROP = 0.1
"""Edge support by which a pose may fall short of one known to be right in the same film."""
PLAIN_FROM = 0.7
"""Fraction of the model of one normal and reflectance from which it is plain: textured and curved
things in photos have less than 0.4."""
PLAIN_OUTLINE = 0.9
"""``MIN_OUTLINE`` of a plain model, which fits inside larger things of its colour."""
PLAIN_VISIBLE = 0.95
"""Visible fraction that a ``found`` pose of a plain model needs, for the same reason."""
SURE_FROM = 0.93
"""Probability from which a search ends, and keeps its pose instead of an estimate."""
SURE_IF_OCCLUDED = 0.8
"""``SURE_FROM`` of an occluded pose: the verdict is less sure of right ones, too."""
PROBABILITY_MARGIN = 0.1
"""Probability that a turned pose must gain, and that a continued one may lose."""
MIN_PROBABILITY = 0.01
"""Least probability of one photo among several: none must overrule all others."""
MAX_SCORE = 4.0
"""Standard deviations from the trials' mean at which a feature is clipped."""
SMALL_SPREAD_PERCENT = 3.0
"""Spread below which searches from near by came back, in % of the model's size."""
LOW_RIVAL_MARGIN = 0.3
"""Rival margin that right poses seldom have."""
GOOD_OUTLINE = 0.9
"""Edge support that a reason names without reserve."""
POOR_OUTLINE = 0.75
"""Edge support below which a reason names it poor."""
WHOLE_FROM = 0.9
"""Visible fraction from which a model counts as visible wholly."""

Label = Literal["found", "doubtful", "lost"]
"""Verdict in one word."""
LABELS: tuple[Label, ...] = ("lost", "doubtful", "found")
"""Labels from bad to good."""


@dataclass(frozen=True, slots=True)
class Features:
    """Evidence for or against a pose; all numbers are finite."""

    rival_margin: float
    """Loss added by the best other minimum to which turned poses lead, in robust standard
    deviations of the losses of wrong poses."""
    spread_percent: float
    """Median distance at which descents from near by end, in % of the model's size."""
    outline: float
    """Edge support: fraction of the outline along which the photo has edges, in [0, 1]."""
    seen: float
    """Visible fraction: pixels of the model that count, in [0, 1]."""
    alike: float = 0.0
    """Fraction of the model's pixels with the median normal and reflectance, in [0, 1]."""

    @property
    def is_plain(self) -> bool:
        """Whether the model has little but its outline to be told by."""
        return self.alike >= PLAIN_FROM


class Verdict(Struct, frozen=True, omit_defaults=True):
    """Judgement whether a pose is right. The probability is that it is, as among the trials of the
    calibration; reasons are sentences for and against it; evidence are its features by name; views
    are the verdicts in each of several compared views alone.
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
        """Clause with the ``percent_right``, to be read behind the label."""
        share = percent_right(self.label, self.probability)
        return f"{share} % of comparable calibration fits were right"


def percent_right(label: str, probability: float) -> int:
    """Round a probability to whole per cent below 100, within the bounds of its label.

    Where photos disagree the label asks for more than the probability; a reader sees one answer.
    """
    found, lost = math.ceil(100.0 * FOUND_FROM), math.ceil(100.0 * LOST_BELOW)
    low, high = {"found": (found, 99), "lost": (0, lost - 1)}.get(label, (lost, found - 1))
    return min(max(math.floor(100.0 * probability), low), high)


def judge(features: Features | None, known_outline: float = 1.0) -> Verdict:
    """Judge a pose by logistic regression on its features.

    Args:
        features: evidence; None: the model is not visible.
        known_outline: edge support of the model at a pose that is known to be right.
    """
    if features is None:
        return Verdict("lost", 0.0, ("Hardly anything of the model is visible there.",))
    score = OFFSET + sum(_scores(features).values())
    probability = 1.0 / (1.0 + math.exp(-score)) if features.seen >= MIN_VISIBLE_FRACTION else 0.0
    outline, visible = MIN_OUTLINE, 0.0
    if features.is_plain:
        outline, visible = PLAIN_OUTLINE, PLAIN_VISIBLE
    outline = min(outline, known_outline - KNOWN_DROP)
    is_found = features.outline >= outline and features.seen >= visible
    label = _label(is_found and probability >= FOUND_FROM, probability < LOST_BELOW)
    return Verdict(label, probability, reasons_for(features), asdict(features))


def _scores(features: Features) -> dict[str, float]:
    """Return the term of each feature in the log odds of a pose."""
    scores = dict[str, float]()
    for name, (mean, deviation, weight) in FEATURES.items():
        z = (compress_feature(name, getattr(features, name)) - mean) / deviation
        scores[name] = weight * min(max(z, -MAX_SCORE), MAX_SCORE)
    return scores


def reason_against(features: Features) -> str:
    """Return a sentence on the feature that speaks most against a pose."""
    scores = _scores(features)
    is_hidden = features.seen < MIN_VISIBLE_FRACTION
    return _sentences(features)["seen" if is_hidden else min(scores, key=lambda name: scores[name])]


def _label(is_found: bool, is_lost: bool) -> Label:
    return "found" if is_found else "lost" if is_lost else "doubtful"


def judge_together(views: Sequence[Verdict]) -> Verdict:
    """Judge one pose by the mean log odds of its photos, as if they repeated each other.

    ``found`` needs half of the photos to agree, ``lost`` most of them: a few photos that no pose
    explains contradict the others, and say little of the pose.
    """
    each = np.array([view.probability for view in views])
    odds = np.clip(each, MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
    probability = float(1.0 / (1.0 + np.exp(-np.mean(np.log(odds / (1.0 - odds))))))
    labels = [view.label for view in views]
    is_confirmed = [label == "found" for label in labels] & (each >= FOUND_FROM)
    confirm, deny = float(np.mean(is_confirmed)), float(np.mean(each < LOST_BELOW))
    is_found = probability >= FOUND_FROM and confirm >= 0.5
    label = _label(is_found, probability < LOST_BELOW and deny > 0.5)
    counts = ", ".join(
        f"{labels.count(name)} {name}" for name in reversed(LABELS) if name in labels
    )
    reasons = (f"By each of the {len(views)} photos alone it is: {counts}.",)
    return Verdict(label, probability, reasons, views=tuple(views))


def among(verdict: Verdict, tries: int) -> Verdict:
    """Judge a pose that is one of several tries' ends: each had its chance to look right.

    The odds are divided by the number of tries, as Bonferroni's correction divides the level.
    """
    probability = verdict.probability / (verdict.probability + tries * (1.0 - verdict.probability))
    is_found = verdict.label == "found" and probability >= FOUND_FROM
    label = _label(is_found, verdict.label == "lost" or probability < LOST_BELOW)
    return structs.replace(verdict, label=label, probability=probability)


def compress_feature(name: str, value: float) -> float:
    """Compress an unbounded feature by asinh: a logarithm that takes 0 and less."""
    return math.asinh(value) if name.endswith(("_margin", "_percent")) else value


def reasons_for(features: Features) -> tuple[str, ...]:
    """Return sentences for and against a pose."""
    holds = {
        "spread_percent": True,
        "rival_margin": features.rival_margin < LOW_RIVAL_MARGIN,
        "outline": True,
        "seen": features.seen < WHOLE_FROM,
        "alike": features.is_plain,
    }
    return tuple(sentence for name, sentence in _sentences(features).items() if holds[name])


def _sentences(features: Features) -> dict[str, str]:
    """Return a sentence on each feature."""
    spread, outline = features.spread_percent, features.outline
    margin = features.rival_margin
    is_back = spread < SMALL_SPREAD_PERCENT
    end = "came back to it" if is_back else f"ended {spread:.0f} % of the model's size away"
    fit = "better" if margin < 0.0 else "as well"
    how = "" if outline >= GOOD_OUTLINE else "only " if outline < POOR_OUTLINE else "some "
    share = percent(outline)
    turned = f"A search from a turned pose ends where the coarse photo fits {fit}"
    seen = f"Only {percent(features.seen)} of the model is seen"
    return {
        "spread_percent": f"Searches from near by {end}.",
        "rival_margin": f"{turned}: it may be turned.",
        "outline": f"Along {how}{share} of its outline the photo has an edge of that direction.",
        "seen": f"{seen}: the rest lies on pixels left out.",
        "alike": "The model is flat and of one colour there: its outline alone tells where it is.",
    }
