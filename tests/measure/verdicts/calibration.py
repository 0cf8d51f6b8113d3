"""The verdict's weights from one half of the trials, and how well they tell right from wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.model import LARGEST_SCORE, tamed
from poseviewer.errors import SettingsError
from poseviewer.figures.text_table import Table
from poseviewer.geometry.arrays import FloatArray
from tests.measure.verdicts.logistic import LogisticModel, area_under_roc, fit_logistic
from tests.measure.verdicts.rows import JudgedTrial, answers_of, numbers_of

NAMES = ("turn_margin", "spread_percent", "outline")
"""The numbers of the evidence that are weighed; few, as trials are."""
PENALTY = 1.0
"""Half of it times the squared length of the weights is what they cost."""
RIGHT_OF_FOUND, RIGHT_OF_LOST = 0.98, 0.3
FALLBACK = 0.9
"""Where no probability separates them so well, it has to be at least so sure itself."""
"""``found`` are to be right at least so often, ``lost`` at most so often, in the tuning half."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A model and the two probabilities at which its words change."""

    model: LogisticModel
    found_from: float
    lost_below: float

    def probabilities(self, trials: Sequence[JudgedTrial]) -> FloatArray:
        """(N,): that each is right."""
        return self.model.probabilities(_tamed_numbers(trials))

    def words(self, trials: Sequence[JudgedTrial]) -> list[str]:
        """The verdict on each."""
        return [
            "found" if p >= self.found_from else "lost" if p < self.lost_below else "doubtful"
            for p in self.probabilities(trials)
        ]


def calibrate(trials: Sequence[JudgedTrial]) -> Calibration:
    """From all the trials given.

    Raises:
        SettingsError: they are all right, or all wrong.
    """
    right = answers_of(trials)
    if len(set(right.tolist())) < 2:
        raise SettingsError(
            f"of {len(trials)} trials to tune on, {int(right.sum())} are right: there must be some "
            "of both; run more starts, or farther ones"
        )
    model = fit_logistic(_tamed_numbers(trials), right, PENALTY, LARGEST_SCORE)
    probabilities = model.probabilities(_tamed_numbers(trials))
    found_from = _found_from(probabilities, right)
    return Calibration(model, found_from, min(_lost_below(probabilities, right), found_from))


def _found_from(probabilities: FloatArray, right: NDArray[np.bool_]) -> float:
    """The least probability, 1/2 at least, from which on enough are right."""
    for level in np.round(np.arange(0.5, 0.99, 0.01), 2):
        above = probabilities >= level
        if above.any() and np.mean(right[above]) >= RIGHT_OF_FOUND:
            return float(level)
    return FALLBACK


def _lost_below(probabilities: FloatArray, right: NDArray[np.bool_]) -> float:
    """The greatest probability, 1/2 at most, below which few enough are right."""
    for level in np.round(np.arange(0.5, 0.01, -0.01), 2):
        below = probabilities < level
        if below.any() and np.mean(right[below]) <= RIGHT_OF_LOST:
            return float(level)
    return 1.0 - FALLBACK


def _tamed_numbers(trials: Sequence[JudgedTrial]) -> FloatArray:
    plain = numbers_of(trials, NAMES)
    columns = [[tamed(name, float(x)) for x in plain[:, i]] for i, name in enumerate(NAMES)]
    return np.array(columns).T.reshape(len(trials), len(NAMES))


def calibration_table(calibration: Calibration, trials: Sequence[JudgedTrial]) -> Table:
    """How well it does on the half it was tuned on and on the other, and there by kind."""
    tuning = [trial for trial in trials if trial.tunes]
    other = [trial for trial in trials if not trial.tunes]
    rows = [("tuning half", tuning), ("other half", other)]
    kinds = sorted({trial.kind for trial in other})
    rows += [(f"  {kind}", [trial for trial in other if trial.kind == kind]) for kind in kinds]
    return Table(
        "Right against wrong: area under the ROC curve; verdicts given, and how many are right",
        ("trials", "fits", "right", "area", "found", "doubtful", "lost"),
        tuple(_row(name, calibration, some) for name, some in rows),
    )


def _row(name: str, calibration: Calibration, trials: Sequence[JudgedTrial]) -> tuple[str, ...]:
    if not trials:
        return name, "0", *("",) * 5
    right = answers_of(trials)
    area = area_under_roc(calibration.probabilities(trials), right)
    words = np.array(calibration.words(trials))
    cells = [
        f"{int((words == word).sum())}, {int(right[words == word].sum())} right"
        for word in ("found", "doubtful", "lost")
    ]
    return name, str(len(trials)), str(int(right.sum())), f"{area:.2f}", *cells
