"""The loss landscape at the right: the panel with all maps, and one of them large, by plotly."""

from __future__ import annotations

import operator
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import plotly.graph_objects as go
import viser

from poseviewer.api import Case
from poseviewer.app.page.controls import Controls, plain, set_properties
from poseviewer.app.page.landscape_grid import (
    GridOptions,
    Markers,
    candidates_outline,
    candidates_within,
    landscape_grid,
    on_map,
    region_on,
    short_trail,
)
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import LandscapeUpdate, Session, Whose
from poseviewer.errors import PoseViewerError
from poseviewer.fit.landscape import Slice, slice_minimum, strides
from poseviewer.fit.settings import METHODS
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.charts import OutsideChartError, short_name

PERIOD_S, LARGE_PERIOD_S = 0.2, 0.7
"""The maps, and the large one, are sent no oftener."""
ORDER = -10.0
"""The maps come first; what is made later would come last by itself."""
LARGE_ORDER = ORDER - 0.5
"""Large ones are over them: of two losses there are two."""
PLACES_ORDER, CHOICES_ORDER = ORDER - 1.0, ORDER - 0.9
"""First of all where the maps lie, then what is shown of them: ``page.css`` counts on it."""
CLEAR, TEXT, GRID, RIM = "rgba(0,0,0,0)", "#8a92a0", "rgba(128,128,128,.25)", "#1a1b1e"
"""Seen on a dark and on a light page."""
POSE_COLOUR, LEAST_COLOUR, TRAIL_COLOUR, SIMPLEX_COLOUR = "#ff2d55", "#ffffff", "#ffffff", "#ffd166"
COLOURS = "Viridis_r"
"""As in the grid: bright is low."""
CONTOURS = 14
WHOSE: dict[str, Whose] = {
    "the chosen method's": "chosen",
    METHODS["default"]: "default",
    METHODS["paper"]: "paper",
    "both": "both",
}


class LandscapePanel:
    """The panel's content."""

    def __init__(self, controls: Controls, container: Any) -> None:
        """``container``: the tab that the panel is made in."""
        gui = controls.gui
        self._gui, self._container = gui, container
        self._shown: tuple[Any, ...] = ()
        self._next = self._large_next = 0.0
        self._maps = gui.add_html("", order=ORDER)
        self._note = gui.add_markdown("Drawing the maps ...", order=ORDER + 1)
        self._large: list[viser.GuiPlotlyHandle] = []
        self._whose = controls.field(
            gui.add_dropdown("Whose loss", tuple(WHOSE), order=CHOICES_ORDER),
            lambda text: c.ChangeLandscape(whose=WHOSE[text]),
        )
        self._surface = controls.field(
            gui.add_checkbox("As a surface", False, visible=False, order=LARGE_ORDER + 0.3),
            lambda on: c.ChangeLandscape(surface=on),
        )
        self._close = controls.button(
            "Close the large map",
            c.ChangeLandscape(close_large=True),
            visible=False,
            order=LARGE_ORDER + 0.4,
        )
        self._range = controls.field(
            gui.add_slider("Range ± %", 1.0, 50.0, 1.0, 20.0, order=CHOICES_ORDER + 0.1),
            lambda value: c.ChangeLandscape(half_width=float(value) / 100.0),
        )
        self._shared = controls.field(
            gui.add_checkbox("One colour scale", False, order=CHOICES_ORDER + 0.2),
            lambda on: c.ChangeLandscape(shared_scale=on),
        )
        with gui.add_folder("Save the maps", expand_by_default=False):
            controls.download("Sheet (PNG)", "sheet")
            controls.download("Numbers (NPZ)", "maps-npz")
            controls.download("Numbers (CSV)", "maps-csv")

    def show(self, session: Session) -> bool:
        """Bring the panel to the session; False if it is to be asked again soon."""
        self._range.show(round(session.maps.half_width * 100.0, 3))
        self._shared.show(session.maps.shared_scale)
        self._whose.show(next(text for text, whose in WHOSE.items() if whose == session.maps.whose))
        if not session.landscapes:
            return True
        set_properties(self._note, visible=False)
        search = session.own_search
        key = (session.landscapes, session.document.pose, search, session.maps)
        if len(self._shown) == len(key) and all(map(operator.is_, key, self._shown)):
            return True
        now = time.monotonic()
        if now < self._next:
            return False
        self._shown, self._next = key, now + PERIOD_S
        grids = [_grid(session, latest) for latest in session.landscapes]
        self._maps.content = f'<div class="pv-both">{"".join(grids)}</div>'
        return self._show_large(session)

    def _show_large(self, session: Session) -> bool:
        """The large maps, if they are open; False if they are to be drawn soon."""
        figures = []
        if session.maps.large is not None and time.monotonic() < self._large_next:
            self._shown = ()
            return False
        for latest in session.landscapes:
            figure = _large_figure(session, latest)
            figures += [] if figure is None else [figure]
        set_properties(self._close, visible=bool(figures))
        self._surface.show(session.maps.surface, visible=bool(figures))
        if figures:
            self._large_next = time.monotonic() + LARGE_PERIOD_S
        for place, figure in enumerate(figures):
            if place < len(self._large):
                self._large[place].figure = figure
                set_properties(self._large[place], visible=True)
                continue
            with self._container:  # plotly's script is large: sent to pages when first wanted
                handle = self._gui.add_plotly(
                    figure,
                    config={"displayModeBar": False},
                    aspect=1.0,
                    order=LARGE_ORDER + 0.1 * place,
                )
            self._large.append(handle)
        for handle in self._large[len(figures) :]:
            set_properties(handle, visible=False)
        return True

    def note(self, text: str) -> None:
        """Say why there are no maps."""
        set_properties(self._note, content=plain(text), visible=True)


def _grid(session: Session, latest: LandscapeUpdate) -> str:
    problem = latest.case.problem
    options = GridOptions(
        parameters=tuple(int(i) for i in problem.free_indices),
        shared_scale=session.maps.shared_scale,
        centre=tuple(map(float, latest.parameters)),
        dimmed=latest.centre is not session.document.pose
        and not (session.searching or session.drag is not None),
        half_width=latest.half_width,
        whose=latest.case.settings.method_name,
        what=problem.scale.name,
        error=max((piece.error or 0.0 for piece in latest.slices), default=None),
    )
    markers = markers_of(session, latest)
    return landscape_grid(latest.shown, problem.chart.names, markers, options)


def _large_figure(session: Session, latest: LandscapeUpdate) -> go.Figure | None:
    """The map that is open large; None where there is none."""
    pieces = {(piece.first, piece.second): piece for piece in latest.shown}
    piece = None if session.maps.large is None else pieces.get(session.maps.large)
    if piece is None:
        return None
    chart, markers = latest.case.problem.chart, markers_of(session, latest)
    what = latest.case.problem.scale.name
    if session.maps.surface:
        figure = surface_figure(piece, chart.names, markers, what)
    else:
        scales = chart.scales(latest.parameters)
        figure = contour_figure(piece, chart.names, markers, scales, latest.parameters, what)
    whose = {"text": latest.case.settings.method_name, "x": 0.01, "y": 0.985, "font": {"size": 12}}
    return figure.update_layout(title=whose)


def markers_of(session: Session, latest: LandscapeUpdate) -> Markers:
    """The pose, and the search where it searches in the maps' chart."""
    try:
        photo = latest.case.registration.photo
        pose = session.document.numbers_in(latest.case.problem.chart, photo)
    except (PoseViewerError, OutsideChartError):
        pose = np.array(latest.parameters)
    covariance, search = None, session.own_search
    sure, chart = session.covariance_in(latest.case.registration.photo), latest.case.problem.chart
    if sure is not None:
        with suppress(PoseViewerError, OutsideChartError):
            covariance = sure.in_chart(chart)
    if search is None or not _same_chart(search.case, latest.case):
        return Markers(pose, covariance=covariance)
    trail = np.array([step.parameters for step in search.improvements])
    candidates = search.progress.candidates if session.searching else None
    return Markers(pose, candidates, trail, covariance)


def _same_chart(one: Case, other: Case) -> bool:
    """Whether the parameters of both are the same numbers of the same chart."""
    same_names = one.problem.chart.names == other.problem.chart.names
    return same_names and one.registration.start is other.registration.start


def contour_figure(
    piece: Slice,
    names: Sequence[str],
    markers: Markers,
    scales: FloatArray,
    centre: FloatArray,
    what: str = "loss",
) -> go.Figure:
    """The map with contour lines and their values; what is under the cursor is read out.

    ``scales`` and ``centre`` (d,): what 100 % of each parameter is, and where 0 % lies; ``what``
    the values are called.
    """
    piece = known_part(piece)
    x, y = piece.first_values, piece.second_values
    first, second = piece.first, piece.second
    shares = np.stack(
        np.meshgrid(
            100.0 * (x - centre[first]) / scales[first],
            100.0 * (y - centre[second]) / scales[second],
        ),
        axis=-1,
    )
    traces: list[Any] = [
        go.Contour(
            x=x,
            y=y,
            z=np.round(piece.filled(), 6),
            customdata=np.round(shares, 2),
            colorscale=COLOURS,
            ncontours=CONTOURS,
            contours={"showlabels": True, "labelfont": {"size": 10, "color": "#ffffff"}},
            line={"width": 0.8, "color": "rgba(20,22,26,.65)"},
            colorbar={"title": what, "thickness": 10, "len": 0.9, "outlinewidth": 0},
            hovertemplate=(
                f"{short_name(names[first])} %{{x:.5f}} (%{{customdata[0]:+.1f}} %)<br>"
                f"{short_name(names[second])} %{{y:.5f}} (%{{customdata[1]:+.1f}} %)<br>"
                f"{what} %{{z:.3f}}<extra></extra>"
            ),
        )
    ]

    def line(points: FloatArray, name: str, colour: str) -> None:
        x, y, style = points[:, 0], points[:, 1], {"color": colour, "width": 1.5}
        shown: dict[str, Any] = {"mode": "lines", "hoverinfo": "skip", "showlegend": bool(name)}
        traces.append(go.Scatter(x=x, y=y, name=name, line=style, **shown))

    def dots(places: FloatArray, name: str, **marker: Any) -> None:
        x, y, shown = places[:, 0], places[:, 1], {"mode": "markers", "hoverinfo": "name"}
        traces.append(go.Scatter(x=x, y=y, name=name, marker=marker, **shown))

    rim = {"color": RIM, "width": 1}
    if markers.trail is not None and len(markers.trail) > 1:
        line(short_trail(markers.trail)[:, [first, second]], "the way here", TRAIL_COLOUR)
    if markers.candidates is not None:
        hull = candidates_outline(piece, markers.candidates)
        low, high = np.array([x[0], y[0]]), np.array([x[-1], y[-1]])
        line(low + np.vstack([hull, hull[:1]]) * (high - low), "", SIMPLEX_COLOUR)
        places = low + candidates_within(piece, markers.candidates) * (high - low)
        dots(places, "candidates", size=7, color=SIMPLEX_COLOUR, line=rim)
    if markers.has_region(piece):
        border = region_on(piece, markers)[:, [first, second]]
        line(np.vstack([border, border[:1]]), "90 % region", POSE_COLOUR)
    pose = markers.pose[[[first, second]]]
    dots(pose, "pose", symbol="x", size=10, color=POSE_COLOUR, line=rim)
    least = slice_minimum(piece)
    if least is not None:
        place = np.array([[least.first_value, least.second_value]])
        dots(place, f"least: {least.loss:.3f}", size=9, color=LEAST_COLOUR, line=rim)
    axes = [
        {
            "title": {"text": short_name(names[parameter]), "standoff": 4},
            "range": [float(values[0]), float(values[-1])],
            "gridcolor": GRID,
            "zeroline": False,
            "nticks": 6,
        }
        for parameter, values in ((first, x), (second, y))
    ]
    return go.Figure(traces, {**_layout(), "xaxis": axes[0], "yaxis": axes[1]})


def surface_figure(
    piece: Slice, names: Sequence[str], markers: Markers, what: str = "loss"
) -> go.Figure:
    """The map as a surface over its two parameters, the loss upwards, that the mouse can turn."""
    piece = known_part(piece)
    losses = piece.filled()
    surface = go.Surface(
        x=piece.first_values,
        y=piece.second_values,
        z=np.round(losses, 6),
        colorscale=COLOURS,
        showscale=False,
        contours={"z": {"show": True, "color": "rgba(20,22,26,.5)", "width": 1}},
    )
    points = [("pose", markers.pose[[[piece.first, piece.second]]], POSE_COLOUR)]
    least = slice_minimum(piece)
    if least is not None:
        place = np.array([[least.first_value, least.second_value]])
        points.append(("least", place, LEAST_COLOUR))
    if markers.candidates is not None:
        inside = np.abs(on_map(piece, markers.candidates) - 0.5).max(axis=1) <= 0.5
        places = markers.candidates[inside][:, [piece.first, piece.second]]
        points.append(("candidates", places, SIMPLEX_COLOUR))
    traces = []
    for name, places, colour in points:
        rows = np.abs(piece.second_values[:, None] - places[:, 1]).argmin(axis=0)
        columns = np.abs(piece.first_values[:, None] - places[:, 0]).argmin(axis=0)
        x, y, z = places[:, 0], places[:, 1], losses[rows, columns]
        marker = {"size": 4, "color": colour}
        traces.append(go.Scatter3d(x=x, y=y, z=z, name=name, mode="markers", marker=marker))
    axis = {"gridcolor": GRID, "backgroundcolor": CLEAR, "color": TEXT}
    scene = {
        "xaxis": {**axis, "title": short_name(names[piece.first])},
        "yaxis": {**axis, "title": short_name(names[piece.second])},
        "zaxis": {**axis, "title": what},
        "camera": {"eye": {"x": -1.5, "y": -1.75, "z": 1.25}},
    }
    return go.Figure([surface, *traces], {**_layout(left=0, below=0), "scene": scene})


def known_part(piece: Slice) -> Slice:
    """The finest whole grid of a map that is known already: contours through guesses mislead."""
    for step in reversed(strides(len(piece.first_values))):
        x, y = piece.first_values[::step], piece.second_values[::step]
        losses = piece.losses[::step, ::step]
        if np.isfinite(losses).all():
            return Slice(piece.first, piece.second, x, y, losses)
    return piece


def _layout(left: int = 46, below: int = 36) -> dict[str, Any]:
    return {
        "template": "none",
        "paper_bgcolor": CLEAR,
        "plot_bgcolor": CLEAR,
        "font": {"color": TEXT, "size": 11},
        "margin": {"l": left, "r": 6, "t": 56, "b": below},
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0.0, "bgcolor": CLEAR},
        "uirevision": "kept",  # the mouse's zoom and turn survive the next data
    }
