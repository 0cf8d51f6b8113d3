"""Panels of lines whose points have intervals: what a study measured, on one sheet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import offset_copy

MARKERS = "os^DvP"
PANEL_INCHES, KEY_INCHES = (3.9, 2.9), 0.2
"""Width and height of a panel; height of a line of the key."""
APART_INCHES = 0.05
"""Shift between two lines, so that their intervals can be told apart."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Lines over the same axes."""

    lines: Mapping[str, Sequence[Sequence[float]]]
    """Points by label: each x, value, and the low and the high end of its interval."""
    axes: Mapping[str, Any]
    """Properties of Matplotlib's axes, with ``xlim`` and ``ylim`` among them."""
    joined: bool = True
    """Whether points of a line are joined: not where the axis has categories."""


def make_study_sheet(rows: Sequence[Sequence[Panel]]) -> Figure:
    """Draw rows of panels, and below them the key; a label has one colour on the whole sheet."""
    columns = max(len(panels) for panels in rows)
    panels = [panel for row in rows for panel in row]
    labels = list(dict.fromkeys(label for panel in panels for label in panel.lines))
    high = len(rows) * PANEL_INCHES[1] + -(-len(labels) // columns) * KEY_INCHES
    figure = Figure((columns * PANEL_INCHES[0], high), facecolor="white", layout="constrained")
    grid, key = figure.add_gridspec(len(rows), columns), {}
    for row, column in ((r, c) for r, some in enumerate(rows) for c in range(len(some))):
        axes, panel = figure.add_subplot(grid[row, column]), rows[row][column]
        axes.set(**panel.axes)
        axes.minorticks_off()
        axes.grid(color="0.9")
        places = [point[0] for points in panel.lines.values() for point in points]
        step = APART_INCHES if len(set(places)) < len(places) else 0.0
        for place, (label, points) in enumerate(panel.lines.items()):
            number, away = labels.index(label), step * (place - (len(panel.lines) - 1) / 2.0)
            x, value, low, top = np.array(points, float).reshape(-1, 4).T
            key[label] = axes.errorbar(
                x, value, np.clip([value - low, top - value], 0.0, None),  # not a rounding below 0
                color=f"C{number}", marker=MARKERS[number % len(MARKERS)], markersize=4.5,
                linestyle="-" if panel.joined else "none", linewidth=1.1, capsize=2,
                transform=offset_copy(axes.transData, figure, away),
            )  # fmt: skip
    if len(key) > 1:
        below = {"loc": "outside lower center", "ncols": columns, "frameon": False}
        figure.legend([key[label] for label in labels], labels, **below)
    return figure
