"""One map of the loss, large, by plotly: contours with their values, or a surface in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from poseviewer.app.page.landscape_marks import Marks, short_trail, simplex_outline
from poseviewer.app.page.palette import colour_scale
from poseviewer.fit.landscape import Slice, slice_minimum, strides
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.chart_names import short_name

PAPER, TEXT, GRID = "#1a1b1e", "#d7dae0", "#2f333c"
POSE_COLOUR = "#ff2d55"
CONTOURS = 14
_POSE = {"symbol": "x", "size": 10, "color": POSE_COLOUR, "line": {"color": PAPER, "width": 1}}
_LEAST = {"symbol": "circle", "size": 9, "color": "#ffffff", "line": {"color": PAPER, "width": 1.5}}


def contour_figure(
    piece: Slice, names: Sequence[str], marks: Marks, scales: FloatArray, centre: FloatArray
) -> go.Figure:
    """The map with contour lines and their values; what is under the cursor is read out.

    ``spans`` and ``centre`` (d,): what 100 % of each number is, and where 0 % lies.
    """
    piece = known_part(piece)
    x, y = piece.first_values, piece.second_values
    shares = np.stack(
        np.broadcast_arrays(
            100.0 * (x - centre[piece.first])[None] / scales[piece.first],
            100.0 * (y - centre[piece.second])[:, None] / scales[piece.second],
        ),
        axis=-1,
    )
    hover = (
        f"{short_name(names[piece.first])} %{{x:.5f}} (%{{customdata[0]:+.1f}} %)<br>"
        f"{short_name(names[piece.second])} %{{y:.5f}} (%{{customdata[1]:+.1f}} %)<br>"
        "loss %{z:.5f}<extra></extra>"
    )
    figure = go.Figure(
        go.Contour(
            x=x,
            y=y,
            z=np.round(piece.filled(), 6),
            customdata=np.round(shares, 2),
            colorscale=colour_scale(),
            ncontours=CONTOURS,
            contours={"showlabels": True, "labelfont": {"size": 10, "color": "#ffffff"}},
            line={"width": 0.8, "color": "rgba(20,22,26,.65)"},
            colorbar={"title": "loss", "thickness": 10, "len": 0.9, "outlinewidth": 0},
            hovertemplate=hover,
        )
    )
    for trace in _search_traces(piece, marks):
        figure.add_trace(trace)
    figure.add_trace(_point(piece, marks.pose, "pose", _POSE))
    least = slice_minimum(piece)
    if least is not None:
        place = {"x": [least.first_value], "y": [least.second_value]}
        figure.add_trace(_marker(place, f"least: {least.loss:.5f}", _LEAST))
    figure.update_layout(
        xaxis=_axis(short_name(names[piece.first]), x),
        yaxis=_axis(short_name(names[piece.second]), y),
        **_layout(),
    )
    return figure


def surface_figure(piece: Slice, names: Sequence[str], marks: Marks) -> go.Figure:
    """The map as a surface over its two numbers, the loss upwards, that the mouse can turn."""
    piece = known_part(piece)
    losses = piece.filled()
    figure = go.Figure(
        go.Surface(
            x=piece.first_values,
            y=piece.second_values,
            z=np.round(losses, 6),
            colorscale=colour_scale(),
            showscale=False,
            contours={"z": {"show": True, "color": "rgba(20,22,26,.5)", "width": 1}},
        )
    )
    at = marks.pose[[piece.first, piece.second]]
    row = int(np.abs(piece.second_values - at[1]).argmin())
    column = int(np.abs(piece.first_values - at[0]).argmin())
    points = [("pose", at[0], at[1], float(losses[row, column]), POSE_COLOUR)]
    least = slice_minimum(piece)
    if least is not None:
        points.append(("least", least.first_value, least.second_value, least.loss, "#ffffff"))
    for name, x, y, z, colour in points:
        figure.add_trace(
            go.Scatter3d(
                x=[x], y=[y], z=[z], name=name, mode="markers", marker={"size": 4, "color": colour}
            )
        )
    axis = {"gridcolor": GRID, "backgroundcolor": PAPER, "color": TEXT}
    figure.update_layout(
        scene={
            "xaxis": {**axis, "title": short_name(names[piece.first])},
            "yaxis": {**axis, "title": short_name(names[piece.second])},
            "zaxis": {**axis, "title": "loss"},
            "camera": {"eye": {"x": -1.5, "y": -1.75, "z": 1.25}},
        },
        **_layout(left=0, below=0),
    )
    return figure


def known_part(piece: Slice) -> Slice:
    """The finest whole grid of a map that is known already: contours through guesses mislead."""
    for step in reversed(strides(len(piece.first_values))):
        if np.isfinite(piece.losses[::step, ::step]).all():
            return Slice(
                piece.first,
                piece.second,
                piece.first_values[::step],
                piece.second_values[::step],
                piece.losses[::step, ::step],
            )
    return piece


def _search_traces(piece: Slice, marks: Marks) -> list[go.Scatter]:
    traces = []
    if marks.trail is not None and len(marks.trail) > 1:
        trail = short_trail(marks.trail)[:, [piece.first, piece.second]]
        traces.append(_line(trail, "the way here", "#ffffff"))
    if marks.simplex is not None:
        hull = simplex_outline(piece, marks.simplex)
        low = np.array([piece.first_values[0], piece.second_values[0]])
        high = np.array([piece.first_values[-1], piece.second_values[-1]])
        corners = low + np.vstack([hull, hull[:1]]) * (high - low)
        traces.append(_line(corners, "simplex", "#ffd166"))
    return traces


def _line(points: FloatArray, name: str, colour: str) -> go.Scatter:
    return go.Scatter(
        x=points[:, 0],
        y=points[:, 1],
        name=name,
        mode="lines",
        line={"color": colour, "width": 1.5},
        hoverinfo="skip",
    )


def _point(piece: Slice, parameters: FloatArray, name: str, marker: dict[str, Any]) -> go.Scatter:
    place = {"x": [parameters[piece.first]], "y": [parameters[piece.second]]}
    return _marker(place, name, marker)


def _marker(place: dict[str, Any], name: str, marker: dict[str, Any]) -> go.Scatter:
    return go.Scatter(**place, name=name, mode="markers", marker=marker, hoverinfo="name")


def _axis(title: str, values: FloatArray) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 4},
        "range": [float(values[0]), float(values[-1])],
        "gridcolor": GRID,
        "zeroline": False,
        "nticks": 6,
    }


def _layout(left: int = 46, below: int = 36) -> dict[str, Any]:
    return {
        "template": "plotly_dark",
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "font": {"color": TEXT, "size": 11},
        "margin": {"l": left, "r": 6, "t": 8, "b": below},
        "legend": {"orientation": "h", "y": 1.08, "x": 0.0, "bgcolor": "rgba(0,0,0,0)"},
        "uirevision": "kept",  # the mouse's zoom and turn survive the next data
    }
