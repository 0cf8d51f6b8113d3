"""The verdict on a pose: found, doubtful or lost, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from poseviewer.fit.evidence import Evidence
from poseviewer.fit.verdict_reasons import reasons_for
from poseviewer.fit.verdict_weights import FEATURES, FOUND_FROM, LOST_BELOW, OFFSET

Word = Literal["found", "doubtful", "lost"]
WORDS: tuple[Word, ...] = ("lost", "doubtful", "found")
"""From bad to good."""
LARGEST_SCORE = 4.0
"""So many standard deviations from the mean of the trials it was made from, a number says no more
than that."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What to think of a pose."""

    word: Word
    probability: float
    """That the pose is right, in [0, 1], as among the trials that the verdict was calibrated on."""
    reasons: tuple[str, ...]
    """Sentences."""
    evidence: Evidence | None
    """None where there was nothing to see."""

    def __str__(self) -> str:
        return self.word


def judge(evidence: Evidence | None) -> Verdict:
    """The verdict that the evidence comes to; None: the model is not to be seen at the pose."""
    if evidence is None:
        return Verdict("lost", 0.0, ("Hardly anything of the model is to be seen there.",), None)
    probability = probability_of(evidence)
    word: Word = "doubtful"
    if probability >= FOUND_FROM:
        word = "found"
    elif probability < LOST_BELOW:
        word = "lost"
    return Verdict(word, probability, reasons_for(evidence), evidence)


def probability_of(evidence: Evidence) -> float:
    """By logistic regression on the evidence's numbers."""
    score = OFFSET
    for name, (mean, deviation, weight) in FEATURES.items():
        away = (tamed(name, getattr(evidence, name)) - mean) / deviation
        score += weight * min(max(away, -LARGEST_SCORE), LARGEST_SCORE)
    return 1.0 / (1.0 + math.exp(-score))


def tamed(name: str, value: float) -> float:
    """What has no bounds, by the inverse hyperbolic sine: a logarithm that can be 0 or less."""
    return math.asinh(value) if name.endswith(("_margin", "_percent")) else value
