"""The verdict's weights, made from studies: ``python -m tests.measure.calibrate_verdict``.

::

    poseviewer study --real FOLDER --degrees 5,15,30 --draws 1 --out STUDY
    python -m tests.measure.calibrate_verdict STUDY/trials.csv

prints how well the verdict tells right from wrong, on the half of the cases that it is made from
and on the other half; ``--write`` keeps the weights in ``poseviewer/confidence/weights.py``. Where
only the features have changed, ``--anew FOLDER`` computes them again at the ends that the table
holds, in a fourth of the time of the fits, into a table beside it. Truths that are farther off than
their source says make right fits wrong: ``--accuracy SET=PERCENT`` says how far
(``tests.measure.agreement`` shows such sets).
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from poseviewer.confidence import weights as verdict_weights
from poseviewer.confidence.features import gather_features
from poseviewer.confidence.model import LARGEST_SCORE, judge, scaled
from poseviewer.errors import EXIT_MENDABLE, PoseViewerError, SettingsError
from poseviewer.evaluation.real_cases import load_cases, load_starts
from poseviewer.evaluation.trials import RealTask, features_as_text
from poseviewer.figures.text_table import Table
from poseviewer.files.writing import write_whole
from poseviewer.fit.problem import make_problem
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray

WEIGHTS = Path(str(verdict_weights.__file__))
BEYOND_TRUTH_PERCENT = 1.0
"""A fit is right within the truth's own accuracy and this share of the model's size, %."""
NAMES = ("turn_margin", "spread_percent", "outline")
"""The features that are weighed; few, as trials are."""
PENALTY = 1.0
"""Half of it times the squared length of the weights is what they cost: few trials want one, or
separable ones would have infinite weights."""
RIGHT_OF_FOUND, RIGHT_OF_LOST = 0.98, 0.3
"""Least share of right ones among ``found``, and largest among ``lost``, in the tuning half."""
FALLBACK = 0.9
"""The probability of ``found`` where none separates right and wrong so well."""


@dataclass(frozen=True, slots=True)
class JudgedTrial:
    """A trial that has features."""

    case: str
    """All trials of a case are in one half, as they tell of each other."""
    kind: str
    """Method and photos."""
    right: bool
    features: dict[str, float]
    set: str = ""
    """Of real photos; empty for others."""

    @property
    def tunes(self) -> bool:
        """Whether it is of the half that the verdict is made from; by a hash of the case's name."""
        return hashlib.sha256(self.case.encode()).digest()[0] % 2 == 0


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A logistic model, and the two probabilities at which the verdict changes."""

    mean: FloatArray
    deviation: FloatArray
    weights: FloatArray
    """(k,) each."""
    offset: float
    found_from: float = FALLBACK
    lost_below: float = 1.0 - FALLBACK

    def probabilities(self, trials: Sequence[JudgedTrial]) -> FloatArray:
        """(N,): that each is right."""
        away = (scaled_features(trials) - self.mean) / self.deviation
        score = np.clip(away, -LARGEST_SCORE, LARGEST_SCORE) @ self.weights + self.offset
        return 1.0 / (1.0 + np.exp(-score))

    def words(self, trials: Sequence[JudgedTrial]) -> list[str]:
        """The verdict on each."""
        return [
            "found" if p >= self.found_from else "lost" if p < self.lost_below else "doubtful"
            for p in self.probabilities(trials)
        ]


def load_judged(
    tables: Sequence[Path], accuracies: Mapping[str, float] | None = None
) -> list[JudgedTrial]:
    """The trials of studies' ``trials.csv`` that have features. ``accuracies``, of sets of real
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
    pairs = (part.split("=", 1) for part in row["evidence"].split())
    features = {name: float(value) for name, value in pairs}
    if "case" not in row:
        case, kind = f"{row['kind']}-{row['photo']}", f"{row['method']}, {row['kind']}"
        return JudgedTrial(case, kind, row["found"] == "True", features)
    name = row["set"]
    most = accuracies.get(name, float(row["accuracy_percent"])) + BEYOND_TRUTH_PERCENT
    right = float(row["error_percent_end"]) < most
    return JudgedTrial(row["case"], f"{row['method']}, {name}", right, features, name)


def scaled_features(trials: Sequence[JudgedTrial]) -> FloatArray:
    """(N, k): the features that are weighed.

    Raises:
        SettingsError: a trial has no such feature.
    """
    try:
        rows = [[scaled(name, trial.features[name]) for name in NAMES] for trial in trials]
    except KeyError as error:
        raise SettingsError(
            f"the evidence of a trial has no {error}: it is of another version; run it again"
        ) from None
    return np.array(rows).reshape(len(trials), len(NAMES))


def answers_of(trials: Sequence[JudgedTrial]) -> NDArray[np.bool_]:
    """(N,): which are right."""
    return np.array([trial.right for trial in trials], bool)


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
    features = scaled_features(trials)
    mean, deviation = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-9)
    away = np.clip((features - mean) / deviation, -LARGEST_SCORE, LARGEST_SCORE)
    model = LogisticRegression(C=1.0 / PENALTY, solver="newton-cholesky", tol=1e-9).fit(away, right)
    offset = float(np.ravel(model.intercept_)[0])
    plain = Calibration(mean, deviation, np.ravel(model.coef_), offset)
    probabilities = plain.probabilities(trials)
    found_from = next(
        (
            float(level)
            for level in np.round(np.arange(0.5, 0.99, 0.01), 2)
            if (above := probabilities >= level).any() and np.mean(right[above]) >= RIGHT_OF_FOUND
        ),
        FALLBACK,
    )
    lost_below = next(
        (
            float(level)
            for level in np.round(np.arange(0.5, 0.01, -0.01), 2)
            if (below := probabilities < level).any() and np.mean(right[below]) <= RIGHT_OF_LOST
        ),
        1.0 - FALLBACK,
    )
    return Calibration(
        mean, deviation, plain.weights, offset, found_from, min(lost_below, found_from)
    )


def calibration_table(calibration: Calibration, trials: Sequence[JudgedTrial]) -> Table:
    """How well it does on the half it was tuned on and on the other, and there by kind."""
    other = [trial for trial in trials if not trial.tunes]
    rows = [("tuning half", [trial for trial in trials if trial.tunes]), ("other half", other)]
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
    right, words = answers_of(trials), np.array(calibration.words(trials))
    both = 0 < right.sum() < len(right)
    area = roc_auc_score(right, calibration.probabilities(trials)) if both else np.nan
    cells = [
        f"{int((words == word).sum())}, {int(right[words == word].sum())} right"
        for word in ("found", "doubtful", "lost")
    ]
    return name, str(len(trials)), str(int(right.sum())), f"{area:.2f}", *cells


def weights_as_python(calibration: Calibration, trials: Sequence[JudgedTrial]) -> str:
    """The module ``confidence.weights``."""
    right = answers_of([trial for trial in trials if trial.tunes])
    columns = NAMES, calibration.mean, calibration.deviation, calibration.weights
    features = "\n".join(
        f'    "{name}": ({mean:.4g}, {deviation:.4g}, {weight:.4g}),'
        for name, mean, deviation, weight in zip(*columns, strict=True)
    )
    return f'''"""How much each number of the evidence weighs; written by
``python -m tests.measure.calibrate_verdict --write`` from {len(right)} trials, {
        right.sum()
    } of them right.
"""

FEATURES: dict[str, tuple[float, float, float]] = {{
{features}
}}
"""Of each number: mean and standard deviation among the trials, and its weight."""
OFFSET = {calibration.offset:.4g}
FOUND_FROM, LOST_BELOW = {calibration.found_from:.4g}, {calibration.lost_below:.4g}
"""Probabilities from which on, and below which, the verdict is ``found`` and ``lost``."""
'''


def gather_anew(table: Path, folder: Path, tell: Callable[[str], object]) -> Path:
    """A table like that of a ``study --real FOLDER`` with the features computed again at its ends;
    its path, beside the old one.

    Raises:
        SettingsError: the table cannot be read, or is not one of real trials.
        PoseFileError: the folder does not hold its cases.
    """
    try:
        with table.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        wanted = [(row["case"], int(row["degrees"]), int(row["draw"])) for row in rows]
    except (OSError, KeyError, ValueError) as error:
        raise SettingsError(
            f"{table}: is not a table of study --real ({error}); name one of its trials.csv"
        ) from None
    cases = {case.name: case for case in load_cases(folder)}
    degrees, draws = {found[1] for found in wanted}, max((found[2] for found in wanted), default=0)
    starts = {
        (start.case, start.degrees, start.draw): start
        for start in load_starts(folder, sorted(degrees), draws + 1)
    }
    for index, (row, key) in enumerate(zip(rows, wanted, strict=True), 1):
        if not row["end"]:
            continue
        settings = FitSettings(row["method"], "free-body", pixels=row["pixels"])  # type: ignore[arg-type]
        registration, renderer = RealTask(cases[key[0]], starts[key], settings).open()
        problem, _ = make_problem(registration, settings)
        pose = problem.chart.to_pose(np.array(row["end"].split(), float))
        features = gather_features(problem, registration.mesh, renderer, pose)
        row["evidence"], row["verdict"] = features_as_text(features), judge(features).word
        tell(f"{index} of {len(rows)}: {row['case']}, {row['verdict']}\n")
    text = StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    path = table.with_name(f"{table.stem}-anew.csv")
    write_whole(path, text.getvalue().encode(), SettingsError)
    return path


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate on the tables that are named; say how well that does."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("trials", type=Path, nargs="+", metavar="TRIALS.CSV", help="of studies")
    parser.add_argument("--anew", type=Path, metavar="FOLDER", help="compute the features again")
    parser.add_argument(
        *("--accuracy", "-a"),
        type=_accuracy,
        action="append",
        default=[],
        metavar="SET=PERCENT",
        help="how far off the truths of a set are, instead of what the table says",
    )
    parser.add_argument("--write", action="store_true", help="keep the weights in the program")
    options = parser.parse_args(arguments)
    try:
        tables = options.trials
        if options.anew:
            tables = [gather_anew(path, options.anew, sys.stderr.write) for path in tables]
        trials = load_judged(tables, dict(options.accuracy))
        found = calibrate([trial for trial in trials if trial.tunes])
        text = weights_as_python(found, trials)
        print(f"{calibration_table(found, trials).as_text()}\n\n{text}", end="")
        if options.write:
            write_whole(WEIGHTS, text.encode(), SettingsError)
            print(f"\nweights: {WEIGHTS}")
    except PoseViewerError as error:
        sys.stderr.write(f"poseviewer: {error}\n")
        return EXIT_MENDABLE
    return 0


def _accuracy(text: str) -> tuple[str, float]:
    name, _, percent = text.rpartition("=")
    try:
        value = float(percent)
    except ValueError:
        value = -1.0
    if not name or not 0.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"{text!r}; wanted SET=PERCENT, such as lmo=6")
    return name, value


if __name__ == "__main__":
    sys.exit(main())
