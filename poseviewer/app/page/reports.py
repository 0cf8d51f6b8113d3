"""Requests that mouse and keys stand for, from the reports of the page's script."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state import objects as o
from poseviewer.app.state.objects import compare_view, show_view
from poseviewer.app.state.requests import (
    Decide,
    OpenRow,
    Report,
    Request,
    SavePose,
    ShowHelp,
    StepRow,
    Unfit,
)
from poseviewer.app.state.session import Session
from poseviewer.files.state.uploads import why_not_sent, why_unfit

LARGEST = 1e6
"""px: the largest distance of a pointer from the photo's corner."""
FINE, COARSE = 0.1, 10.0
"""Factors of nudges with shift, and with ctrl."""
NUDGES: Mapping[str, tuple[c.NudgeKind, float, float]] = {
    "ArrowLeft": ("move", -1.0, 0.0),
    "ArrowRight": ("move", 1.0, 0.0),
    "ArrowUp": ("move", 0.0, -1.0),
    "ArrowDown": ("move", 0.0, 1.0),
    "KeyJ": ("turn", -1.0, 0.0),
    "KeyL": ("turn", 1.0, 0.0),
    "KeyI": ("turn", 0.0, -1.0),
    "KeyK": ("turn", 0.0, 1.0),
    "KeyU": ("roll", -1.0, 0.0),
    "KeyO": ("roll", 1.0, 0.0),
    "PageUp": ("scale", 1.0, 0.0),
    "PageDown": ("scale", -1.0, 0.0),
}
LOOKS = {
    "Digit1": "outline",
    "Digit2": "solid",
    "Digit3": "relit",
    "Digit4": "normals",
    "Digit5": "residual",
    "Digit0": "none",
}
REVIEW: Mapping[str, Request] = {
    "KeyN": StepRow(1),
    "KeyP": StepRow(-1),
    "KeyA": Decide("accepted"),
    "KeyX": Decide("rejected"),
}
"""Keys of a review."""
PLAIN: Mapping[str, Request] = {
    "KeyY": c.redo(),
    "KeyR": c.reset_to_start(),
    "KeyS": SavePose(),
    "Escape": c.cancel_drag(),
}
TOGGLES = ("Space", "KeyB", "KeyH", "KeyZ")
"""Keys whose meaning depends on the session or on shift."""
OBJECTS: Mapping[str, Callable[[int], Request]] = {
    "pick": o.pick_object,
    "remove": o.remove_object,
    "hide": lambda number: o.alter_object(number, hidden=True),
    "show": lambda number: o.alter_object(number, hidden=False),
    "lock": lambda number: o.alter_object(number, locked=True),
    "unlock": lambda number: o.alter_object(number, locked=False),
}
"""Wishes about an object in the list."""
PHOTOS: Mapping[str, Callable[[int], Request]] = {
    "look": show_view,
    "compare": lambda index: compare_view(index, True),
    "leave": lambda index: compare_view(index, False),
}
"""Wishes about a photo in the strip."""
FORWARDED = [*NUDGES, *LOOKS, *TOGGLES, *PLAIN, "KeyF", *REVIEW, "?"]
"""``event.code`` (or ``event.key``) of the keys that the page hands on, or heeds itself."""
LEFT_TO_BROWSER = ["KeyF", "KeyR", "KeyB", "KeyH", "Digit0", "Digit1", *REVIEW]
"""Not taken where ctrl is held: find, reload, and so on."""
HELP = """
| | |
|---|---|
| **drag** | move the model; a pin, if you hit one |
| **shift + drag** | turn it as a ball about its centre |
| **ctrl + drag** | roll it, and make it larger or smaller |
| **double-click** | pin the surface there, or take the pin away |
| **wheel**, **right drag**, **F** | zoom at the pointer, pan, whole photo |
| **arrows** | move by 1 px |
| **J L**, **I K**, **U O** | turn, tilt, roll by 1 degree |
| **page up / down** | 1 % larger, smaller |
| *with* **shift** / **ctrl** | a tenth / ten times as much |
| **space** | start and stop the search |
| **1 2 3 4 5**, **0** | outline, solid, relit, normals, residual, nothing |
| **B** | blink: photo, model |
| **H** | hide what is in front: wheel brush size, **alt** erase |
| **R** | back to the start pose |
| **Z**, **ctrl Z** / **Y**, **ctrl shift Z** | undo / redo |
| **S**, **ctrl S** | save the pose |
| **Esc** | let go, leave a tool, stop what is looked for or read |
| **A**, **X**, **N**, **P** | in a review: accept, reject, next, previous |
"""


def request_of(report: Report, session: Session) -> Request | None:
    """The request that a report means; None for one that makes no sense."""
    try:
        return _request_of(report, session)
    except (KeyError, OverflowError, TypeError, ValueError):
        return None  # not from our script: nothing to do, and nobody to tell


def _request_of(report: Report, session: Session) -> Request | None:
    content = report.content
    match content["kind"]:
        case "press" if session.tool == "part":
            return h.leave_out(*_point(content))
        case "press":
            held = bool(content.get("shift")), bool(content.get("ctrl"))
            return c.press(*_point(content), _zoom(content), *held)
        case "drag":
            return c.drag_to(*_point(content))
        case "release":
            return c.release()
        case "cancel":
            return c.cancel_drag()
        case "stroke":
            return _stroke(content)
        case "part":
            return h.bring_back(int(content["index"]))
        case "double":
            if session.tool in h.HIDING:
                return None
            return c.double_press(*_point(content), _zoom(content))
        case "pick":
            pair = int(content["first"]), int(content["second"])
            return c.pick_in_landscape(*pair, _finite(content["u"]), _finite(content["v"]))
        case "enlarge":
            return c.enlarge_map(int(content["first"]), int(content["second"]))
        case "object":
            return OBJECTS[content["wish"]](int(content["number"]))
        case "row":
            return OpenRow(int(content["index"]))
        case "photo":
            return PHOTOS[content["wish"]](int(content["index"]))
        case "key":
            return _key(content, session, report.client)
        case "unfit":
            size, count = int(content["size"]), int(content["count"])
            return Unfit(report.client, why_unfit(str(content["name"]), size, count))
        case "unreadable" | "empty" | "cut off" as trouble:
            return Unfit(report.client, why_not_sent(str(content["name"]), trouble))
    return None


def _key(content: Mapping[str, Any], session: Session, client: int) -> Request | None:
    code, shift, ctrl = str(content.get("code")), bool(content.get("shift")), content.get("ctrl")
    if content.get("key") == "?":
        return ShowHelp(client)
    if code in NUDGES:
        kind, x, y = NUDGES[code]
        factor = FINE if shift else COARSE if ctrl else 1.0
        return c.nudge(kind, x * factor, y * factor)
    if content.get("repeat"):
        return None
    if code in LOOKS and not ctrl:
        return c.change_look(name=LOOKS[code], hidden=False)
    if code in REVIEW:
        return None if ctrl else REVIEW[code]
    match code:
        case "Space":
            return c.stop_search() if session.searching else c.start_search()
        case "KeyZ":
            return c.redo() if shift else c.undo()
        case "KeyB":
            return c.change_look(hidden=not session.look.hidden)
        case "KeyH":
            return c.set_tool("pose" if session.tool in h.HIDING else "brush")
    return PLAIN.get(code)


def _stroke(content: Mapping[str, Any]) -> Request:
    shape = content["shape"]
    if shape not in h.SHAPES:
        raise ValueError(f"{shape!r} is no shape")
    places = [_finite(value) for value in content["points"]]
    points = np.array(places).reshape(-1, 2)
    if len(points) < (3 if shape == "polygon" else 1):
        raise ValueError("too few points")
    stroke = h.Stroke(shape, points, abs(_finite(content["radius"])), bool(content["erase"]))
    return h.Grow(stroke) if shape == "scribble" else h.paint(stroke)


def _point(content: Mapping[str, Any]) -> tuple[float, float]:
    return _finite(content["x"]), _finite(content["y"])


def _zoom(content: Mapping[str, Any]) -> float:
    return min(max(_finite(content.get("zoom", 1.0)), 1e-3), 1e3)


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number) or abs(number) > LARGEST:
        raise ValueError(f"{value!r} is no place")
    return number


def newest_drags(requests: list[Request]) -> list[Request]:
    """The requests without those drags that another one follows at once."""
    kept: list[Request] = []
    for request in requests:
        if kept and _is_drag(request) and _is_drag(kept[-1]):
            kept[-1] = request
        else:
            kept.append(request)
    return kept


def _is_drag(request: Request) -> bool:
    return isinstance(request, Report) and request.content.get("kind") == "drag"
