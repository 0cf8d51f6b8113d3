"""Loss landscapes on one sheet: a map for every two parameters, in a triangle as a corner plot."""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from poseviewer.confidence.pose_covariance import ellipse
from poseviewer.fit.slices import Slice, end_on_maps
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.charts import short_name

COLOURS = "viridis_r"
"""Matplotlib's colour map of losses, as on the page: bright is low."""
INK = "0.15"
"""Colour of axes and texts."""
LEVELS = 15
"""Number of contours."""
CELL_INCHES = 1.75
"""Side of a map, in inches."""
MIN_SHEET_INCHES = 3.6
"""Smallest side of all maps together, in inches."""
DOTS_PER_INCH = 150
"""Resolution of pictures."""
POSE_COLOUR = "#e4002b"
"""Colour of the pose's cross."""
MINIMUM_MARK = {"marker": "o", "markersize": 4.5, "markerfacecolor": "#ffffff"}
MINIMUM_MARK |= {"markeredgecolor": "black", "markeredgewidth": 0.7, "label": "least of the map"}
"""Matplotlib's properties of the mark of the least loss."""
POSE_MARK = {"marker": "x", "markersize": 7, "markeredgecolor": POSE_COLOUR}
POSE_MARK |= {"markeredgewidth": 1.6, "label": "current pose"}
"""Matplotlib's properties of the pose's cross."""
REGION_MARK: dict[str, Any] = {"color": POSE_COLOUR, "linewidth": 1.2, "label": "90 % region"}
"""Matplotlib's properties of the border of the pose's 90 % region."""
PATH_MARK: dict[str, Any] = {"color": "0.4", "linewidth": 0.9, "label": "search path"}
"""Matplotlib's properties of the path, a grey that is seen on bright and dark losses."""


def make_landscape_sheet(
    slices: Sequence[Slice],
    names: Sequence[str],
    pose: FloatArray,
    *,
    title: str = "",
    what: str = "loss",
    covariance: FloatArray | None = None,
    path: FloatArray | None = None,
) -> Figure:
    """Draw the known part of slices on a sheet.

    Args:
        slices: slices, at most one of each pair of parameters.
        names: names of all parameters.
        pose: (d,): parameters at which a cross is drawn.
        title: title of the sheet.
        what: label of the colours.
        covariance: (d, d): of the pose, whose 90 % region is drawn; nan where it is not known.
        path: (n, d): the poses that a search came through, the oldest first.
    """
    end = None if path is None else end_on_maps(slices, path)
    parameters = sorted({i for piece in slices for i in (piece.first, piece.second)})
    columns, rows = parameters[:-1], parameters[1:]
    side = max(CELL_INCHES * len(rows), MIN_SHEET_INCHES)
    # A triangle leaves a corner free for the colour bar and the key; a single map does not.
    above = 0.65 if len(rows) > 1 else 2.0
    figure = Figure(figsize=(side + 1.2, side + 0.75 + above), facecolor="white")
    width, height = figure.get_size_inches()
    grid = figure.add_gridspec(
        len(rows), len(columns), left=0.95 / width, right=1.0 - 0.25 / width,
        bottom=0.75 / height, top=1.0 - above / height, wspace=0.09, hspace=0.09,
    )  # fmt: skip
    scale = loss_range([piece.losses for piece in slices])
    for piece in slices:
        row, column = rows.index(piece.second), columns.index(piece.first)
        axes = figure.add_subplot(grid[row, column])
        _draw_search(axes, piece, pose, covariance, end)
        draw_map(axes, piece, pose, scale)
        _name_axes(axes, piece, names, side / len(rows), (column == 0, row == len(rows) - 1))
    kinds = PATH_MARK if end is not None else None, None if covariance is None else REGION_MARK
    _add_key(figure, scale, what, [kind for kind in kinds if kind])
    figure.suptitle(title, x=0.95 / width, ha="left", fontsize=12, color=INK)
    return figure


def loss_range(losses: Sequence[FloatArray]) -> Normalize:
    """Return the range of the known losses; never empty."""
    known = np.concatenate([a[np.isfinite(a)] for a in losses])
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    return Normalize(low, max(high, low + 1e-6))


def draw_map(axes: Axes, piece: Slice, pose: FloatArray, scale: Normalize) -> None:
    """Draw a slice with the marks of its minimum and of a pose (d,), by colours of a range.

    Args:
        axes: axes to draw on.
        piece: the slice.
        pose: parameters of the pose.
        scale: range of the losses.
    """
    x, y = piece.first_values, piece.second_values
    losses = piece.fill_gaps()
    levels = np.linspace(float(scale.vmin or 0.0), float(scale.vmax or 1.0), LEVELS + 1)
    if np.isfinite(losses).all():
        axes.contourf(x, y, losses, levels, cmap=COLOURS, norm=scale, extend="both")
        if np.ptp(losses) > levels[1] - levels[0]:
            axes.contour(x, y, losses, levels[1:-1], colors="white", linewidths=0.35, alpha=0.55)
    least = piece.minimum
    if least is not None:
        axes.plot(*least[:2], linestyle="none", **MINIMUM_MARK)
    axes.plot(pose[piece.first], pose[piece.second], linestyle="none", **POSE_MARK)
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])


def _draw_search(
    axes: Axes,
    piece: Slice,
    pose: FloatArray,
    covariance: FloatArray | None,
    end: FloatArray | None,
) -> None:
    """Draw the end of a search's path and the pose's 90 % region over a map."""
    pair = [piece.first, piece.second]
    if end is not None:
        axes.plot(*end[:, pair].T, **PATH_MARK)
    part = np.array([[np.nan]]) if covariance is None else covariance[np.ix_(pair, pair)]
    if not np.isnan(part).any():
        border = pose[pair] + ellipse(part)
        axes.plot(*border[[*range(len(border)), 0]].T, **REGION_MARK)


def _name_axes(
    axes: Axes, piece: Slice, names: Sequence[str], cell: float, at: tuple[bool, bool]
) -> None:
    """Label a map ``cell`` inches wide; ``at``: whether at the left, and at the lower side."""
    left, bottom = at
    axes.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
    axes.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    axes.tick_params(
        labelsize=7, length=2.5, width=0.6, color=INK, labelcolor=INK,
        labelleft=left, labelbottom=bottom,
    )  # fmt: skip
    for spine in axes.spines.values():
        spine.set(linewidth=0.6, color=INK)
    if bottom:
        axes.set_xlabel(short_name(names[piece.first]), fontsize=9, color=INK)
        axes.tick_params(axis="x", labelrotation=35)
        axes.xaxis.set_label_coords(0.5, -0.47 / cell)
    if left:
        axes.set_ylabel(short_name(names[piece.second]), fontsize=9, color=INK)
        axes.yaxis.set_label_coords(-0.68 / cell, 0.5)


def _add_key(figure: Figure, scale: Normalize, what: str, lines: Sequence[dict[str, Any]]) -> None:
    """Draw the colour bar and a legend in the free upper right corner."""
    width, height = figure.get_size_inches()
    right, top = 1.0 - 0.35 / width, 1.0 - 0.75 / height
    span = min(0.32, 2.6 / width)
    axes = figure.add_axes((right - span, top - 0.16 / height, span, 0.13 / height))
    bar = figure.colorbar(ScalarMappable(scale, COLOURS), cax=axes, orientation="horizontal")
    bar.set_label(what, fontsize=9, color=INK)
    bar.ax.tick_params(labelsize=7, length=2.5, width=0.6, color=INK, labelcolor=INK)
    bar.ax.xaxis.set_major_locator(MaxNLocator(4))
    bar.outline.set(linewidth=0.6)  # pyright: ignore[reportCallIssue]
    marks = [Line2D([], [], linestyle="none", **kind) for kind in (POSE_MARK, MINIMUM_MARK)]
    marks += [Line2D([], [], **kind) for kind in lines]
    figure.legend(
        handles=marks, loc="upper right", bbox_to_anchor=(right, top - 0.62 / height),
        fontsize=8, frameon=False, labelcolor=INK, borderaxespad=0.0,
    )  # fmt: skip


def figure_bytes(figure: Figure, kind: str = "png") -> bytes:
    """Encode a figure as a file of a ``kind``, in any thread.

    Raises:
        ValueError: Matplotlib knows no such kind.
    """
    memory = BytesIO()
    FigureCanvasAgg(figure).print_figure(memory, format=kind, dpi=DOTS_PER_INCH)
    return memory.getvalue()
