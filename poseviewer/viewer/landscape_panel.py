"""The loss landscape at the right: all maps, one of them large, and how they are drawn."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import viser

from poseviewer.errors import PoseViewerError
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.session import commands as c
from poseviewer.session.jobs import LandscapeNews
from poseviewer.session.session import Session
from poseviewer.viewer.fields import Field, Post, button, set_property
from poseviewer.viewer.landscape_grid import GridOptions, landscape_grid
from poseviewer.viewer.landscape_marks import Marks
from poseviewer.viewer.requests import Download, Export

PERIOD_S = 0.2
"""The maps are sent no oftener."""


class LandscapePanel:
    """The panel's content."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._gui = gui
        self._shown: tuple[Any, ...] = ()
        self._next = 0.0
        self._late = True
        self._maps = gui.add_html("")
        self._note = gui.add_markdown("", visible=False)
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
            _download(gui, post, "sheet", "Sheet (PNG)")
            _download(gui, post, "maps-npz", "Numbers (NPZ)")
            _download(gui, post, "maps-csv", "Numbers (CSV)")

    def show(self, session: Session) -> bool:
        """Bring the panel to the session; False if it is to be asked again soon."""
        self._range.show(round(session.maps.half_width * 100.0, 3))
        self._shared.show(session.maps.shared_scale)
        news = session.landscape
        if news is None:
            return True
        set_property(self._note, "visible", False)
        search = None if session.search is None else session.search.news
        key = (news, session.document.pose, search, session.maps)
        if len(key) == len(self._shown) and all(
            a is b for a, b in zip(key, self._shown, strict=True)
        ):
            return True
        now = time.monotonic()
        if now < self._next:
            return False
        self._shown, self._next = key, now + PERIOD_S
        self._maps.content = self._grid(session, news)
        return True

    def note(self, text: str) -> None:
        """Say why there are no maps."""
        set_property(self._note, "content", text)
        set_property(self._note, "visible", True)

    def _grid(self, session: Session, news: LandscapeNews) -> str:
        problem = news.problem
        free = tuple(int(i) for i in problem.free_indices)
        moving = session.searching or session.grip is not None
        options = GridOptions(
            numbers=free,
            shared_scale=session.maps.shared_scale,
            dimmed=news.centre is not session.document.pose and not moving,
            half_width=news.half_width,
        )
        return landscape_grid(news.slices, problem.chart.names, marks_of(session, news), options)


def _download(gui: viser.GuiApi, post: Post, what: Export, text: str) -> None:
    button(gui, text, post, lambda client: Download(what, client), icon="download", color="gray")


def marks_of(session: Session, news: LandscapeNews) -> Marks:
    """The pose, and the search where it searches in the maps' chart."""
    try:
        pose = news.problem.chart.from_pose(session.document.pose)
    except (PoseViewerError, OutsideChartError):
        pose = np.array(news.numbers)
    search = session.search
    if search is None or search.news is None or search.news.problem is not news.problem:
        return Marks(pose)
    progress = search.news.progress
    trail = np.array([step.numbers for step in search.news.improvements])
    return Marks(pose, progress.simplex if session.searching else None, trail)
