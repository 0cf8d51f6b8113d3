"""The tabs of the left panel, in the order of the work: open, place, fit, judge, save.

Each is made once with the page's controls; ``show`` brings it to the session.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from viser import uplot

from poseviewer.app.page.above_steps import MoreObjects, loss_bar
from poseviewer.app.page.comparisons import MethodsPanel
from poseviewer.app.page.controls import Controls, Field, plain, set_properties
from poseviewer.app.page.hide_panel import HINTS, HidePanel
from poseviewer.app.page.reports import LOOKS
from poseviewer.app.state import commands as c
from poseviewer.app.state.camera_change import NARROWEST_DEG, WIDEST_DEG
from poseviewer.app.state.document import WHEELS, is_alone, label_of
from poseviewer.app.state.marking import MARKING, pair_errors, pairs_done
from poseviewer.app.state.objects import symmetry_text
from poseviewer.app.state.session import SearchUpdate, Session
from poseviewer.app.workers.tasks import Request, SavePose, ShowHelp, find_wheels
from poseviewer.fit.settings import METHODS, FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.charts import short_name, tooltip
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.mesh import Mesh
from poseviewer.starts.placing import SIDES
from poseviewer.starts.point_pairs import fewest_pairs
from poseviewer.vehicle.wheel_pose import FEWEST_RIM_POINTS

MOST_PARAMETERS = 7
"""Most parameters of any chart; fields that a chart does not need are hidden."""
SHOWN_DIGITS = 5
"""Decimals of a parameter's field."""
CURVE_POINTS = 300
"""Newest improvements in the plot of the search."""
PIXELS = {"near the model": "near", "whole photo": "whole", "inside the model": "clip"}
PAPER_PIXELS = tuple(text for text, pixels in PIXELS.items() if pixels != "near")
BESIDE_RESTART = 1e-3
"""Evaluations between a restart's line on the curve and what is not one."""
AS_IT_IS = "as it is"
METHODS_HINT = (
    "Default: CMA-ES, then quadratic models, on what light, classes of colour and edges leave "
    "unexplained. Paper (2010): the paper's restarted simplex on its loss of light alone."
)
KEEP_HINT, BACK_HINT = "The pose found stays; the search is put away", "To the pose before (Z)"
WAITING = '<div class="pv-wait"></div>'
"""A moving bar, for work of unknown length."""
FIT_TO_BOX = "Fit to box"
FIND_WHEELS, DRAW_REGION_FIRST = "Find wheels in the region", "Find wheels: draw a region"
SAVE, SAVE_SCENE = "Save pose (S)", "Save scene (S)"
PREPARING = "Preparing the first picture ..."
USUAL_HINT = " ".join(
    f"<span>{text}</span>"
    for text in (
        '<i class="pv-plain">drag</i> move',
        '<i class="pv-shift">shift</i> turn',
        '<i class="pv-ctrl">ctrl</i> roll, scale',
        "<b>wheel</b> zoom",
        "<b>right drag</b> pan",
        "<b>F</b> all",
        "<b>space</b> search",
        "<b>?</b> keys",
    )
)
"""Hint where a drag moves the model; the page's style marks what a drag does with the held keys."""
REGION_HINT = "drag a rectangle on the photo &nbsp;·&nbsp; Esc: leave it"
BOX_HINT = (
    "drag a rectangle about the object: the model goes there, and starting poses will be "
    "proposed &nbsp;·&nbsp; Esc: leave it"
)
PLACE_HINT = (
    "<b>press where the object is</b>, or drag the model there &nbsp;·&nbsp; "
    "<b>Fit to box</b> proposes starting poses"
)
SEARCHING_HINT = (
    "the best pose so far is shown &nbsp;·&nbsp; <b>space</b> stops the search and keeps it"
)
MARKING_HINT = " &nbsp;·&nbsp; drag a mark, double-click removes it &nbsp;·&nbsp; Esc: end"


class StatusPanel:
    """Text above the steps: the loss at the pose, or how the search stands."""

    def __init__(self, controls: Controls) -> None:
        self._text = controls.gui.add_markdown("")
        # A search is silent while its verdict is gathered.
        self._waiting = controls.gui.add_html(WAITING, visible=False)
        self._bar = controls.gui.add_html("", visible=False)

    def show(self, session: Session) -> None:
        """Bring the text to the session."""
        set_properties(self._waiting, visible=session.searching)
        lines = (search_text(session), focal_note(session))
        set_properties(self._text, content="  \n".join(filter(None, lines)))
        bar = loss_bar(session)
        set_properties(self._bar, content=bar, visible=bool(bar))


class OpenPanel:
    """Tab "Open"."""

    def __init__(self, controls: Controls) -> None:
        self._what = controls.gui.add_markdown("")
        controls.upload("Photo ...", "photo", "photo")
        controls.upload("Model ...", "model", "cube")
        controls.upload("Folder ...", None, "folder-open")
        controls.upload("Pose file ...", "pose", "file-import")
        self._more = MoreObjects(controls)
        controls.button_for("Keys and mouse (?)", ShowHelp, icon="help")

    def show(self, session: Session) -> None:
        """Say what is open."""
        photo, model, mesh = session.document.photo, session.document.model, session.document.mesh
        text = (
            f"**{plain(photo.label)}**  \n{photo.width} x {photo.height} px  \n"
            f"**{plain(model.name)}**  \n{len(mesh.faces):,} triangles, "
            f"{len(mesh.part_names) or 1} part{'s' if len(mesh.part_names) > 1 else ''}, "
            f"{reflectance_text(mesh)}; {symmetry_text(model)}"
        )
        set_properties(self._what, content=text)
        self._more.show(session)


class PlacePanel:
    """Tab "Place": views, history, quick start, the chart's parameters, the camera."""

    def __init__(self, controls: Controls) -> None:
        gui = controls.gui
        self._names: tuple[str, ...] = ()
        self._view = gui.add_dropdown("View", (AS_IT_IS, *SIDES))
        controls.field(self._view, self._look_from)
        controls.choices("History", {"Undo (Z)": c.undo(), "Redo (Y)": c.redo()})
        controls.choices(
            "Start",
            {"Reset to start (R)": c.reset_to_start(), "Make this the start": c.make_start()},
        )
        self._quick_start = QuickStartPanel(controls)
        with gui.add_folder("Numbers", expand_by_default=False):
            self._parameters = [self._parameter(controls, i) for i in range(MOST_PARAMETERS)]
        with gui.add_folder("Camera", expand_by_default=False):
            self._projection = controls.field(
                gui.add_dropdown("Projection", ("perspective", "parallel")), c.set_projection
            )
            self._field_of_view = controls.field(
                gui.add_number(
                    "Field of view °", 50.0, min=NARROWEST_DEG, max=WIDEST_DEG, step=0.1
                ),
                c.set_field_of_view,
            )
            self._intrinsics = [
                controls.field(gui.add_number(name, 1.0, step=0.01), self._from_intrinsics)
                for name in ("fx  (px)", "fy  (px)", "cx  (px)", "cy  (px)")
            ]

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        self._quick_start.show(session)
        self._names = session.document.chart.names
        parameters = session.document.parameters
        for index, field in enumerate(self._parameters):
            if index < len(self._names):
                name = self._names[index]
                set_properties(field.handle, label=short_name(name), hint=tooltip(name))
                field.show(round(float(parameters[index]), SHOWN_DIGITS))
            else:
                field.show(0.0, visible=False)
        self._show_camera(session)

    def _look_from(self, side: str) -> Request | None:
        if side not in SIDES:
            return None
        self._view.value = AS_IT_IS
        return c.view_from(side)

    def _parameter(self, controls: Controls, index: int) -> Field:
        return controls.field(
            controls.gui.add_number("", 0.0, step=10.0**-SHOWN_DIGITS * 50),
            lambda value: (
                c.set_number(self._names[index], float(value)) if index < len(self._names) else None
            ),
        )

    def _show_camera(self, session: Session) -> None:
        photo = session.document.photo
        shown = camera_as_integer_centres(session.document.pose.camera)
        perspective = isinstance(shown, Perspective)
        self._projection.show("perspective" if perspective else "parallel")
        if isinstance(shown, Parallel):
            self._field_of_view.show(self._field_of_view.handle.value, visible=False)
            values = [shown.scale, shown.scale, shown.cx, shown.cy]
        else:
            longer = max(photo.width, photo.height)
            focal = shown.fx if photo.width >= photo.height else shown.fy
            angle = math.degrees(2.0 * math.atan(longer / 2.0 / focal))
            self._field_of_view.show(round(angle, 3))
            values = [shown.fx, shown.fy, shown.cx, shown.cy]
        for index, (field, value) in enumerate(zip(self._intrinsics, values, strict=True)):
            field.show(round(value, 4), visible=perspective or index > 1)

    def _from_intrinsics(self, _: float) -> Request:
        fx, fy, cx, cy = (float(field.handle.value) for field in self._intrinsics)
        return c.set_camera(fx, fy, cx, cy)


class QuickStartPanel:
    """Folder "Quick start": a pose from marks on the photo, or proposed ones."""

    def __init__(self, controls: Controls) -> None:
        self._has_region = False
        self._box = controls.button(FIT_TO_BOX, c.toggle_box(), None, icon="frame")
        self._waiting = controls.gui.add_html(WAITING, visible=False)
        self._proposals = controls.gui.add_markdown("", visible=False)
        self._steps = [
            controls.button("Next proposal", c.step_proposals(1)),
            controls.button("Start from it", c.take_proposal(), None, icon="check"),
        ]
        with controls.gui.add_folder("Quick start", expand_by_default=False):
            controls.choices(
                "Mark", {"Point pairs": c.set_tool("pairs"), "Wheels": c.set_tool("wheels")}
            )
            # Wheels are looked for in the region; where there is none yet, it is drawn first.
            self._find = controls.button_for(
                DRAW_REGION_FIRST,
                lambda _: find_wheels() if self._has_region else c.set_tool("region"),
            )
            self._again = controls.button("Draw another region", c.set_tool("region"))
            self._propose = controls.button("Propose starts", c.toggle_proposing())
            self._text = controls.gui.add_markdown("")
            self._buttons = [
                controls.button("Remove last mark", c.remove_mark()),
                controls.button("Clear marks", c.clear_marks()),
                controls.button("Done (Esc)", c.set_tool("pose")),
            ]

    def show(self, session: Session) -> None:
        """Say what is marked and how well the pose shows it, and what is proposed."""
        self._has_region = session.document.own.region is not None
        set_properties(self._find, label=FIND_WHEELS if self._has_region else DRAW_REGION_FIRST)
        set_properties(self._again, visible=self._has_region)
        set_properties(self._text, content=marks_text(session))
        for handle in self._buttons:
            set_properties(handle, visible=session.tool in MARKING)
        asked = session.proposals
        proposing = asked is not None and asked.running
        drawing = "Drag on the photo ..." if session.tool == "box" else FIT_TO_BOX
        set_properties(self._box, label="Stop looking" if proposing else drawing)
        set_properties(self._waiting, visible=proposing)
        set_properties(self._propose, label="Stop looking" if proposing else "Propose starts")
        count = 0 if asked is None or not _has_proposals(session) else len(asked.poses)
        for handle, fewest in zip(self._steps, (2, 1), strict=True):
            set_properties(handle, visible=count >= fewest)
        text = proposals_text(session)
        set_properties(self._proposals, content=text, visible=bool(text))


class FitPanel:
    """Tab "Fit": start and stop, how the search goes, what it may change."""

    def __init__(self, controls: Controls) -> None:
        gui = controls.gui
        self._drawn: object = None
        self._names: tuple[str, ...] = ()
        self._settings: list[tuple[Field, Callable[[FitSettings], Any]]] = []
        self._method = controls.field(
            gui.add_dropdown("Method", tuple(METHODS.values()), hint=METHODS_HINT),
            lambda name: c.set_method(next(m for m, n in METHODS.items() if n == name)),
        )
        self._pixels = controls.field(
            gui.add_dropdown("Pixels", tuple(PIXELS)),
            lambda text: c.alter_settings(lambda s: replace(s, pixels=PIXELS[text])),
        )
        self._go = controls.button("Search (space)", c.toggle_search(), "cyan", icon="player-play")
        self._all = controls.button("Search all", c.search_all(), visible=False)
        self._ended = [
            controls.button("Keep it", c.accept_search(), None, icon="check", hint=KEEP_HINT),
            controls.button("Go back", c.revert_search(), icon="x", hint=BACK_HINT),
        ]
        grid = {"stroke": "rgba(128,128,128,.25)", "width": 1}
        below, beside = (
            uplot.Axis(stroke="#8a92a0", grid=grid, ticks=grid, size=size)  # pyright: ignore
            for size in (30, 54)
        )
        self._curve = gui.add_uplot(
            (np.zeros(2), np.zeros(2), np.zeros(2)),
            (
                {"label": "evaluation"},
                {"label": "best loss", "stroke": "#17a2b8", "width": 2},
                {
                    "label": "restart",
                    "stroke": "#e0a92e",
                    "width": 1,
                    "scale": "restart",
                    "points": {"show": False},
                },
            ),
            scales={
                "x": uplot.Scale(time=False, auto=True),
                "y": uplot.Scale(auto=True),
                # From above 0: where there is no restart, nothing is drawn.
                "restart": uplot.Scale(auto=False, range=(0.2, 0.8)),
            },
            axes=(below, beside),
            legend=uplot.Legend(show=False),
            title="best loss so far (vertical lines: restarts)",
            height=150,
            padding=(10, 12, 0, 0),
            visible=False,
        )
        self._hide = HidePanel(controls)
        self._methods = MethodsPanel(controls)
        with gui.add_folder("Settings", expand_by_default=False):
            self._add_settings(controls)

    def _add_setting(
        self, controls: Controls, handle: Any, name: str, kind: Callable[[Any], Any] = lambda v: v
    ) -> None:
        """An input of a setting, or of a limit: ``limits.seconds``; ``kind`` makes its value of
        what stands in the input.
        """

        def asked(value: Any) -> Request:
            new = kind(within(handle, value))
            return c.alter_settings(lambda settings: _altered(settings, name, new))

        self._settings.append((controls.field(handle, asked), attrgetter(name)))

    def _add_settings(self, controls: Controls) -> None:
        gui, setting = controls.gui, partial(self._add_setting, controls)
        setting(gui.add_dropdown("Parameters", ("auto", "vehicle", "free-body")), "chart")
        self._region = controls.button("Draw a region", c.set_tool("region"))
        self._clear = controls.button("Clear the region", c.clear_region())
        self._grey = gui.add_checkbox("Use greyscale", False)
        setting(self._grey, "grey")
        setting(gui.add_checkbox("Find the focal length", False), "free_focal")
        evaluations = gui.add_number("Max evaluations", 20_000, min=10, max=1_000_000, step=10)
        setting(evaluations, "limits.evaluations", int)
        seconds = gui.add_number("Time limit (s)", 600.0, min=0.1, max=86_400.0, step=0.1)
        setting(seconds, "limits.seconds", float)
        setting(gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1), "seed", int)
        with gui.add_folder("Lock", expand_by_default=False):
            self._locks = [self._lock(controls, i) for i in range(MOST_PARAMETERS)]

    def _lock(self, controls: Controls, index: int) -> Field:
        def asked(on: bool) -> Request | None:
            if index >= len(self._names):
                return None
            name = self._names[index]

            def hold(settings: FitSettings) -> FitSettings:
                held = {*settings.lock, name} if on else set(settings.lock) - {name}
                return replace(settings, lock=tuple(sorted(held)))

            return c.alter_settings(hold)

        return controls.field(controls.gui.add_checkbox("", False), asked)

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        search, running = session.search, session.searching
        latest = None if search is None else search.latest
        set_properties(
            self._go,
            label="Stop (space)" if running else "Search (space)",
            icon="player-stop" if running else "player-play",
        )
        several = len(session.document.scene.objects) > 1
        set_properties(self._all, visible=several and not running)
        for handle in self._ended:
            set_properties(handle, visible=latest is not None and not running)
        self._hide.show(session)
        self._methods.show(session)
        # Of a single loss the plot would make an axis from 0 to twice as much.
        set_properties(self._curve, visible=latest is not None and len(latest.improvements) > 1)
        key = None if latest is None else (latest.improvements, latest.restarts)
        if latest is not None and self._drawn != key:
            self._drawn = key
            self._curve.data = curve_of(latest)
        self._show_settings(session)

    def _show_settings(self, session: Session) -> None:
        settings = session.document.settings
        self._names = names = session.document.chart.names
        is_paper = settings.method == "paper"
        self._method.show(METHODS[settings.method])
        options = PAPER_PIXELS if is_paper else tuple(PIXELS)
        set_properties(self._pixels.handle, options=options)
        self._pixels.show(next(t for t, pixels in PIXELS.items() if pixels == settings.pixels))
        set_properties(self._grey, disabled=is_paper)
        for field, read in self._settings:
            field.show(read(settings))
        drawing = session.tool == "region"
        set_properties(self._region, label="Drag on the photo ..." if drawing else "Draw a region")
        set_properties(self._clear, visible=session.document.own.region is not None)
        for index, field in enumerate(self._locks):
            if index < len(names):
                set_properties(
                    field.handle, label=short_name(names[index]), hint=tooltip(names[index])
                )
            there = index < len(names)
            field.show(there and names[index] in settings.lock, visible=there)


class JudgePanel:
    """Tab "Judge": the verdict with its reasons, and how the model is shown."""

    def __init__(self, controls: Controls) -> None:
        gui, field = controls.gui, controls.field
        self._verdict = gui.add_markdown("", visible=False)
        self._look = field(
            gui.add_dropdown("Model (1-5, 0)", tuple(LOOKS.values())),
            lambda name: c.change_look(name=name, hidden=False),
        )
        self._opacity = field(
            gui.add_slider("Opacity", 0.0, 1.0, 0.05, 0.8),
            lambda share: c.change_look(opacity=float(share)),
        )
        self._hidden = field(
            gui.add_checkbox("Photo alone (B)", False), lambda on: c.change_look(hidden=on)
        )

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        look, verdict = session.look, verdict_text(session)
        set_properties(self._verdict, content=verdict, visible=bool(verdict))
        self._look.show(look.name)
        self._opacity.show(look.opacity, visible=look.name == "solid")
        self._hidden.show(look.hidden)


class SavePanel:
    """Tab "Save"."""

    def __init__(self, controls: Controls) -> None:
        self._state = controls.gui.add_markdown("")
        self._save = controls.button(SAVE, SavePose(), "cyan", icon="device-floppy")
        controls.download("Download pose", "pose")
        controls.download("Download overlay", "overlay", icon="photo-down")

    def show(self, session: Session, where: str) -> None:
        """Say whether the pose stands in a file; ``where`` it was or will be written."""
        set_properties(self._save, label=SAVE if is_alone(session.document) else SAVE_SCENE)
        text = "● unsaved changes" if session.unsaved else "no unsaved changes"
        lines = (text, plain(where), focal_note(session))
        set_properties(self._state, content="  \n".join(filter(None, lines)))


def _altered(settings: Any, name: str, value: Any) -> Any:
    """With another value of the field of this name, or of a field of one: ``limits.seconds``."""
    first, _, rest = name.partition(".")
    return replace(
        settings, **{first: _altered(getattr(settings, first), rest, value) if rest else value}
    )


def within(handle: Any, value: Any) -> Any:
    """A number as its field bounds it, once what is typed there is left."""
    least, most = getattr(handle, "min", None), getattr(handle, "max", None)
    return value if least is None or most is None else max(least, min(most, value))


def reflectance_text(mesh: Mesh) -> str:
    """Say where a model's colours come from: a grey model may miss files."""
    if mesh.textures:
        return f"{len(mesh.textures)} texture{'s' if len(mesh.textures) > 1 else ''}"
    return "coloured" if mesh.has_reflectance else "no colours"


def hint_of(session: Session) -> str:
    """The line over the photo (HTML): what the next click is for."""
    marks = session.document.marks
    match session.tool:
        case "region":
            return REGION_HINT
        case "box":
            return BOX_HINT
        case "wheels":
            wheel, point = divmod(len(marks.rims), FEWEST_RIM_POINTS)
            if wheel == WHEELS:
                what = "space: search from here"
            else:
                name = ("rear", "front")[wheel]
                what = f"click the {name} wheel's rim: point {point + 1} of {FEWEST_RIM_POINTS}"
        case "pairs":
            number = len(marks.pairs)
            if marks.waits_for_pixel:
                what = f"pair {number}: click the same point on the photo"
            else:
                what = f"pair {number + 1}: click a point of the model (2 shows it solid)"
        case tool if tool in HINTS:
            return HINTS[tool]
        case _ if session.searching:
            return SEARCHING_HINT
        case _:
            return USUAL_HINT if session.document.object.is_placed else PLACE_HINT
    return f"<b>{what}</b>{MARKING_HINT}"


def marks_text(session: Session) -> str:
    """Say what is marked, and how well the pose shows it (markdown)."""
    document = session.document
    marks = document.marks
    fewest = fewest_pairs(document.pose.camera)
    lines = []
    if marks.pairs and session.tool != "wheels":
        errors = pair_errors(document)
        rows = "".join(f"<br>pair {i}: {error:.1f} px" for i, error in enumerate(errors, 1))
        missing = fewest - pairs_done(document)
        lines.append(
            f"{missing} more pair{'s' * (missing > 1)} needed"
            if missing > 0
            else f"**error per pair**{rows}"
        )
    elif session.tool == "pairs":
        lines.append(f"{fewest} pairs give a pose")
    if session.tool == "wheels":
        lines.append(f"{len(marks.rims)} of {WHEELS * FEWEST_RIM_POINTS} points on the rims")
    if marks.note and session.tool in MARKING:
        lines.append(plain(marks.note))
    return "  \n".join(lines)


def proposals_text(session: Session) -> str:
    """Say how far the proposals are (markdown)."""
    asked = session.proposals
    if asked is not None and asked.running and session.preparation is not None:
        return "Waiting to begin."
    if asked is not None and asked.running:
        return "Trying views from everywhere (Esc stops it): some seconds, longer without a box."
    if asked is not None and _has_proposals(session):
        which = f"**proposal {asked.index + 1} of {len(asked.poses)}**"
        return f"{which}, the likeliest first  \nspace: search from here"
    return ""


def _has_proposals(session: Session) -> bool:
    """Whether there are proposals for what is open."""
    asked = session.proposals
    return asked is not None and bool(asked.poses) and asked.document.shows_same(session.document)


def curve_of(update: SearchUpdate) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n,) each: evaluations, the best loss by then as it is shown, and whether a restart began: 1,
    else 0. About each restart there are three evaluations, so that it is a line.
    """
    found = update.improvements[-CURVE_POINTS:]
    counts, losses = ([getattr(p, name) for p in found] for name in ("evaluations", "loss"))
    begun = np.array([p.evaluations for p in update.restarts if p.evaluations > counts[0]], float)
    end = max(update.progress.evaluations, counts[-1] + 1)
    beside = [*(begun - BESIDE_RESTART), *(begun + BESIDE_RESTART)]
    evaluations = np.array(sorted({*counts, *begun, *beside, end}), float)
    shown = update.progress.scale.shown(np.array(losses))
    best = shown[np.searchsorted(counts, evaluations, side="right") - 1]
    return evaluations, best, np.isin(evaluations, begun).astype(float)


def focal_note(session: Session) -> str:
    """Warn of a focal length that is a guess (markdown); "" where it is none."""
    document = session.document
    note = document.photo.focal_note(document.pose.camera)
    return note and f"⚠ {note}"


def search_text(session: Session) -> str:
    """Say how the search stands and its verdict, or the loss at the pose (markdown)."""
    search, losses = session.search, session.losses
    if session.preparation is not None:
        if session.preparation.trouble:
            return ""  # it is said above all panels
        if session.searching:
            return "Waiting to begin; the same button stops it."
        compiling = session.preparation.share is not None
        return "The loss comes when all is compiled." if compiling else PREPARING
    if search is None:
        if losses is not None and losses.mean is not None:
            count = len(losses.of_views)
            of_set = f", mean of {count} photos" if count > 1 else ""
            return f"**{losses.mean.text}** at this pose{of_set}"
        return plain(losses.note if losses else "") or PREPARING
    if search.latest is None:
        return "Preparing the search ..."
    progress = search.latest.progress
    stopped = not search.running and progress.status.name == "RUNNING"
    sentence = "Stopped: the best pose so far is shown." if stopped else progress.status.value
    settings = search.latest.settings
    count = len(search.asked.methods) if search.running else 1
    which = f", {search.asked.methods.index(settings) + 1} of {count} methods" if count > 1 else ""
    if len(search.asked.indices) > 1:
        one = session.document.scene.objects[search.latest.index]
        which += f"  \nOf all objects: **{plain(label_of(one))}**"
    text = (
        f"Method: {settings.method_name}{which}  \n"
        f"**{progress.loss_text}** (start {progress.scale.shown(progress.start_loss):.3f})  \n"
        f"{progress.evaluations} evaluations, restart {progress.restart}, "
        f"{progress.seconds:.1f} s  \n{sentence}"
    )
    return text if progress.verdict is None else f"{text}  \n**Verdict: {progress.verdict.word}.**"


def verdict_text(session: Session) -> str:
    """The verdict on the search that led to the pose, and why (markdown); "": there is none."""
    found = session.document.object.result
    verdict = None if found is None else found.verdict
    if verdict is None:
        return ""
    note = focal_note(session)
    reasons = "\n".join(
        f"- {plain(reason)}" for reason in (*verdict.reasons, *filter(None, (note,)))
    )
    return f"**Verdict: {verdict.word}.** {verdict.share_right}.{sure_text(session)}\n\n{reasons}"


def sure_text(session: Session) -> str:
    """Say in a paragraph how sure the pose is (markdown); "" where that is not known."""
    sure = session.covariance_in(session.document.at)
    if sure is None:
        return ""
    unit = session.document.mesh.unit
    return f"\n\n**How sure, if right:** {plain(sure.words(unit))} (standard deviations)."
