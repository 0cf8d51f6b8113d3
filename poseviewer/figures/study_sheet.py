"""The figure of the reliability study: shares of fits that found the pose, against deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

INK, PALE = "0.15", "0.85"
COLOURS = ("#440154", "#31688e", "#35b779", "#d1495b", "#e0a526", "#8a6fb0")
MARKERS = ("o", "s", "^", "D", "v", "P")
PANEL_INCHES = (5.6, 3.8)
APART = 0.02
"""Lines are this far from one another along the axis, as a share of its decade, so that their
intervals can be told apart."""


@dataclass(frozen=True, slots=True)
class ReliabilityLine:
    """One kind of photo; all tuples are as long as ``percent``."""

    label: str
    percent: tuple[float, ...]
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
    """The panels in rows and columns, on one scale; the deviation on a logarithmic one."""
    rows, columns = len(panels), max(len(row) for row in panels)
    size = columns * PANEL_INCHES[0], rows * PANEL_INCHES[1]
    figure = Figure(figsize=size, facecolor="white", layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes_row, panel_row in zip(grid, panels, strict=True):
        for axes, panel in zip(axes_row, panel_row, strict=True):
            _draw(axes, panel)
    return figure


def _draw(axes: Axes, panel: ReliabilityPanel) -> None:
    for i, line in enumerate(panel.lines):
        away = 10.0 ** (APART * (i - (len(panel.lines) - 1) / 2.0))
        share = np.array(line.share)
        # A share may lie a rounding beside its interval.
        error = np.clip([share - line.low, np.array(line.high) - share], 0.0, None)
        axes.errorbar(
            np.array(line.percent) * away,
            share,
            error,
            color=COLOURS[i % len(COLOURS)],
            marker=MARKERS[i % len(MARKERS)],
            markersize=5,
            linewidth=1.4,
            elinewidth=0.8,
            capsize=2,
            label=line.label,
        )
    percents = sorted({percent for line in panel.lines for percent in line.percent})
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(percents))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_ylim(-0.03, 1.05)
    axes.set_title(panel.title, fontsize=10.5, color=INK, loc="left")
    axes.set_xlabel(panel.x_label, fontsize=9, color=INK)
    axes.set_ylabel("fits that found the pose", fontsize=9, color=INK)
    axes.tick_params(labelsize=8.5, colors=INK)
    axes.grid(color=PALE, linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    # Below the axes: inside, some line or interval is always in its way.
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
