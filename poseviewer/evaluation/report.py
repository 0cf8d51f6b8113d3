"""Tables of trials: shares of fits that found the pose by deviation, and BOP's average recalls."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from scipy.stats import binomtest

from poseviewer.evaluation.plan import KINDS
from poseviewer.evaluation.trials import FOUND_PERCENT, Trial
from poseviewer.figures.text_table import Table
from poseviewer.fit.progress import Status
from poseviewer.geometry.arrays import FloatArray

Key = TypeVar("Key", bound=Hashable)
Column = Callable[[Sequence[Trial]], str]
NONE = "-"
WRONG_PERCENT = 2.0
"""Error beyond the truth's own from which a pose that is called found counts as wrong."""
LABELS = {str(kind): label for kind, label in KINDS.items()}
THRESHOLDS = {"mssd": np.arange(0.05, 0.501, 0.05), "mspd": np.arange(5.0, 50.1, 5.0)}
"""Shares of the model's diameter; px of a photo that is 640 px wide."""


def _values(trials: Iterable[Trial], name: str) -> FloatArray:
    return np.array([getattr(trial, name) for trial in trials], float)


def _median(name: str, shown: str) -> Column:
    return lambda trials: format(np.median(_values(trials, name)), shown)


def _share(test: Callable[[Trial], bool], among: Callable[[Trial], bool] | None = None) -> Column:
    def share(trials: Sequence[Trial]) -> str:
        tested = [test(trial) for trial in trials if among is None or among(trial)]
        return f"{np.mean(tested):.0%}" if tested else NONE

    return share


def _is_called_found(trial: Trial) -> bool:
    return trial.verdict == "found"


def _is_worse(trial: Trial) -> bool:
    margin = max(trial.accuracy_percent, FOUND_PERCENT)
    return trial.error_percent_end > trial.error_percent_start + margin


def _is_wrong(trial: Trial) -> bool:
    return trial.error_percent_end > trial.accuracy_percent + WRONG_PERCENT


COLUMNS: Mapping[str, Column] = {
    "start": _median("error_percent_start", ".2f"),
    "end": _median("error_percent_end", ".2f"),
    "improved": _share(lambda trial: trial.error_percent_end < trial.error_percent_start),
    "made worse": _share(_is_worse),
    "called found": _share(_is_called_found),
    "of these wrongly": _share(_is_wrong, _is_called_found),
    "loss below truth's": _share(lambda trial: trial.loss_end < trial.loss_truth),
    "evaluations": _median("evaluations", ".0f"),
    "seconds": _median("seconds", ".2g"),
}


def study_table(trials: Sequence[Trial], groups: Mapping[str, str]) -> Table:
    """Tabulate fits by method, reading and group of photos: that of ``groups``, else the set."""

    def line(trial: Trial) -> tuple[str, ...]:
        group = groups.get(trial.case, trial.set)
        return trial.method, trial.reading or "angle", LABELS.get(group, group), trial.pixels

    deviations, rows = sorted({_deviation(trial) for trial in trials}), []
    for (method, reading, label, pixels), some in sorted(_grouped(trials, line).items()):
        name = f"{method}: {label}" + ("" if pixels == "near" else f", {pixels}")
        at = _grouped(some, _deviation)
        shares = (_interval(at.get(deviation, ())) for deviation in deviations)
        rows.append((name, reading, *shares, *(of(some) for of in COLUMNS.values())))
    offs = (f"{degrees}°" if degrees else f"{percent:g} %" for percent, degrees in deviations)
    title = "Fits that found the pose, % (95 % interval), by deviation"
    return Table(title, ("method: photos", "off by", *offs, *COLUMNS), tuple(rows))


def bop_table(trials: Sequence[Trial], targets: int) -> Table:
    """Tabulate average recalls before and after, of all targets and of each object's fits."""
    names = [f"{error}_{when}" for error in THRESHOLDS for when in ("start", "end")]
    is_kept, rows = _share(lambda trial: trial.status == Status.KEPT.name), []
    for method, own in _grouped(trials, lambda trial: f"{trial.method}, {trial.pixels}").items():
        objects = sorted(_grouped(own, lambda trial: trial.set).items())
        groups = [("all targets", own, targets)]
        groups += [(f"fits of {name}", some, len(some)) for name, some in objects]
        for name, some, count in groups:
            shares = (average_recall(_values(some, n), THRESHOLDS[n[:4]], count) for n in names)
            columns = is_kept, COLUMNS["called found"], COLUMNS["seconds"]
            recalls = (f"{share:.3f}" for share in shares)
            rows.append((name, method, str(count), *recalls, *(of(some) for of in columns)))
    recalls = ("MSSD before", "after", "MSPD before", "after")
    return Table(
        "Average recall of BOP's MSSD and MSPD, of the estimates and after the fits",
        ("targets", "method", "n", *recalls, "estimate kept", "called found", "seconds"),
        tuple(rows),
    )


def average_recall(errors: FloatArray, thresholds: FloatArray, targets: int) -> float:
    """Share of ``targets`` within a threshold, mean over thresholds; no error counts as outside."""
    return float((errors[:, None] < thresholds).sum(axis=0).mean()) / targets


def _deviation(trial: Trial) -> tuple[float, int]:
    return trial.percent, trial.degrees


def _grouped(trials: Sequence[Trial], key: Callable[[Trial], Key]) -> dict[Key, list[Trial]]:
    groups: dict[Key, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(key(trial), []).append(trial)
    return groups


def _interval(trials: Sequence[Trial]) -> str:
    """Share found and its interval (Wilson, 1927), right for few trials and for none or all."""
    if not trials:
        return NONE
    count = sum(trial.found for trial in trials)
    interval = binomtest(count, len(trials)).proportion_ci(method="wilson")
    low, high = 100.0 * interval.low, 100.0 * interval.high
    return f"{100.0 * count / len(trials):.0f} ({low:.0f} to {high:.0f})"
