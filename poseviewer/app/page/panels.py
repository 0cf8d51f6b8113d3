"""Controls of the left panel: the status above, and the steps in the order of the work."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from viser import uplot

from poseviewer.app.page.above_steps import parts_left_out
from poseviewer.app.page.controls import Controls, memoize, plain
from poseviewer.app.page.handles import model_card
from poseviewer.app.page.result import ABOUT, unit_of
from poseviewer.app.page.status import FIRST, status_html
from poseviewer.app.page.strip import proposals_row
from poseviewer.app.page.texts import (
    TEXTURE_BUTTON,
    ends_table,
    files_text,
    marks_text,
    notes_text,
    occlusion_text,
    proposals_text,
    search_text,
    verdict_text,
)
from poseviewer.app.state import hiding as h
from poseviewer.app.state.document import MARKING, is_alone
from poseviewer.app.state.edits import AskNumbers, show_style
from poseviewer.app.state.keys_and_buttons import ACTIONS, STYLES
from poseviewer.app.state.objects import alter_object, set_unit, unit_of_models
from poseviewer.app.state.pointer_edits import set_tool
from poseviewer.app.state.pose_edits import (
    MAX_FIELD_DEG,
    MIN_FIELD_DEG,
    intrinsics_of,
    pose_numbers,
    set_camera,
    set_field_of_view,
    set_number,
    set_parameter,
    set_projection,
    view_from,
)
from poseviewer.app.state.search_edits import (
    alter_settings,
    propose_starts,
    set_loss,
    take_end,
)
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import CONVERTED, OF_FRAMES, WITH_NUMBERS
from poseviewer.app.workers.tasks import Request, download, find_wheels_in_region, paint_active
from poseviewer.files.camera_trees import TREES
from poseviewer.files.mesh.named import missing_textures
from poseviewer.files.mesh.size import METRES
from poseviewer.files.photo import ENDINGS
from poseviewer.fit.progress import SearchProgress
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel
from poseviewer.geometry.charts import short_name, tooltip
from poseviewer.geometry.lens import COEFFICIENTS
from poseviewer.losses.known_losses import LOSSES
from poseviewer.render.overlay.styles import SOLID_OPACITY
from poseviewer.scene.settings import SEARCHES
from poseviewer.starts.sides import SIDES

UNIT_HINT = "Saved with the pose; formats that have a unit of their own need it"
MAX_PARAMETERS = 10
"""Most parameters of any chart: six, focal length, principal point, size; others are hidden."""
NUMBERS = "X", "Y", "Z", "turn x", "turn y", "turn z", "scale"
"""Numbers of a pose that have a field."""
NUMBER_STEPS = {name: 0.1 if "turn" in name else 0.01 for name in NUMBERS}
"""Step of the arrows of each field."""
LOG_SIZE = "log_size"
"""Parameter of the model's size, in charts of photos whose scale is not known."""
CURVE_POINTS = 300
"""Newest improvements in the plot of the search."""
PIXELS = {"near": "near the model", "whole": "whole photo", "clip": "inside the model"}
IN_FRONT = {"find": "find it", "painted": "only what I painted", "nothing": "nothing"}
PAINT_HINT = (
    "Give the model the colours that photos show of it, at its pose; other photos are searched by "
    "these"
)
CALIBRATION_HINT = (
    "What OpenCV, ROS, Kalibr, COLMAP, MATLAB and others write of a camera: YAML, JSON, XML, text"
)
PRINCIPAL_HINT = (
    "That of a cropped photo is not in its middle. By several photos, or a car's wheels."
)
IN_FRONT_HINT = (
    "What hides the model: what the search finds and you painted, or that alone, or nothing."
)
BESIDE_RESTART = 1e-3
"""Evaluations between a restart's line on the curve and what is not one."""
AS_IT_IS = "as it is"
SEARCHES_HINT = "How the loss is minimised; each goes with each loss."
WAITING = '<div class="pv-wait"></div>'
"""A moving bar, for work of unknown length."""


def _has_region(session: Session) -> bool:
    return session.document.in_view.region is not None


def _is_parallel(session: Session) -> bool:
    return isinstance(session.document.pose.camera, Parallel)


def _is_painted(session: Session) -> bool:
    return session.document.object.painting is not None


def _paint_label(session: Session) -> str:
    """Name of what the model is painted from."""
    scene = session.document.scene
    several = "Paint from the photos" if len(scene.views) > 1 else "Paint from this photo"
    return "Paint from the keys" if scene.frames else several


def idle_buttons(session: Session) -> list[str]:
    """Labels of the buttons in groups, which viser cannot disable, that would do nothing now."""
    history, progress = session.history, session.search_progress
    has_ended = progress is not None and progress.is_over
    useful = {"undo": history.past, "redo": history.future, "keep": has_ended, "revert": has_ended}
    return [ACTIONS[name].label() for name, is_useful in useful.items() if not is_useful]


def add_status(controls: Controls, first: str = FIRST) -> None:
    """Status and search above the steps; ``first`` is said until something has been done."""
    controls.html(lambda s: status_html(s, first))
    icon = {"icon": lambda s: "player-stop" if s.is_searching else "player-play"}
    ends = lambda s: s.is_searching or s.is_propagating  # noqa: E731
    # A tooltip would lie over the status.
    controls.action("search", ends, color="cyan", hint=None, **icon)


def add_opening(controls: Controls) -> None:
    """Step "Open": files, further objects, help, and what is to be known of the files."""
    controls.text(files_text)
    controls.upload("Photo ...", "photo", "photo")
    controls.upload("Model ...", "model", "cube")
    missing = lambda s: missing_textures(s.document.mesh.notes)  # noqa: E731
    options: Any = {"missing": missing, "visible": lambda s: bool(missing(s))}
    controls.upload(TEXTURE_BUTTON, "model", "photo-plus", accepted=",".join(ENDINGS), **options)
    controls.upload("Folder ...", None, "folder-open")
    controls.upload("Pose file ...", "pose", "file-import")
    with controls.gui.add_folder("Several objects", expand_by_default=False):
        controls.upload("Add another object ...", "model", "cube-plus", adds=True)
        controls.action("add same", icon="copy")
        _add_object_text(controls, "name")
    controls.action("help", icon="help")
    _add_card(controls)
    controls.text(notes_text)


def _add_card(controls: Controls) -> None:
    """A small picture of the model where it is not placed; below all that is pressed."""
    shown = lambda s: (s.results.alone, s.document.object, s.document.object.is_placed)  # noqa: E731
    controls.html(memoize(shown, model_card))


def add_placing(controls: Controls) -> None:
    """Step "Place": ways to place the model, views, history, numbers, the camera."""
    gui = controls.gui
    _add_ways(controls)
    view = gui.add_dropdown("View", (AS_IT_IS, *SIDES))

    def look_from(side: str) -> Request | None:
        view.value = AS_IT_IS
        return view_from(side) if side in SIDES else None

    controls.field(view, look_from)
    controls.actions("History", "undo", "redo")
    controls.actions("Start", "reset", "start")
    with gui.add_folder("Numbers", expand_by_default=False):
        _add_numbers(controls)
    with gui.add_folder("Camera", expand_by_default=False):
        _add_camera(controls)
    _add_card(controls)


def _add_ways(controls: Controls) -> None:
    """A pose from a box, from marks on the photo, or proposed ones."""
    hint = "A rectangle, points in model and photo, a car's rims, or what is found without a hand"
    controls.actions("Place by", "box", "pairs", "wheels", "propose", hint=hint)
    stop = ACTIONS["propose"].end
    controls.button(stop, propose_starts(), visible=lambda s: s.is_proposing)

    def is_for_wheels(session: Session) -> bool:
        is_vehicle = session.document.model.keypoints is not None
        return is_vehicle and (session.tool == "wheels" or _has_region(session))

    # Wheels are looked for in the region; where there is none yet, it is drawn first.
    controls.button(
        lambda s: f"Find wheels{' in the' if _has_region(s) else ': draw a'} region",
        lambda s, _: find_wheels_in_region() if _has_region(s) else set_tool("region"),
        visible=is_for_wheels,
    )
    again = {"visible": lambda s: is_for_wheels(s) and _has_region(s)}
    controls.action("region", label=lambda _: "Draw another region", **again)
    controls.text(marks_text)
    has_wheels = lambda s: s.tool == "wheels" and s.document.model.keypoints is not None  # noqa: E731
    controls.action("remark", visible=has_wheels)
    for name in ("unmark", "clear", "done"):
        controls.action(name, visible=lambda s: s.tool in MARKING)
    controls.html(lambda s: WAITING if s.is_proposing else "")
    controls.text(proposals_text)
    several = {"visible": lambda s: bool(s.proposals and s.proposals.starts[1:])}
    controls.actions("Proposal", "previous", "next", **several)
    controls.html(memoize(lambda s: (s.proposals, s.document.photo), proposals_row))


def _add_numbers(controls: Controls) -> None:
    """Fields of the pose's numbers, with units; of the size among photos of unknown scale."""

    def number(session: Session, name: str) -> float | None:
        return pose_numbers(session.document.pose).get(name)

    def log_size(session: Session) -> float | None:
        chart = session.document.chart
        return float(session.document.parameters[-1]) if LOG_SIZE in chart.names else None

    for name, step in NUMBER_STEPS.items():
        controls.field(
            controls.gui.add_number(name, 0.0, step=step),
            partial(set_number, name),
            visible=lambda s, name=name: number(s, name) is not None,
            label=lambda s, name=name: f"{name} ({unit_of(s, name)})",
            hint=ABOUT,
            value=lambda s, name=name: number(s, name) or 0.0,
        )
    controls.field(
        controls.gui.add_number("size (x start)", 1.0, min=1e-6, max=1e6, step=0.001),
        lambda value: set_parameter(LOG_SIZE, math.log(value)),
        visible=lambda s: log_size(s) is not None,
        value=lambda s: math.exp(log_size(s) or 0.0),
    )


def _add_lock(controls: Controls, index: int) -> None:
    """Checkbox that locks a parameter of the chart in a search."""

    def name(session: Session) -> str:
        names = session.document.chart.names
        return names[index] if index < len(names) else ""

    def lock(on: bool) -> Request:
        own = {name(controls.session)}
        return _alter("lock", lambda now: tuple(sorted({*now} | own if on else {*now} - own)))

    controls.field(
        controls.gui.add_checkbox("", False),
        lock,
        visible=lambda s: bool(name(s)),
        label=lambda s: short_name(name(s)),
        hint=lambda s: tooltip(name(s)),
        value=lambda s: name(s) in s.document.settings.lock,
    )


def _add_camera(controls: Controls) -> None:
    """A calibration's file; projection, field of view, and intrinsics in px as OpenCV has them."""
    gui = controls.gui
    options: Any = {"accepted": ",".join(TREES), "hint": CALIBRATION_HINT}
    controls.upload("Calibration file ...", None, "camera-up", **options)
    hint = "OpenCV's model of the lens, for a calibration file that does not say it"
    model = gui.add_dropdown("Lens model", ("as it says", *COEFFICIENTS), hint=hint)
    controls.lens_model = lambda: model.value if model.value in COEFFICIENTS else None
    controls.field(
        gui.add_dropdown("Projection", ("perspective", "parallel")),
        set_projection,
        value=lambda s: "parallel" if _is_parallel(s) else "perspective",
    )
    controls.field(
        gui.add_number("Field of view (°)", 50.0, min=MIN_FIELD_DEG, max=MAX_FIELD_DEG, step=0.1),
        set_field_of_view,
        value=_field_of_view,
        visible=lambda s: not _is_parallel(s),
    )

    for index, name in enumerate(("fx", "fy", "cx", "cy")):
        controls.field(
            gui.add_number(f"{name} (px)", 1.0, step=0.01),
            lambda value, name=name: set_camera(**{name: value}),
            value=lambda s, i=index: intrinsics_of(s.document.pose.camera)[i],
            visible=lambda s, i=index: i > 1 or not _is_parallel(s),
        )


def _field_of_view(session: Session) -> float:
    """Degrees along the photo's longer side."""
    photo, focal = session.document.photo, intrinsics_of(session.document.pose.camera)
    side, px = max((photo.width, focal[0]), (photo.height, focal[1]), key=lambda pair: pair[0])
    return math.degrees(2.0 * math.atan(side / 2.0 / px))


def add_fitting(controls: Controls) -> None:
    """Step "Fit": by what a search goes, its result, what it may change."""

    def pixels_of(session: Session) -> tuple[str, ...]:
        allowed = session.document.settings.minimised.pixels
        return tuple(label for name, label in PIXELS.items() if name in allowed)

    names = ("loss", "pixels", "searched_by")
    loss, pixels, search = (attrgetter(f"document.settings.{name}") for name in names)
    labels = {name: own.label for name, own in LOSSES.items()}
    hint = " ".join(own.hint for own in LOSSES.values())
    controls.dropdown("Loss", labels, set_loss, loss, hint)
    controls.dropdown("Pixels", PIXELS, partial(_set, "pixels"), pixels, options=pixels_of)
    controls.dropdown("Search", SEARCHES, partial(_set, "search"), search, SEARCHES_HINT)
    several = {"visible": lambda s: len(s.document.scene.objects) > 1}
    controls.action("search all", disabled=lambda s: s.is_searching, **several)
    _add_hiding(controls)
    controls.action("compare", icon="arrows-diff", disabled=lambda s: s.is_searching)
    controls.text(memoize(lambda s: (s.comparison,), lambda s: ends_table(s.comparison)))
    takes = {name.capitalize(): take_end(index) for index, name in enumerate(LOSSES)}
    controls.choices("Take", takes, visible=lambda s: s.comparison is not None)
    with controls.gui.add_folder("Settings", expand_by_default=False):
        _add_settings(controls)
    controls.actions("Result", "keep", "revert")
    controls.text(search_text)
    _add_curve(controls)  # last, as it is the highest: all that can be pressed is in sight


def _add_curve(controls: Controls) -> None:
    """Plot of the best loss so far."""
    grid = {"stroke": "rgba(128,128,128,.25)", "width": 1}
    axis = {"stroke": "#8a92a0", "grid": grid, "ticks": grid}
    restart = {"stroke": "#e0a92e", "width": 1, "scale": "restart", "points": {"show": False}}
    curve = controls.gui.add_uplot(
        (np.zeros(2), np.zeros(2), np.zeros(2)),
        ({}, {"stroke": "#17a2b8", "width": 2}, restart),  # pyright: ignore
        # The restarts' scale begins above 0: where there is none, nothing is drawn.
        scales={
            "x": uplot.Scale(time=False, auto=True),
            "restart": uplot.Scale(auto=False, range=(0.2, 0.8)),
        },
        axes=({**axis, "size": 30}, {**axis, "size": 54}),  # pyright: ignore
        legend=uplot.Legend(show=False),
        title="best loss so far (vertical lines: restarts)",
        height=120,
        padding=(10, 26, 0, 0),
    )

    def steps(session: Session) -> tuple[object, ...]:
        progress = session.search_progress
        return (progress.improvements, progress.restarts) if progress else (None, None)

    def draw(session: Session) -> bool:
        """Draw the plot; of a single loss it would make an axis from 0 to twice as much."""
        progress = session.search_progress
        if progress is None or len(progress.improvements) < 2:
            return False
        curve.data = curve_of(progress)
        return True

    controls.add(curve, visible=memoize(steps, draw))


def _add_hiding(controls: Controls) -> None:
    """The tools that hide, and what is hidden."""

    def is_hiding(session: Session) -> bool:
        return session.tool in h.HIDING

    def hiding_key(session: Session) -> tuple[Any, ...]:
        document = session.document
        ended = None if session.is_searching else session.search
        masks, choice = h.masks_of(session), document.settings.in_front
        found = document.occluders
        return *masks, choice, found, document.object.result, document.view_index, ended

    in_front = attrgetter("document.settings.in_front")
    controls.dropdown("In front", IN_FRONT, partial(_set, "in_front"), in_front, IN_FRONT_HINT)
    controls.text(memoize(hiding_key, occlusion_text))
    controls.action("hide", is_hiding, icon="brush")
    tools = {tool.capitalize(): set_tool(tool) for tool in h.HIDING}
    controls.choices("Tool", tools, lambda s: s.tool.capitalize(), visible=is_hiding)
    erase = controls.gui.add_checkbox("Erase (alt)", False)
    controls.bind(erase, "pen", "erases", visible=lambda s: s.tool in h.SHAPES)
    for_one = controls.gui.add_checkbox("For this object only", False)
    several = lambda s: s.tool in h.SHAPES and len(s.document.scene.objects) > 1  # noqa: E731
    controls.bind(for_one, "pen", "for_one", visible=several)
    has_found = memoize(hiding_key, lambda s: h.occlusion_pixels(s) is not None)
    controls.action("hide found", visible=has_found)
    of_frame = lambda s: any(s.document.mask_of(kind) for kind in h.KINDS[:2])  # noqa: E731
    controls.action("hide all", visible=lambda s: bool(s.document.scene.frames) and of_frame(s))
    has_masks = lambda s: any(h.masks_of(s)) or bool(s.document.occluders)  # noqa: E731
    controls.action("unhide", visible=lambda s: is_hiding(s) and has_masks(s))
    controls.html(lambda s: parts_left_out(s.document.mesh))


def _add_settings(controls: Controls) -> None:
    gui = controls.gui

    def setting(handle: Any, name: str, **options: Any) -> None:
        """An input of a setting, or of a limit: ``limits.seconds``."""
        value = attrgetter(f"document.settings.{name}")
        controls.field(handle, partial(_set, name), value=value, **options)

    setting(gui.add_dropdown("Parameters", ("auto", "vehicle", "free-body")), "chart")
    controls.action("region", lambda s: s.tool == "region")
    controls.action("clear region", visible=_has_region)
    is_grey = attrgetter("document.settings.minimised.is_grey")
    setting(gui.add_checkbox("Use greyscale", False), "grey", disabled=is_grey)
    setting(gui.add_checkbox("Find the focal length", False), "free_focal")
    principal = gui.add_checkbox("Find the principal point", False, hint=PRINCIPAL_HINT)
    setting(principal, "free_principal_point", disabled=_is_parallel)
    evaluations = gui.add_number("Max evaluations", 20_000, min=10, max=1_000_000, step=10)
    setting(evaluations, "limits.evaluations")
    seconds = gui.add_number("Time limit (s)", 600.0, min=0.1, max=86_400.0, step=0.1)
    setting(seconds, "limits.seconds")
    setting(gui.add_dropdown("Renderer", ("auto", "software", "gpu")), "renderer")
    setting(gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1), "seed")
    with gui.add_folder("Lock", expand_by_default=False):
        for index in range(MAX_PARAMETERS):
            _add_lock(controls, index)


def _add_object_text(controls: Controls, name: str) -> None:
    """A field for a text of the active object."""
    controls.field(
        controls.gui.add_text(name.capitalize(), ""),
        lambda text: alter_object(controls.session.document.object_id, **{name: text}),
        value=attrgetter(f"document.object.{name}"),
    )


def add_judging(controls: Controls) -> None:
    """Step "Judge": how the model is shown, and the verdict with its reasons."""
    gui = controls.gui
    style = gui.add_dropdown("Model (1-5, 0)", tuple(STYLES.values()))
    controls.field(style, show_style, value=attrgetter("display.style"))
    opacity = gui.add_slider("Opacity", 0.0, 1.0, 0.05, SOLID_OPACITY)
    controls.bind(opacity, "display", "opacity", visible=lambda s: s.display.style == "solid")
    controls.bind(gui.add_checkbox(ACTIONS["blink"].label(), False), "display", "photo_alone")
    controls.action("measure", lambda s: s.tool == "measure", icon="ruler-measure")
    controls.button(_paint_label, lambda *_: paint_active(), icon="palette", hint=PAINT_HINT)
    controls.action("unpaint", visible=_is_painted)
    controls.text(verdict_text)  # last, as its length changes


def add_saving(controls: Controls) -> None:
    """Step "Save": whether the pose stands in a file, and where it was or will be written."""

    def state(session: Session) -> str:
        text = "● unsaved changes" if session.is_unsaved else "no unsaved changes"
        return f"{text}  \n{plain(controls.where)}"

    controls.text(state)
    _add_object_text(controls, "note")
    scene = ACTIONS["save"].label().replace("pose", "scene")
    label = {"label": lambda s: ACTIONS["save"].label() if is_alone(s.document) else scene}
    controls.action("save", **label, color="cyan", icon="device-floppy")
    controls.download("Download pose", "pose")
    controls.download("Download overlay", "overlay", icon="photo-down")
    controls.download("Export painted model", "painted", icon="palette", visible=_is_painted)
    kind = controls.gui.add_dropdown("Format", tuple(CONVERTED))
    of_frames = lambda s: (*(OF_FRAMES if s.document.scene.frames else ()), *CONVERTED)  # noqa: E731
    controls.add(kind, options=of_frames)
    units = {None: "not said", **{name: name for name in METRES}}
    controls.dropdown("Model's unit", units, set_unit, unit_of_models, UNIT_HINT)

    def export_as(_: Session, client: int) -> Request:
        what = kind.value
        return (AskNumbers if what in WITH_NUMBERS else download)(what, client)

    controls.button("Export as ...", export_as, icon="share")


STEPS = {
    "Open": add_opening,
    "Place": add_placing,
    "Fit": add_fitting,
    "Judge": add_judging,
    "Save": add_saving,
}
"""Tabs of the left panel in the order of the work, and what makes their controls."""


def _alter(name: str, change: Callable[[Any], Any]) -> Request:
    """An edit of the setting of a name."""
    return alter_settings(lambda now: replace(now, **{name: change(getattr(now, name))}))


def _set(name: str, value: Any) -> Request:
    """An edit that gives a setting, or a limit (``limits.seconds``), a value."""
    first, _, limit = name.partition(".")
    return _alter(first, lambda now: replace(now, **{limit: value}) if limit else value)


def curve_of(progress: SearchProgress) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n,) each: evaluations, the best loss by then, and 1 in the middle of three at a restart."""
    steps = progress.improvements[-CURVE_POINTS:]
    counts, losses = ([getattr(p, name) for p in steps] for name in ("evaluations", "loss"))
    begun = np.array([p.evaluations for p in progress.restarts if p.evaluations > counts[0]], float)
    end = max(progress.progress.evaluations, counts[-1] + 1)
    beside = [*(begun - BESIDE_RESTART), *(begun + BESIDE_RESTART)]
    evaluations = np.array(sorted({*counts, *begun, *beside, end}), float)
    shown = progress.progress.scale.as_shown(np.array(losses))
    best = shown[np.searchsorted(counts, evaluations, side="right") - 1]
    return evaluations, best, np.isin(evaluations, begun).astype(float)
