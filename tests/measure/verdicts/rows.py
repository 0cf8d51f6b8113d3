"""Trials of studies as evidence and answers: which fits ended right, and what they showed."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray

BEYOND_TRUTH_PERCENT = 1.0
"""A fit is right within the truth's own accuracy and so much of the model's size."""


@dataclass(frozen=True, slots=True)
class JudgedTrial:
    """A trial that has evidence."""

    case: str
    """Of which all trials are in one half: they tell of each other."""
    kind: str
    """Method and photos."""
    right: bool
    features: dict[str, float]
    verdict: str
    """As the trial's own program gave it."""
    set: str = ""
    """Of real photos; empty for others."""

    @property
    def tunes(self) -> bool:
        """Whether it is of the half that the verdict is made from; by a hash of the case's name."""
        return hashlib.sha256(self.case.encode()).digest()[0] % 2 == 0


def load_judged(
    tables: Sequence[Path], accuracies: Mapping[str, float] | None = None
) -> list[JudgedTrial]:
    """The trials of studies' ``trials.csv`` that have evidence. ``accuracies``, of sets of real
    photos by name, %: how far off their truths are, where that is more than their source says.

    Raises:
        SettingsError: a table cannot be read, or is not one of trials.
    """
    found, known = [], dict(accuracies or {})
    for path in tables:
        try:
            with path.open(newline="", encoding="utf-8") as file:
                rows = [row for row in csv.DictReader(file) if row["evidence"]]
            found += [_judged(row, known) for row in rows]
        except OSError as error:
            raise SettingsError(
                f"{path}: cannot be read ({error.strerror}); name a trials.csv of poseviewer study"
            ) from None
        except (KeyError, ValueError, TypeError) as error:
            raise SettingsError(
                f"{path}: is not a table of trials with evidence ({error}); "
                "make one with poseviewer study"
            ) from None
    unknown = set(known) - {trial.set for trial in found}
    if unknown:
        sets = ", ".join(sorted({trial.set for trial in found} - {""})) or "none"
        raise SettingsError(f"no trial of set {min(unknown)!r}; the tables' sets: {sets}")
    return found


def _judged(row: dict[str, str], accuracies: Mapping[str, float]) -> JudgedTrial:
    features, verdict = _features(row["evidence"]), row["verdict"]
    if "case" in row:
        name = row["set"]
        most = accuracies.get(name, float(row["accuracy_percent"])) + BEYOND_TRUTH_PERCENT
        right = float(row["error_percent_end"]) < most
        return JudgedTrial(row["case"], f"{row['method']}, {name}", right, features, verdict, name)
    case = f"{row['kind']}-{row['photo']}"
    right = row["found"] == "True"
    return JudgedTrial(case, f"{row['method']}, {row['kind']}", right, features, verdict)


def _features(text: str) -> dict[str, float]:
    return {name: float(value) for name, value in (part.split("=", 1) for part in text.split())}


def numbers_of(trials: Sequence[JudgedTrial], names: Sequence[str]) -> FloatArray:
    """(N, k): the named numbers of the evidence.

    Raises:
        SettingsError: a trial has no such number.
    """
    try:
        return np.array([[trial.features[name] for name in names] for trial in trials])
    except KeyError as error:
        raise SettingsError(
            f"the evidence of a trial has no {error}: it is of another version; run it again"
        ) from None


def answers_of(trials: Sequence[JudgedTrial]) -> NDArray[np.bool_]:
    """(N,): which are right."""
    return np.array([trial.right for trial in trials], bool)
