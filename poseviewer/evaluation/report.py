"""What the trials come to: shares of fits that found the pose, and how sure they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import binomtest

from poseviewer.evaluation.photos import KINDS
from poseviewer.evaluation.trials import READINGS, RealTrial, Trial
from poseviewer.figures.study_sheet import ReliabilityLine, ReliabilityPanel
from poseviewer.figures.text_table import Table

NONE = "–"  # noqa: RUF001 - a dash in a table
LABELS = {str(kind): label for kind, label in KINDS.items()}
Line = tuple[str, str, str, str]
"""Method, reading, kind of photo, pixels."""


def wilson_interval(found: int, trials: int) -> tuple[float, float]:
    """The 95 % interval of a share, in [0, 1]; unlike the normal approximation it is right for few
    trials too, and for none or all found (Wilson, 1927).
    """
    interval = binomtest(found, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def _lines(trials: Sequence[Trial]) -> dict[Line, list[Trial]]:
    """Trials of one method, reading, kind and pixels; in this order."""
    lines: dict[Line, list[Trial]] = {}
    for trial in trials:
        where = trial.method, trial.reading, trial.kind, trial.pixels
        lines.setdefault(where, []).append(trial)
    readings, kinds = [str(reading) for reading in READINGS], [*LABELS]

    def order(line: Line) -> tuple[str, int, int, str]:
        return line[0], readings.index(line[1]), kinds.index(line[2]), line[3]

    return {line: lines[line] for line in sorted(lines, key=order)}


def _reliability(line: Line, trials: Sequence[Trial]) -> ReliabilityLine:
    label = LABELS[line[2]] if line[3] == "near" else f"{LABELS[line[2]]}, {line[3]}"
    percents = sorted({trial.percent for trial in trials})
    counts = []
    for percent in percents:
        found = [trial.found for trial in trials if trial.percent == percent]
        counts.append((sum(found), len(found)))
    intervals = [wilson_interval(*count) for count in counts]
    return ReliabilityLine(
        label,
        tuple(percents),
        tuple(found / count for found, count in counts),
        tuple(low for low, _ in intervals),
        tuple(high for _, high in intervals),
    )


def study_table(trials: Sequence[Trial]) -> Table:
    """A row for each method, reading, kind and pixels, a column for each deviation."""
    percents = sorted({trial.percent for trial in trials})
    rows = []
    for line, some in _lines(trials).items():
        found = _reliability(line, some)
        cells = {
            percent: f"{100 * share:.0f} ({100 * low:.0f} to {100 * high:.0f})"
            for percent, share, low, high in zip(
                found.percent, found.share, found.low, found.high, strict=True
            )
        }
        rows.append(
            (
                f"{line[0]}: {found.label}",
                line[1],
                *(cells.get(percent, NONE) for percent in percents),
                f"{np.median([trial.evaluations for trial in some]):.0f}",
                f"{np.median([trial.seconds for trial in some]):.2g}",
            )
        )
    columns = (
        *("method: photos", "off by"),
        *(f"{percent:g} %" for percent in percents),
        *("evaluations", "seconds"),
    )
    return Table("Fits that found the pose, % (95 % interval), by deviation", columns, tuple(rows))


def study_panels(trials: Sequence[Trial]) -> list[list[ReliabilityPanel]]:
    """For the figure: a row for each method, a column for each reading."""
    lines = _lines(trials)
    panels = []
    for method in dict.fromkeys(line[0] for line in lines):
        row = []
        for reading in (r for r in READINGS if any(line[1] == r for line in lines)):
            size = "own value" if reading == "relative" else "span"
            own = [
                _reliability(line, some)
                for line, some in lines.items()
                if line[:2] == (method, reading)
            ]
            title = f"method {method}, {reading}"
            row.append(
                ReliabilityPanel(title, f"each number off by up to ... % of its {size}", tuple(own))
            )
        panels.append(row)
    return panels


def real_table(trials: Sequence[RealTrial], case_groups: Mapping[str, str]) -> Table:
    """A row for each group of cases (those that ``case_groups`` does not name: their set), method
    and deviation: medians of the errors, and shares of the fits.
    """
    groups: dict[tuple[str, str, str, int], list[RealTrial]] = {}
    for trial in trials:
        group = case_groups.get(trial.case, trial.set)
        where = group, trial.method, trial.pixels, trial.degrees
        groups.setdefault(where, []).append(trial)
    return Table(
        "Error as a share of the model's size in the photo, %; medians, and shares of the fits",
        (
            *("photos", "method", "off by", "fits", "start", "end", "improved"),
            *("found", "+2 %", "made worse", "called found", "of these wrongly"),
            *("loss below truth's", "seconds"),
        ),
        tuple(_real_row(where, groups[where]) for where in sorted(groups)),
    )


def _real_row(where: tuple[str, str, str, int], trials: Sequence[RealTrial]) -> tuple[str, ...]:
    """``found``: within the truth's accuracy + 1 %. ``made worse``: by more than that accuracy.
    ``called found`` is the verdict's word, ``wrongly`` beyond the accuracy + 2 %.
    """
    name, method, pixels, degrees = where
    start = np.array([trial.error_percent_start for trial in trials])
    end = np.array([trial.error_percent_end for trial in trials])
    accuracy = np.array([trial.accuracy_percent for trial in trials])
    called = np.array([trial.verdict == "found" for trial in trials])
    shares = (
        end < start,
        end < accuracy + 1.0,
        end < accuracy + 2.0,
        end > start + accuracy,
        called,
        end[called] > accuracy[called] + 2.0,
        [trial.loss_end < trial.loss_truth for trial in trials],
    )
    return (
        *(name, f"{method}, {pixels}", f"{degrees}°", str(len(trials))),
        *(f"{np.median(start):.2f}", f"{np.median(end):.2f}"),
        *(f"{np.mean(share):.0%}" if len(share) else "-" for share in shares),
        f"{np.median([trial.seconds for trial in trials]):.2g}",
    )
