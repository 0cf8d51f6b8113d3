"""Panels of lines whose points have intervals: what a study measured, on one sheet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import offset_copy

MARKERS = "os^DvP"
PANEL_INCHES, KEY_INCHES = (3.9, 2.9), 0.3
APART_INCHES = 0.05
"""Shift between two lines, so that their intervals can be told apart."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Lines over the same axes."""

    lines: Mapping[str, Sequence[Sequence[float]]]
    """Points by label: each x, value, and the low and the high end of its interval."""
    axes: Mapping[str, Any]
    """Properties of Matplotlib's axes, with ``xlim`` and ``ylim`` among them."""


def make_study_sheet(rows: Sequence[Sequence[Panel]]) -> Figure:
    """Draw rows of panels, and below them the key; a label has one colour on the whole sheet."""
    columns = max(len(panels) for panels in rows)
    width, height = columns * PANEL_INCHES[0], len(rows) * PANEL_INCHES[1] + KEY_INCHES
    figure = Figure(figsize=(width, height), facecolor="white", layout="constrained")
    grid, key = figure.add_gridspec(len(rows), columns), {}
    for row, panels in enumerate(rows):
        for column, panel in enumerate(panels):
            axes = figure.add_subplot(grid[row, column])
            axes.set(**panel.axes)
            axes.minorticks_off()
            axes.grid(color="0.9")
            for place, (label, points) in enumerate(panel.lines.items()):
                number = list(key).index(label) if label in key else len(key)
                away = APART_INCHES * (place - (len(panel.lines) - 1) / 2.0)
                x, value, low, high = np.array(points, float).reshape(-1, 4).T
                # A share may lie a rounding beside its interval.
                error = np.clip([value - low, high - value], 0.0, None)
                key[label] = axes.errorbar(
                    x, value, error, capsize=2, linewidth=1.1, markersize=4.5,
                    color=f"C{number}", marker=MARKERS[number % len(MARKERS)],
                    transform=offset_copy(axes.transData, figure, away),
                )  # fmt: skip
    if len(key) > 1:
        place = {"loc": "outside lower center", "ncols": min(len(key), 2 * columns)}
        figure.legend(list(key.values()), list(key), frameon=False, **place)
    return figure
