"""What the trials of the study come to: shares of fits that found the pose, and how sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from poseviewer.figures.study_sheet import ReliabilityLine, ReliabilityPanel
from poseviewer.figures.text_table import Table
from poseviewer.study.deviations import READINGS
from poseviewer.study.photos import KINDS
from poseviewer.study.trial import Trial
from poseviewer.study.wilson import wilson_interval

NONE = "–"  # noqa: RUF001 - a dash in a table
LABELS = {str(kind): label for kind, label in KINDS.items()}


@dataclass(frozen=True, slots=True)
class Rate:
    """Trials that differ in their draw alone."""

    percent: float
    trials: int
    found: int

    @property
    def share(self) -> float:
        """In [0, 1]."""
        return self.found / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """In [0, 1], of 95 %."""
        return wilson_interval(self.found, self.trials)


@dataclass(frozen=True, slots=True)
class Line:
    """How reliable one method is on one kind of photo, by one reading of the deviation."""

    method: str
    kind: str
    pixels: str
    reading: str
    rates: tuple[Rate, ...]
    """By deviation."""
    seconds: float
    evaluations: float
    """Medians of all its fits."""

    @property
    def label(self) -> str:
        """The photos, and which pixels count where a method has more than one choice."""
        label = LABELS.get(self.kind, self.kind)
        return label if self.pixels == "near" else f"{label}, {self.pixels}"


def lines_of(trials: Sequence[Trial]) -> list[Line]:
    """The trials, gathered; by method, reading and kind."""
    groups: dict[tuple[str, str, str, str], list[Trial]] = {}
    for trial in trials:
        where = trial.method, trial.reading, trial.kind, trial.pixels
        groups.setdefault(where, []).append(trial)
    kinds = [*LABELS, ""]

    def order(where: tuple[str, str, str, str]) -> tuple[str, int, int, str]:
        return where[0], READINGS.index(where[1]), kinds.index(where[2]), where[3]  # type: ignore[arg-type]

    return [_line(*where, groups[where]) for where in sorted(groups, key=order)]


def _line(method: str, reading: str, kind: str, pixels: str, trials: Sequence[Trial]) -> Line:
    rates = []
    for percent in sorted({trial.percent for trial in trials}):
        found = [trial.found for trial in trials if trial.percent == percent]
        rates.append(Rate(percent, len(found), sum(found)))
    return Line(
        method,
        kind,
        pixels,
        reading,
        tuple(rates),
        float(np.median([trial.seconds for trial in trials])),
        float(np.median([trial.evaluations for trial in trials])),
    )


def study_table(lines: Sequence[Line]) -> Table:
    """A row for each line, a column for each deviation."""
    percents = sorted({rate.percent for line in lines for rate in line.rates})
    rows = []
    for line in lines:
        cells = {rate.percent: _cell(rate) for rate in line.rates}
        rows.append(
            (
                f"{line.method}: {line.label}",
                line.reading,
                *(cells.get(percent, NONE) for percent in percents),
                f"{line.evaluations:.0f}",
                f"{line.seconds:.2g}",
            )
        )
    columns = (
        *("method: photos", "off by"),
        *(f"{percent:g} %" for percent in percents),
        *("evaluations", "seconds"),
    )
    return Table("Fits that found the pose, % (95 % interval), by deviation", columns, tuple(rows))


def _cell(rate: Rate) -> str:
    low, high = rate.interval
    return f"{100 * rate.share:.0f} ({100 * low:.0f} to {100 * high:.0f})"


def panels_of(lines: Sequence[Line]) -> list[list[ReliabilityPanel]]:
    """For the figure: a row for each method, a column for each reading."""
    methods = list(dict.fromkeys(line.method for line in lines))
    readings = [r for r in READINGS if any(line.reading == r for line in lines)]
    return [[_panel(m, r, lines) for r in readings] for m in methods]


def _panel(method: str, reading: str, lines: Sequence[Line]) -> ReliabilityPanel:
    size = "own value" if reading == "relative" else "span"
    return ReliabilityPanel(
        f"method {method}, {reading}",
        f"each number off by up to ... % of its {size}",
        tuple(
            ReliabilityLine(
                line.label,
                tuple(rate.percent for rate in line.rates),
                tuple(rate.share for rate in line.rates),
                tuple(rate.interval[0] for rate in line.rates),
                tuple(rate.interval[1] for rate in line.rates),
            )
            for line in lines
            if line.method == method and line.reading == reading
        ),
    )
