"""What the trials on real photos come to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from poseviewer.figures.text_table import Table
from poseviewer.study.real import RealTrial


def real_table(trials: Sequence[RealTrial]) -> Table:
    """A row for each set, method and deviation: medians of the errors, and shares of the fits."""
    groups: dict[tuple[str, str, str, int], list[RealTrial]] = {}
    for trial in trials:
        where = trial.set, trial.method, trial.pixels, trial.degrees
        groups.setdefault(where, []).append(trial)
    return Table(
        "Error as a share of the model's size in the photo, %; medians, and shares of the fits",
        (
            *("photos", "method", "off by", "fits", "start", "end", "improved"),
            *("found", "made worse", "loss below truth's", "seconds"),
        ),
        tuple(_row(where, groups[where]) for where in sorted(groups)),
    )


def _row(where: tuple[str, str, str, int], trials: Sequence[RealTrial]) -> tuple[str, ...]:
    """``found``: within the truth's accuracy + 1 %. ``made worse``: by more than that accuracy."""
    name, method, pixels, degrees = where
    start = np.array([trial.error_percent_start for trial in trials])
    end = np.array([trial.error_percent_end for trial in trials])
    accuracy = np.array([trial.accuracy_percent for trial in trials])
    below = np.mean([trial.loss_end < trial.loss_truth for trial in trials])
    return (
        name,
        f"{method}, {pixels}",
        f"{degrees}°",
        str(len(trials)),
        f"{np.median(start):.2f}",
        f"{np.median(end):.2f}",
        f"{np.mean(end < start):.0%}",
        f"{np.mean(end < accuracy + 1.0):.0%}",
        f"{np.mean(end > start + accuracy):.0%}",
        f"{below:.0%}",
        f"{np.median([trial.seconds for trial in trials]):.2g}",
    )
