"""The benchmark on one sheet: what each path takes, and what an evaluation's time grows with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

INK, PALE = "0.15", "0.85"
STAGE_COLOURS = ("#31688e", "#35b779", "#e0a526", "#8a6fb0")
CURVE_COLOURS = ("#440154", "#31688e", "#35b779", "#d1495b")
BAR_INCHES, PANEL_INCHES, WIDTH_INCHES = 0.5, 3.6, 12.0


@dataclass(frozen=True, slots=True)
class Bar:
    """One path's time, made up of its stages."""

    label: str
    stages: tuple[tuple[str, float], ...]
    """Name and ms, from left to right."""
    note: str
    """Said behind the bar."""
    elsewhere: bool = False
    """Whether it was measured on another machine; such a bar is pale."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Times over a number of things."""

    label: str
    x: tuple[float, ...]
    median: tuple[float, ...]
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    """A band from least to most; empty for none."""


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves over the same things."""

    x_label: str
    curves: tuple[Curve, ...]
    note: str
    """Why the curves are as they are; a few words."""


@dataclass(frozen=True, slots=True)
class BenchSheet:
    """What the sheet shows."""

    title: str
    subtitle: str
    bars: tuple[Bar, ...]
    panels: tuple[Panel, ...] = ()


def make_bench_sheet(sheet: BenchSheet) -> Figure:
    """Bars above; below, where there are any, the panels in a row, log over log."""
    bars, panels = sheet.bars, sheet.panels
    bars_high = BAR_INCHES * len(bars)
    below = PANEL_INCHES + 1.35 if panels else 0.0
    height = 1.5 + bars_high + 0.75 + below
    figure = Figure(figsize=(WIDTH_INCHES, height), facecolor="white")
    figure.text(0.03, 1 - 0.42 / height, sheet.title, fontsize=14, color=INK, weight="bold")
    figure.text(0.03, 1 - 0.72 / height, sheet.subtitle, fontsize=8.5, color="0.4")
    axes = figure.add_axes((0.235, 1 - (1.35 + bars_high) / height, 0.72, bars_high / height))
    _draw_bars(axes, bars)
    for i, panel in enumerate(panels):
        share = 1.0 / len(panels)
        place = (0.06 + i * share * 0.955, 0.95 / height, share * 0.955 - 0.05)
        axes = figure.add_axes((*place, PANEL_INCHES / height))
        _draw_panel(axes, panel, first=i == 0)
        figure.text(place[0], 0.2 / height, panel.note, fontsize=8.5, color="0.35", va="bottom")
    if panels:  # one scale of ms, so that they can be compared
        limits = np.array([axes.get_ylim() for axes in figure.axes[1:]])
        for axes in figure.axes[1:]:
            axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
    return figure


def _draw_bars(axes: Axes, bars: Sequence[Bar]) -> None:
    names = list(dict.fromkeys(name for bar in bars for name, _ in bar.stages))
    colours = dict(zip(names, STAGE_COLOURS * len(names), strict=False))
    longest = max(sum(ms for _, ms in bar.stages) for bar in bars)
    for row, bar in enumerate(bars):
        left, alpha = 0.0, 0.35 if bar.elsewhere else 1.0
        for name, ms in bar.stages:
            label = "" if bar.elsewhere else name
            axes.barh(row, ms, 0.62, left, color=colours[name], alpha=alpha, label=label)
            left += ms
        axes.text(left + 0.008 * longest, row, bar.note, va="center", fontsize=9, color=INK)
    axes.set_yticks(range(len(bars)), [bar.label for bar in bars], fontsize=9.5, color=INK)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.12 * longest)
    axes.set_xlabel("ms", fontsize=9, color=INK)
    _tidy(axes)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color=PALE, linewidth=0.6)
    axes.set_axisbelow(True)
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    axes.legend(unique.values(), unique.keys(), fontsize=9, frameon=False, loc="upper right")


def _draw_panel(axes: Axes, panel: Panel, first: bool) -> None:
    for curve, colour in zip(panel.curves, CURVE_COLOURS * len(panel.curves), strict=False):
        if curve.low:
            axes.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.13, linewidth=0)
        axes.plot(curve.x, curve.median, color=colour, marker="o", markersize=4, label=curve.label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(panel.x_label, fontsize=9.5, color=INK)
    axes.xaxis.set_major_formatter(FuncFormatter(_short))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(color=PALE, linewidth=0.6)
    _tidy(axes)
    if first:
        axes.set_ylabel("ms", fontsize=9.5, color=INK)
        axes.legend(fontsize=8.5, frameon=False)


def _tidy(axes: Axes) -> None:
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set(linewidth=0.7, color=INK)
    axes.tick_params(labelsize=8.5, width=0.6, color=INK, labelcolor=INK)


def _short(value: float, _: object) -> str:
    """10k for 10,000, 1M for a million."""
    for unit, name in ((1e6, "M"), (1e3, "k")):
        if value >= unit:
            return f"{value / unit:g}{name}"
    return f"{value:g}"
