"""The loss landscape at the right: all maps, one of them large, and how they are drawn."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import viser

from poseviewer.app.page.fields import Field, Post, button, download_button, set_property
from poseviewer.app.page.landscape_grid import GridOptions, landscape_grid
from poseviewer.app.page.landscape_large import contour_figure, surface_figure
from poseviewer.app.page.landscape_marks import Marks
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import LandscapeUpdate, Session
from poseviewer.errors import PoseViewerError
from poseviewer.geometry.charts import OutsideChartError

PERIOD_S, LARGE_PERIOD_S = 0.2, 0.7
"""The maps, and the large one, are sent no oftener."""
ORDER = -10.0
"""The maps come first; what is made later would come last by itself."""


class LandscapePanel:
    """The panel's content."""

    def __init__(self, gui: viser.GuiApi, post: Post, container: Any) -> None:
        """``container``: the tab that the panel is made in."""
        self._gui, self._container = gui, container
        self._shown: tuple[Any, ...] = ()
        self._next = 0.0
        self._late = True
        self._maps = gui.add_html("", order=ORDER)
        self._note = gui.add_markdown("", visible=False, order=ORDER + 1)
        self._large: viser.GuiPlotlyHandle | None = None
        self._large_next = 0.0
        self._surface = Field(
            gui.add_checkbox("As a surface", False, visible=False),
            post,
            lambda on: c.ChangeLandscape(surface=bool(on)),
        )
        self._close = button(
            gui,
            "Close the large map",
            post,
            lambda _: c.ChangeLandscape(close_large=True),
            color="gray",
            visible=False,
        )
        self._range = Field(
            gui.add_slider("Range ± %", 1.0, 50.0, 1.0, 20.0),
            post,
            lambda value: c.ChangeLandscape(half_width=float(value) / 100.0),
        )
        self._shared = Field(
            gui.add_checkbox("One colour scale for all", False),
            post,
            lambda on: c.ChangeLandscape(shared_scale=bool(on)),
        )
        with gui.add_folder("Save the maps", expand_by_default=False):
            download_button(gui, "Sheet (PNG)", post, "sheet")
            download_button(gui, "Numbers (NPZ)", post, "maps-npz")
            download_button(gui, "Numbers (CSV)", post, "maps-csv")

    def show(self, session: Session) -> bool:
        """Bring the panel to the session; False if it is to be asked again soon."""
        self._range.show(round(session.maps.half_width * 100.0, 3))
        self._shared.show(session.maps.shared_scale)
        latest = session.landscape
        if latest is None:
            return True
        set_property(self._note, "visible", False)
        search = None if session.search is None else session.search.latest
        key = (latest, session.document.pose, search, session.maps)
        if len(key) == len(self._shown) and all(
            a is b for a, b in zip(key, self._shown, strict=True)
        ):
            return True
        now = time.monotonic()
        if now < self._next:
            return False
        self._shown, self._next = key, now + PERIOD_S
        self._maps.content = self._grid(session, latest)
        return self._show_large(session, latest)

    def _show_large(self, session: Session, latest: LandscapeUpdate) -> bool:
        """The large map, if one is open; False if it is to be drawn soon."""
        pieces = {(piece.first, piece.second): piece for piece in latest.slices}
        piece = None if session.maps.large is None else pieces.get(session.maps.large)
        is_open = piece is not None
        set_property(self._close, "visible", is_open)
        self._surface.show(session.maps.surface, visible=is_open)
        if piece is None:
            if self._large is not None:
                set_property(self._large, "visible", False)
            return True
        if time.monotonic() < self._large_next:
            self._shown = ()
            return False
        self._large_next = time.monotonic() + LARGE_PERIOD_S
        names, marks = latest.case.problem.chart.names, marks_of(session, latest)
        if session.maps.surface:
            figure = surface_figure(piece, names, marks)
        else:
            scales = latest.case.problem.chart.scales(latest.parameters)
            figure = contour_figure(piece, names, marks, scales, latest.parameters)
        if self._large is None:  # plotly's script is large: sent to pages when first wanted
            with self._container:
                self._large = self._gui.add_plotly(
                    figure, config={"displayModeBar": False}, aspect=1.0, order=ORDER + 2
                )
            return True
        self._large.figure = figure
        set_property(self._large, "visible", True)
        return True

    def note(self, text: str) -> None:
        """Say why there are no maps."""
        set_property(self._note, "content", text)
        set_property(self._note, "visible", True)

    def _grid(self, session: Session, latest: LandscapeUpdate) -> str:
        problem = latest.case.problem
        free = tuple(int(i) for i in problem.free_indices)
        moving = session.searching or session.drag is not None
        options = GridOptions(
            parameters=free,
            shared_scale=session.maps.shared_scale,
            dimmed=latest.centre is not session.document.pose and not moving,
            half_width=latest.half_width,
        )
        return landscape_grid(
            latest.slices, problem.chart.names, marks_of(session, latest), options
        )


def marks_of(session: Session, latest: LandscapeUpdate) -> Marks:
    """The pose, and the search where it searches in the maps' chart."""
    try:
        pose = latest.case.problem.chart.from_pose(session.document.pose)
    except (PoseViewerError, OutsideChartError):
        pose = np.array(latest.parameters)
    search = session.search
    if search is None or search.latest is None or search.latest.case is not latest.case:
        return Marks(pose)
    progress = search.latest.progress
    trail = np.array([step.parameters for step in search.latest.improvements])
    return Marks(pose, progress.simplex if session.searching else None, trail)
