"""Results of a study on one sheet: panels of lines whose points have intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.transforms import offset_copy

MARKERS = "os^DvP"
"""Matplotlib's markers of lines, in turn."""
PANEL_INCHES = (3.9, 2.9)
"""Width and height of a panel."""
KEY_INCHES = 0.2
"""Height of a line of the key."""
APART_INCHES = 0.05
"""Offset between two lines, so that their intervals can be told apart."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Lines over the same axes."""

    lines: Mapping[str, Sequence[Sequence[float]]]
    """Points by label, each x, value, and the low and the high end of its interval."""
    axes: Mapping[str, Any]
    """Properties of Matplotlib's axes, with ``xlim`` and ``ylim`` among them."""
    joined: bool = True
    """Whether points of a line are joined, as on an axis without categories."""


def make_study_sheet(rows: Sequence[Sequence[Panel]]) -> Figure:
    """Draw rows of panels with the key below; a label has one colour on the whole sheet."""
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
        xs = [point[0] for points in panel.lines.values() for point in points]
        step = APART_INCHES if len(set(xs)) < len(xs) else 0.0
        for index, (label, points) in enumerate(panel.lines.items()):
            number, offset = labels.index(label), step * (index - (len(panel.lines) - 1) / 2.0)
            x, value, low, top = np.array(points, float).reshape(-1, 4).T
            key[label] = axes.errorbar(
                x, value, np.clip([value - low, top - value], 0.0, None),  # not a rounding below 0
                color=f"C{number}", marker=MARKERS[number % len(MARKERS)], markersize=4.5,
                linestyle="-" if panel.joined else "none", linewidth=1.1, capsize=2,
                transform=offset_copy(axes.transData, figure, offset),
            )  # fmt: skip
    if len(key) > 1:
        below = {"loc": "outside lower center", "ncols": columns, "frameon": False}
        figure.legend([key[label] for label in labels], labels, **below)
    return figure
