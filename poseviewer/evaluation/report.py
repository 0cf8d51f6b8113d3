"""Tables and lines of trials: shares of fits that found the pose, and how sure they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import binomtest

from poseviewer.evaluation.photos import KINDS
from poseviewer.evaluation.trials import FOUND_PERCENT, Trial
from poseviewer.figures.text_table import Table

NONE = "-"
WRONG_PERCENT = 2.0
"""Error beyond the truth's own from which a pose that is called found counts as wrong."""
LABELS = {str(kind): label for kind, label in KINDS.items()}
Line = tuple[str, str, str, str]
"""Method, reading, photos, pixels."""
Lines = dict[Line, list[Trial]]


def wilson_interval(found: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, 1927), right for few trials and for none or all found."""
    interval = binomtest(found, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def lines_of(trials: Sequence[Trial], groups: Mapping[str, str]) -> Lines:
    """Sort trials into the report's lines; ``groups`` names a case's photos, else its set does."""
    lines: Lines = {}
    for trial in trials:
        line = trial.method, trial.reading, groups.get(trial.case, trial.set), trial.pixels
        lines.setdefault(line, []).append(trial)
    kinds = [*LABELS]

    def order(line: Line) -> tuple[str, bool, int, str, str]:
        method, reading, photos, pixels = line
        rank = kinds.index(photos) if photos in kinds else len(kinds)
        return method, reading == "absolute", rank, photos, pixels

    return {line: lines[line] for line in sorted(lines, key=order)}


def report_table(lines: Lines) -> Table:
    """Tabulate a row for each line: shares found by deviation, and what all its fits come to."""
    offs = sorted({(trial.percent, trial.degrees) for some in lines.values() for trial in some})
    columns = (
        *("method: photos", "off by"),
        *(f"{degrees}°" if degrees else f"{percent:g} %" for percent, degrees in offs),
        *("start", "end", "improved", "made worse", "called found", "of these wrongly"),
        *("loss below truth's", "evaluations", "seconds"),
    )
    rows = []
    for (method, reading, photos, pixels), some in lines.items():
        label = LABELS.get(photos, photos) + ("" if pixels == "near" else f", {pixels}")
        by_off: dict[tuple[float, int], list[bool]] = {}
        for trial in some:
            by_off.setdefault((trial.percent, trial.degrees), []).append(trial.found)
        shares = (_share(by_off[off]) if off in by_off else NONE for off in offs)
        rows.append((f"{method}: {label}", reading or "angle", *shares, *_totals(some)))
    return Table("Fits that found the pose, % (95 % interval), by deviation", columns, tuple(rows))


def _share(found: Sequence[bool]) -> str:
    low, high = wilson_interval(sum(found), len(found))
    return f"{100 * sum(found) / len(found):.0f} ({100 * low:.0f} to {100 * high:.0f})"


def _totals(trials: Sequence[Trial]) -> tuple[str, ...]:
    """Median errors in per cent of the model's size in the photo, shares, and medians of effort."""
    start = np.array([trial.error_percent_start for trial in trials])
    end = np.array([trial.error_percent_end for trial in trials])
    accuracy = np.array([trial.accuracy_percent for trial in trials])
    called = np.array([trial.verdict == "found" for trial in trials])
    shares = (
        end < start,
        end > start + np.maximum(accuracy, FOUND_PERCENT),
        called,
        end[called] > accuracy[called] + WRONG_PERCENT,
        [trial.loss_end < trial.loss_truth for trial in trials],
    )
    return (
        *(f"{np.median(start):.2f}", f"{np.median(end):.2f}"),
        *(f"{np.mean(share):.0%}" if len(share) else NONE for share in shares),
        f"{np.median([trial.evaluations for trial in trials]):.0f}",
        f"{np.median([trial.seconds for trial in trials]):.2g}",
    )
