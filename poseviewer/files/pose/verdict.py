"""The verdict on a pose, as a pose file says it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from poseviewer.files.pose.checks import Reading, kind_of

WORDS = ("found", "doubtful", "lost")


@dataclass(frozen=True, slots=True)
class RecordedVerdict:
    """What was thought of a pose when it was found."""

    word: str
    """``found``, ``doubtful`` or ``lost``."""
    probability: float
    """That the pose is right, in [0, 1]."""
    reasons: tuple[str, ...] = ()
    features: Mapping[str, float] = field(default_factory=dict)
    """The numbers that it comes from, by name."""


def verdict_as_json(verdict: RecordedVerdict) -> dict[str, Any]:
    """As JSON has it; numbers that are not finite are left out."""
    features = {name: float(value) for name, value in verdict.features.items()}
    return {
        "word": verdict.word,
        "probability": float(verdict.probability),
        "reasons": list(verdict.reasons),
        "evidence": {name: value for name, value in features.items() if math.isfinite(value)},
    }


def verdict_from_json(reading: Reading, value: Any) -> RecordedVerdict | None:
    """The verdict in a pose file; None where there is none.

    Raises:
        PoseFileError: it is not one.
    """
    if value is None:
        return None
    data = reading.object(value, "verdict")
    word = data.get("word")
    if word not in WORDS:
        raise reading.error(f"verdict.word is {kind_of(word)}", f"wanted {', '.join(WORDS)}")
    reasons = data.get("reasons", [])
    if not isinstance(reasons, list) or not all(isinstance(text, str) for text in reasons):
        raise reading.error(f"verdict.reasons is {kind_of(reasons)}", "wanted a list of texts")
    features = reading.object(data.get("evidence", {}), "verdict.evidence")
    return RecordedVerdict(
        word,
        reading.number(data.get("probability"), "verdict.probability"),
        tuple(reasons),
        {
            name: reading.number(number, f"verdict.evidence.{name}")
            for name, number in features.items()
        },
    )
