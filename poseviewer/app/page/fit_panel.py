"""The controls of the search: start and stop, how it goes, what it may change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import viser
from viser import uplot

from poseviewer.app.page.fields import Field, Post, button, set_property
from poseviewer.app.page.verdict_text import verdict_text
from poseviewer.app.state import commands as c
from poseviewer.app.state.requests import Request
from poseviewer.app.state.session import Session
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.chart_names import label

MOST_NUMBERS = 7
PIXELS = {"near the model": "near", "whole photo": "whole", "what the model covers": "clip"}
CURVE_POINTS = 300


class FitPanel:
    """Folder "Fit"."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._shown: dict[str, object] = {}
        self._names: tuple[str, ...] = ()
        self._running = False
        self._before = False
        with gui.add_folder("3 · Fit"):
            self._go = button(
                gui,
                "Search (space)",
                post,
                lambda _: c.StopSearch() if self._running else c.StartSearch(),
                icon="player-play",
                color="cyan",
            )
            self._status = gui.add_markdown("")
            self._keep = button(gui, "Keep it", post, lambda _: c.AcceptSearch(), icon="check")
            self._back = button(
                gui, "Go back", post, lambda _: c.RevertSearch(), icon="x", color="gray"
            )
            self._blink = button(
                gui,
                "Show before",
                post,
                lambda _: c.ChangeView(before=not self._before),
                icon="eye",
                color="gray",
            )
            self._curve = gui.add_uplot(
                (np.zeros(2), np.zeros(2)),
                ({"label": "evaluation"}, {"label": "best loss", "stroke": "#35e6ff", "width": 2}),
                scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
                axes=(_axis(), _axis()),
                legend=uplot.Legend(show=False),
                height=150,
                padding=(10, 12, 0, 0),
                visible=False,
            )
            with gui.add_folder("Settings", expand_by_default=False):
                self._add_settings(gui, post)

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        self._running = session.searching
        self._before = session.look.before
        set_property(self._blink, "label", "Show after" if self._before else "Show before")
        self._show_search(session)
        self._show_settings(session)

    def _show_search(self, session: Session) -> None:
        search, running = session.search, session.searching
        set_property(self._go, "label", "Stop (space)" if running else "Search (space)")
        set_property(self._go, "icon", "player-stop" if running else "player-play")
        ended = search is not None and not running and search.latest is not None
        for handle in (self._keep, self._back, self._blink):
            set_property(handle, "visible", ended)
        set_property(self._status, "content", status_text(session))
        latest = None if search is None else search.latest
        # Of a single loss the plot would make an axis from 0 to twice as much.
        set_property(self._curve, "visible", latest is not None and len(latest.improvements) > 1)
        if latest is not None and self._shown.get("curve") is not latest.improvements:
            self._shown["curve"] = latest.improvements
            found = latest.improvements[-CURVE_POINTS:]
            evaluations = [float(p.evaluations) for p in found]
            losses = [p.loss for p in found]
            end = float(max(latest.progress.evaluations, evaluations[-1] + 1))
            self._curve.data = (
                np.array([*evaluations, end]),
                np.array([*losses, losses[-1]]),
            )

    def _add_settings(self, gui: viser.GuiApi, post: Post) -> None:
        def setting(handle: Any, change: Callable[[FitSettings, Any], FitSettings]) -> Field:
            def asked(value: Any) -> Request:
                return c.AlterSettings(lambda settings: change(settings, value))

            return Field(handle, post, asked)

        self._chart = setting(
            gui.add_dropdown("Chart", ("auto", "vehicle", "free-body")),
            lambda s, value: replace(s, chart=value),
        )
        self._pixels = setting(
            gui.add_dropdown("Pixels", tuple(PIXELS)),
            lambda s, value: replace(s, pixels=PIXELS[value]),
        )
        self._region = button(
            gui, "Draw a region", post, lambda _: c.SetTool("region"), color="gray"
        )
        self._clear = button(
            gui,
            "Clear the region",
            post,
            lambda _: c.AlterSettings(lambda settings: replace(settings, region=None)),
            color="gray",
        )
        self._grey = setting(
            gui.add_checkbox("Grey, not colour", False), lambda s, on: replace(s, grey=bool(on))
        )
        self._focal = setting(
            gui.add_checkbox("Find the focal length", False),
            lambda s, on: replace(s, free_focal=bool(on)),
        )
        self._evaluations = setting(
            gui.add_number("Most evaluations", 20_000, min=10, max=1_000_000, step=10),
            lambda s, n: replace(s, limits=Limits(int(n), s.limits.seconds)),
        )
        self._seconds = setting(
            gui.add_number("Most seconds", 600.0, min=0.1, max=86_400.0, step=0.1),
            lambda s, n: replace(s, limits=Limits(s.limits.evaluations, float(n))),
        )
        self._seed = setting(
            gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1),
            lambda s, n: replace(s, seed=int(n)),
        )
        with gui.add_folder("Hold", expand_by_default=False):
            self._locks = [self._lock(gui, post, i) for i in range(MOST_NUMBERS)]

    def _lock(self, gui: viser.GuiApi, post: Post, index: int) -> Field:
        def asked(on: bool) -> Request | None:
            if index >= len(self._names):
                return None
            name = self._names[index]

            def hold(settings: FitSettings) -> FitSettings:
                held = {*settings.lock, name} if on else set(settings.lock) - {name}
                return replace(settings, lock=tuple(sorted(held)))

            return c.AlterSettings(hold)

        return Field(gui.add_checkbox("", False), post, asked)

    def _show_settings(self, session: Session) -> None:
        document = session.document
        names = document.chart.names
        key = (document.settings, names, session.tool)
        if self._shown.get("settings") == key:
            return
        self._shown["settings"], self._names = key, names
        settings = document.settings
        self._chart.show(settings.chart)
        wanted = {value: name for name, value in PIXELS.items()}
        self._pixels.show(wanted[settings.pixels])
        self._grey.show(settings.grey)
        self._focal.show(settings.free_focal)
        self._evaluations.show(settings.limits.evaluations)
        self._seconds.show(settings.limits.seconds)
        self._seed.show(settings.seed)
        drawing = session.tool == "region"
        set_property(self._region, "label", "Drag on the photo ..." if drawing else "Draw a region")
        set_property(self._clear, "visible", settings.region is not None)
        for index, field in enumerate(self._locks):
            if index < len(names):
                set_property(field.handle, "label", label(names[index]))
                field.show(names[index] in settings.lock)
            else:
                field.show(False, visible=False)


def status_text(session: Session) -> str:
    """How the search stands, or the loss at the pose, for the panel (markdown)."""
    search = session.search
    if search is not None and search.latest is not None:
        progress = search.latest.progress
        stopped = not search.running and progress.status.name == "RUNNING"
        sentence = "Stopped: the best pose so far is shown." if stopped else progress.status.value
        return (
            f"**loss {progress.loss:.5f}** (start {progress.start_loss:.5f})  \n"
            f"{progress.evaluations} evaluations, restart {progress.restart}, "
            f"{progress.seconds:.1f} s  \n{sentence}{verdict_text(progress.verdict)}"
        )
    if search is not None:
        return "Preparing the search ..."
    overlay = session.overlay
    if overlay is None or overlay.loss is None:
        note = "" if overlay is None else overlay.note
        return note or "Preparing the first picture ..."
    return f"**loss {overlay.loss:.5f}** at this pose"


def _axis() -> uplot.Axis:
    return uplot.Axis(
        stroke="#aab0bb",
        grid={"stroke": "#2b2f38", "width": 1},
        ticks={"stroke": "#2b2f38", "width": 1},
        size=44,
    )
