"""The figure of the reliability study: shares of fits that found the pose, against deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

MARKERS = "os^DvP"
PANEL_INCHES = (5.6, 3.8)
APART = 0.02
"""Shift between lines along the axis, in decades, so that their intervals can be told apart."""


@dataclass(frozen=True, slots=True)
class ReliabilityLine:
    """One kind of photo; all tuples are of one length."""

    label: str
    off: tuple[float, ...]
    """Deviations, per cent or degrees."""
    share: tuple[float, ...]
    """In [0, 1], with an interval from ``low`` to ``high``."""
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ReliabilityPanel:
    """Lines over the same deviations."""

    title: str
    x_label: str
    lines: tuple[ReliabilityLine, ...]


def make_study_sheet(panels: Sequence[Sequence[ReliabilityPanel]]) -> Figure:
    """Draw the panels in rows and columns, on one scale; the deviation on a logarithmic one."""
    rows, columns = len(panels), max(len(row) for row in panels)
    size = columns * PANEL_INCHES[0], rows * PANEL_INCHES[1]
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes_row, panel_row in zip(grid, panels, strict=True):
        for axes, panel in zip(axes_row, panel_row, strict=False):
            _draw(axes, panel)
    return figure


def _draw(axes: Axes, panel: ReliabilityPanel) -> None:
    for i, line in enumerate(panel.lines):
        away = 10.0 ** (APART * (i - (len(panel.lines) - 1) / 2.0))
        share = np.array(line.share)
        # A share may lie a rounding beside its interval.
        error = np.clip([share - line.low, np.array(line.high) - share], 0.0, None)
        marker = MARKERS[i % len(MARKERS)]
        axes.errorbar(
            *(np.array(line.off) * away, share, error), marker=marker, capsize=2, label=line.label
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(
        FixedLocator(sorted({o for line in panel.lines for o in line.off}))
    )
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_ylim(-0.03, 1.05)
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel="fits that found the pose")
    axes.grid(color="0.85")
    # Below the axes: inside, some line or interval is always in its way.
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
