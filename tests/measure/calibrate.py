"""The verdict's weights, from fits with known poses: ``python -m tests.measure.calibrate TABLE``.

The tables are those of ``tests.measure.far_starts``, and ``trials.csv`` of ``poseviewer study
--real FOLDER --degrees 5,15,30 --draws 1 --out STUDY``. It prints how well the verdict tells right
from wrong on the half of the cases that it is made from and on the other; ``--write`` keeps the
weights. Truths that are farther off than their source says make right fits wrong: ``--accuracy SET
PERCENT``. Few photos hide the model: with ``--seen`` only the weight of the share that is seen
comes from the tables, as of tabletops from 15 degrees off, alone and ``--among-others``; the others
stay, and so do the limits.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from poseviewer.confidence import verdict as verdict_module
from poseviewer.confidence.verdict import MAX_SCORE, compress_feature
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError, SettingsError
from poseviewer.evaluation.trials import Trial
from poseviewer.figures.text_table import Table
from poseviewer.files.table import load_rows
from poseviewer.geometry.arrays import FloatArray
from tests.measure.far_starts import FarTrial
from tests.measure.real import is_tuning

VERDICT = Path(str(verdict_module.__file__))
BEGIN = "# Written by ``python -m tests.measure.calibrate --write``"
END = "# End of what is written.\n"
"""First and last line of the part of ``VERDICT`` that ``--write`` replaces."""
BEYOND_TRUTH_PERCENT = 1.0
"""Error beyond the truth's accuracy below which a fit is right, by the model's size, %."""
NAMES = ("rival_margin", "spread_percent", "outline", "seen")
"""Features that are weighed; few, as trials are."""
PENALTY = 1.0
"""Twice the cost of the weights' squared length: separable trials would have infinite weights."""
RIGHT_OF_FOUND, RIGHT_OF_LOST = 0.98, 0.3
"""Least share of right ones among ``found``, and largest among ``lost``, in the tuning half."""
FALLBACK = 0.9
"""Probability of ``found`` where none separates right and wrong so well."""
WORDS = "found", "doubtful", "lost"


@dataclass(frozen=True, slots=True)
class JudgedTrial:
    """A trial that has features."""

    case: str
    set: str
    right: bool
    features: tuple[float, ...]
    """Of ``NAMES``, as they are weighed."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A logistic model, and the two probabilities at which the verdict changes."""

    mean: FloatArray
    deviation: FloatArray
    weights: FloatArray
    """(k,) each."""
    offset: float
    found_from: float
    lost_below: float

    def words(self, probabilities: FloatArray) -> list[str]:
        """The verdict on each."""
        return [
            "found" if p >= self.found_from else "lost" if p < self.lost_below else "doubtful"
            for p in probabilities
        ]

    def probabilities(self, trials: Sequence[JudgedTrial]) -> FloatArray:
        """(N,): that each is right."""
        away = (np.array([trial.features for trial in trials]) - self.mean) / self.deviation
        score = np.clip(away, -MAX_SCORE, MAX_SCORE) @ self.weights + self.offset
        return 1.0 / (1.0 + np.exp(-score))


def load_judged(
    tables: Sequence[Path], accuracies: Mapping[str, float] | None = None
) -> list[JudgedTrial]:
    """Trials with features of studies' tables; ``accuracies``, %: truths' errors by their sets."""
    trials, known = [], dict(accuracies or {})
    for row in (row for path in tables for row in _load_table(path) if row.evidence_by_name):
        limit = known.get(row.set, row.accuracy_percent) + BEYOND_TRUTH_PERCENT
        weighed = tuple(compress_feature(name, row.evidence_by_name[name]) for name in NAMES)
        trials.append(JudgedTrial(row.case, row.set, row.error_percent_end < limit, weighed))
    sets = sorted({trial.set for trial in trials})
    if unknown := set(known) - set(sets):
        raise SettingsError(f"no trial of set {min(unknown)!r}; the tables' sets: {sets}")
    return trials


def _load_table(path: Path) -> list[Trial] | list[FarTrial]:
    """Rows of a table of either kind."""
    is_far = path.is_file() and path.read_text().startswith("case,set,kind,")
    return load_rows(path, FarTrial) if is_far else load_rows(path, Trial)


def calibrate(trials: Sequence[JudgedTrial]) -> Calibration:
    """Fit the model and its limits to trials; ``SettingsError``: all are right, or all wrong."""
    right = np.array([trial.right for trial in trials], bool)
    if len(set(right.tolist())) < 2:
        raise SettingsError(
            f"of {len(trials)} trials to tune on, {int(right.sum())} are right: there must be some "
            "of both; run more starts, or farther ones"
        )
    features = np.array([trial.features for trial in trials])
    mean, deviation = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-9)
    away = np.clip((features - mean) / deviation, -MAX_SCORE, MAX_SCORE)
    model = LogisticRegression(C=1.0 / PENALTY, solver="newton-cholesky", tol=1e-9).fit(away, right)
    probabilities = model.predict_proba(away)[:, 1]

    def share_right(chosen: np.ndarray, otherwise: float) -> float:
        return float(np.mean(right[chosen])) if chosen.any() else otherwise

    upwards, downwards = np.arange(0.5, 0.99, 0.01).round(2), np.arange(0.5, 0.01, -0.01).round(2)
    found = (p for p in upwards if share_right(probabilities >= p, 0.0) >= RIGHT_OF_FOUND)
    lost = (p for p in downwards if share_right(probabilities < p, 1.0) <= RIGHT_OF_LOST)
    found_from = float(next(found, FALLBACK))
    lost_below = min(float(next(lost, 1.0 - FALLBACK)), found_from)
    weights, offset = np.ravel(model.coef_), float(np.ravel(model.intercept_)[0])
    return Calibration(mean, deviation, weights, offset, found_from, lost_below)


def calibrate_seen(trials: Sequence[JudgedTrial]) -> Calibration:
    """The program's model and limits, with another weight of the share that is seen."""
    columns = np.array(list(verdict_module.FEATURES.values())).T
    limits = verdict_module.FOUND_FROM, verdict_module.LOST_BELOW
    known = Calibration(columns[0], columns[1], columns[2], verdict_module.OFFSET, *limits)
    right = np.array([trial.right for trial in trials], bool)

    def cost(weight: float) -> float:
        chances = replace(known, weights=np.array([*known.weights[:-1], weight]))
        away = np.abs(chances.probabilities(trials) - right)
        return 0.5 * PENALTY * weight**2 - float(np.sum(np.log(1.0 - away)))

    weight = minimize_scalar(cost, bounds=(0.0, 10.0), method="bounded").x
    return replace(known, weights=np.array([*known.weights[:-1], weight]))


def calibration_table(calibration: Calibration, trials: Sequence[JudgedTrial]) -> Table:
    """How well it does on the half it was tuned on and on the other, and there by set."""
    tuning = [trial for trial in trials if is_tuning(trial.case)]
    other = [trial for trial in trials if not is_tuning(trial.case)]
    groups = {"tuning half": tuning, "other half": other}
    for name in sorted({trial.set for trial in other}):
        groups[f"  {name}"] = [trial for trial in other if trial.set == name]
    rows = []
    for name, some in groups.items():
        right = np.array([trial.right for trial in some], bool)
        probabilities = calibration.probabilities(some)
        words = np.array(calibration.words(probabilities))
        both = 0 < right.sum() < len(right)
        area = f"{roc_auc_score(right, probabilities):.2f}" if both else ""
        counts = [((words == word).sum(), right[words == word].sum()) for word in WORDS]
        cells = [f"{given}, {correct} right" for given, correct in counts]
        rows.append((name, str(len(some)), str(int(right.sum())), area, *cells))
    return Table(
        "Right against wrong: area under the ROC curve; verdicts given, and how many are right",
        ("trials", "fits", "right", "area", *WORDS),
        tuple(rows),
    )


def weights_as_python(calibration: Calibration, trials: int, right: int) -> str:
    """The calibrated part of the module ``confidence.verdict``."""
    columns = NAMES, calibration.mean, calibration.deviation, calibration.weights
    features = "\n".join(
        f'    "{name}": ({mean:.4g}, {deviation:.4g}, {weight:.4g}),'
        for name, mean, deviation, weight in zip(*columns, strict=True)
    )
    return f'''{BEGIN} from {trials} trials, {right} of them right:
FEATURES: dict[str, tuple[float, float, float]] = {{
{features}
}}
"""Mean and standard deviation of each feature among the trials, and its weight."""
OFFSET = {calibration.offset:.4g}
"""Log odds of a pose whose features are the means."""
FOUND_FROM = {calibration.found_from:.4g}
"""Probability from which the verdict is ``found``."""
LOST_BELOW = {calibration.lost_below:.4g}
"""Probability below which the verdict is ``lost``."""
{END}'''


def written_part(module: str) -> str:
    """The part of the module's text that ``--write`` replaces."""
    return module[module.index(BEGIN) : module.index(END) + len(END)]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", type=Path, nargs="+", metavar="TRIALS.CSV")
    parser.add_argument("--accuracy", nargs=2, action="append", default=[])
    parser.add_argument("--seen", action="store_true", help="weigh the share seen alone")
    parser.add_argument("--write", action="store_true", help="keep the weights in the program")
    options = parser.parse_args(arguments)
    try:
        accuracies = {name: float(percent) for name, percent in options.accuracy}
        trials = load_judged(options.trials, accuracies)
        tuning = [trial for trial in trials if is_tuning(trial.case)]
        calibration = calibrate_seen(tuning) if options.seen else calibrate(tuning)
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    text = weights_as_python(calibration, len(tuning), sum(trial.right for trial in tuning))
    print(f"{calibration_table(calibration, trials).as_markdown()}\n\n{text}", end="")
    if options.write:
        module = VERDICT.read_text()
        VERDICT.write_text(module.replace(written_part(module), text))
    return 0


if __name__ == "__main__":
    sys.exit(main())
