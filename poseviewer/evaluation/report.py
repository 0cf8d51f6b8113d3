"""Tables and figures of trials: shares found, trust in the verdict, and BOP's average recalls."""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import NamedTuple, Self, TypeVar

import numpy as np
from scipy.stats import binomtest, quantile_test

from poseviewer.confidence.pose_covariance import REGION, region_reach
from poseviewer.evaluation.cases import visibility_label
from poseviewer.evaluation.plan import KINDS
from poseviewer.evaluation.trials import FOCAL_DEVIATIONS, Trial
from poseviewer.figures.study_sheet import Panel
from poseviewer.figures.text_table import Table
from poseviewer.fit.progress import Status
from poseviewer.geometry.arrays import FloatArray

Key = TypeVar("Key", bound=Hashable)
Column = Callable[[Sequence[Trial]], str]
NONE = "-"
"""Text of a cell without a value."""
LABELS = {str(kind): label for kind, label in KINDS.items()}
"""Labels of the kinds of photos."""
THRESHOLDS = {"mssd": np.arange(0.05, 0.501, 0.05), "mspd": np.arange(5.0, 50.1, 5.0)}
"""Thresholds of BOP: shares of the model's diameter; px of a photo that is 640 px wide."""


class Share(NamedTuple):
    """Share and its 95 % interval (Wilson, 1927), right for few and for none or all; per cent."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, trials: Iterable[Trial], test: Callable[[Trial], bool] = lambda t: t.found) -> Self:
        """Compute the share of trials that pass a test; nan where there are none."""
        flags = [test(trial) for trial in trials]
        if not flags:
            return cls(math.nan, math.nan, math.nan)
        interval = binomtest(sum(flags), len(flags)).proportion_ci(method="wilson")
        return cls(100.0 * sum(flags) / len(flags), 100.0 * interval.low, 100.0 * interval.high)

    def __str__(self) -> str:
        if math.isnan(self.value):
            return NONE
        return f"{self.value:.0f} ({self.low:.0f} to {self.high:.0f})"


def _values(trials: Iterable[Trial], name: str) -> FloatArray:
    return np.array([getattr(trial, name) for trial in trials], float)


def median(values: Iterable[float]) -> tuple[float, float, float]:
    """Return the median and its 95 % interval by order statistics (nan for under six values)."""
    array = np.array([*values])
    low, high = quantile_test(array, p=0.5).confidence_interval(0.95)
    return float(np.median(array)), float(low), float(high)


def _median(name: str, shown: str) -> Column:
    def column(trials: Sequence[Trial]) -> str:
        value, low, high = median(_values(trials, name))
        interval = f" ({low:{shown}} to {high:{shown}})" if low <= high else ""
        return f"{value:{shown}}{interval}"

    return column


def is_called_found(trial: Trial) -> bool:
    """Tell whether the verdict is ``found``."""
    return trial.verdict == "found"


COLUMNS: Mapping[str, Column] = {
    "start": _median("error_percent_start", ".2f"),
    "end": _median("error_percent_end", ".2f"),
    "evaluations": _median("evaluations", ".0f"),
    "seconds": _median("seconds", ".2g"),
}
"""Functions of trials by the heads of their columns."""


def study_table(trials: Sequence[Trial]) -> Table:
    """Tabulate fits by method, reading and photos: their kind, or set and visible share."""

    def line(trial: Trial) -> tuple[str, ...]:
        label = LABELS.get(trial.set, trial.set), visibility_label(trial.visible)
        return trial.method, trial.reading or "angle", ", ".join(filter(None, label)), trial.pixels

    deviations, rows = sorted({_deviation(trial) for trial in trials}), []
    for (method, reading, label, pixels), some in sorted(group_by(trials, line).items()):
        name = f"{method}: {label}" + ("" if pixels == "near" else f", {pixels}")
        at = group_by(some, _deviation)
        shares = (str(Share.of(at.get(deviation, ()))) for deviation in deviations)
        rows.append((name, reading, *shares, *(of(some) for of in COLUMNS.values())))
    offs = (f"{degrees}°" if degrees else f"{percent:g} %" for percent, degrees in deviations)
    title = "Fits that found the pose, % (95 % interval), by deviation"
    return Table(title, ("method: photos", "off by", *offs, *COLUMNS), tuple(rows))


def reliability_panels(trials: Sequence[Trial]) -> list[list[Panel]]:
    """Plot shares found by deviation: a row for each reading, a panel for each kind of photo."""
    percents, rows = sorted({trial.percent for trial in trials}), []
    axes = {"ylabel": "found, %", "ylim": (-3, 103), "xscale": "log", "xticks": percents}
    axes |= {"xticklabels": [f"{percent:g}" for percent in percents]}
    axes |= {"xlim": (percents[0] / 1.3, percents[-1] * 1.3)}
    for reading, of_reading in sorted(group_by(trials, lambda t: t.reading).items(), reverse=True):
        rows.append([])
        for kind, of_kind in group_by(of_reading, lambda t: t.set).items():
            lines = {
                name: [(x, *Share.of(at)) for x, at in group_by(own, lambda t: t.percent).items()]
                for name, own in group_by(of_kind, lambda t: f"{t.method}, {t.pixels}").items()
            }
            names = {"title": LABELS[kind], "xlabel": f"{reading} deviation, %"}
            rows[-1].append(Panel({k: sorted(v) for k, v in lines.items()}, axes | names))
    return rows


def calibration_table(trials: Iterable[Trial]) -> Table:
    """Tabulate the stated probability and the true share by what makes a case hard."""
    judged = [trial for trial in trials if not math.isnan(trial.probability)]
    strata: dict[str, list[Trial]] = {}
    for trial in judged:
        for name in filter(None, (visibility_label(trial.visible), *trial.traits.split(", "))):
            strata.setdefault(name, []).append(trial)
    rows = []
    for name, some in (("all", judged), *sorted(strata.items())) if judged else ():
        stated, called = _values(some, "probability").mean(), list(filter(is_called_found, some))
        right = str(Share.of(some)), str(len(called)), str(Share.of(called))
        rows.append((name, str(len(some)), f"{100.0 * stated:.0f}", *right))
    sure = [t for t in judged if is_called_found(t) and FOCAL_DEVIATIONS in t.evidence]
    reach = region_reach(1)
    for name, some in group_by(sure, lambda trial: LABELS.get(trial.set, trial.set)).items():
        right = Share.of(some, lambda t: t.evidence_by_name[FOCAL_DEVIATIONS] <= reach)
        name = f"{name}: focal length within {reach:.2f} stated deviations"
        rows.append((name, str(len(some)), f"{100.0 * REGION:.0f}", str(right), NONE, NONE))
    columns = "stratum", "fits", "stated", "right", "called found", "of these right"
    return Table("Stated probability of a right end, and true share, %", columns, tuple(rows))


def bop_table(trials: Sequence[Trial], targets: int) -> Table:
    """Tabulate average recalls before and after, of all targets and of each object's fits."""
    names = [f"{error}_{when}" for error in THRESHOLDS for when in ("start", "end")]
    rows = []
    for method, own in group_by(trials, lambda trial: f"{trial.method}, {trial.pixels}").items():
        objects = sorted(group_by(own, lambda trial: trial.set).items())
        groups = [("all targets", own, targets)]
        groups += [(f"fits of {name}", some, len(some)) for name, some in objects]
        for name, some, count in groups:
            shares = (average_recall(_values(some, n), THRESHOLDS[n[:4]], count) for n in names)
            recalls = (f"{share:.3f}" for share in shares)
            kept = Share.of(some, lambda trial: trial.status == Status.KEPT.name)
            tests = str(kept), str(Share.of(some, is_called_found)), COLUMNS["seconds"](some)
            rows.append((name, method, str(count), *recalls, *tests))
    recalls = ("MSSD before", "after", "MSPD before", "after")
    return Table(
        "Average recall of BOP's MSSD and MSPD, of the estimates and after the fits",
        ("targets", "method", "n", *recalls, "estimate kept, %", "called found, %", "seconds"),
        tuple(rows),
    )


def average_recall(errors: FloatArray, thresholds: FloatArray, targets: int) -> float:
    """Average the share of ``targets`` within each threshold, outside without an error."""
    return float((errors[:, None] < thresholds).sum(axis=0).mean()) / targets


def _deviation(trial: Trial) -> tuple[float, int]:
    return trial.percent, trial.degrees


def group_by(trials: Iterable[Trial], key: Callable[[Trial], Key]) -> dict[Key, list[Trial]]:
    """Group trials by a key, in the order in which keys come."""
    groups: dict[Key, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(key(trial), []).append(trial)
    return groups
