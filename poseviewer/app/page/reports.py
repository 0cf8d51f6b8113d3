"""Requests that mouse and keys stand for, from the reports of the page's script."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state import objects as o
from poseviewer.app.state.actions import ACTIONS, LOOKS
from poseviewer.app.state.edits import Edit
from poseviewer.app.workers.tasks import Request, Task, grow
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
KEYS: Mapping[str, Request] = {
    code: action.asked for action in ACTIONS.values() if action.asked for code in action.keys
}
REVIEW: Mapping[str, Callable[[Reviewer], Task]] = {
    "KeyN": lambda review: review.step(1),
    "KeyP": lambda review: review.step(-1),
    "KeyA": lambda review: review.decide("accepted"),
    "KeyX": lambda review: review.decide("rejected"),
}
"""Keys of a review."""
HELP = "| | |\n|---|---|\n" + "".join(
    f"| {action.how} | {action.what} |\n" for action in ACTIONS.values() if action.how
)
FORWARDED = [*NUDGES, *KEYS, "KeyF", *REVIEW, "?"]
"""``event.code`` (or ``event.key``) of the keys that the page hands on, or heeds itself."""
LEFT_TO_BROWSER = ["KeyF", "KeyR", "KeyB", "KeyH", *LOOKS, *REVIEW]
"""Not taken where ctrl is held: find, reload, and so on."""
OBJECTS: Mapping[str, Callable[[int], Edit]] = {
    "pick": o.pick_object,
    "remove": o.remove_object,
    "hide": lambda number: o.alter_object(number, hidden=True),
    "show": lambda number: o.alter_object(number, hidden=False),
    "lock": lambda number: o.alter_object(number, locked=True),
    "unlock": lambda number: o.alter_object(number, locked=False),
}
"""Wishes about an object in the list."""
PHOTOS: Mapping[str, Callable[[int], Edit]] = {
    "look": o.show_view,
    "compare": lambda index: o.compare_view(index, True),
    "leave": lambda index: o.compare_view(index, False),
}
"""Wishes about a photo in the strip."""
DRAG = c.drag_to(0.0, 0.0).change


def request_of(report: Mapping[str, Any], review: Reviewer | None = None) -> Request | str | None:
    """The request that a report means, or a sentence for the page that it comes from; None for a
    report that makes no sense.
    """
    try:
        return _request_of(report, review)
    except (KeyError, OverflowError, TypeError, ValueError):
        return None  # not from our script: nothing to do, and nobody to tell


def _request_of(report: Mapping[str, Any], review: Reviewer | None) -> Request | str | None:
    match report["kind"]:
        case "press":
            held = bool(report.get("shift")), bool(report.get("ctrl"))
            return c.press(*_point(report), _zoom(report), *held)
        case "drag":
            return c.drag_to(*_point(report))
        case "release":
            return c.release()
        case "cancel":
            return c.cancel_drag()
        case "stroke":
            return _stroke(report)
        case "part":
            return h.bring_back(int(report["index"]))
        case "double":
            return c.double_press(*_point(report), _zoom(report))
        case "pick":
            pair = int(report["first"]), int(report["second"])
            return c.pick_in_landscape(*pair, _finite(report["u"]), _finite(report["v"]))
        case "enlarge":
            return c.enlarge_map(int(report["first"]), int(report["second"]))
        case "object":
            return OBJECTS[report["wish"]](int(report["number"]))
        case "row":
            return None if review is None else review.open_row(int(report["index"]))
        case "photo":
            return PHOTOS[report["wish"]](int(report["index"]))
        case "key":
            return _key(report, review)
        case "unfit":
            return why_unfit(str(report["name"]), int(report["size"]), int(report["count"]))
        case "unreadable" | "empty" | "cut off" as trouble:
            return why_not_sent(str(report["name"]), trouble)
    return None


def _key(report: Mapping[str, Any], review: Reviewer | None) -> Request | None:
    code, shift, ctrl = str(report.get("code")), bool(report.get("shift")), report.get("ctrl")
    if code in NUDGES:
        kind, x, y = NUDGES[code]
        factor = FINE if shift else COARSE if ctrl else 1.0
        return c.nudge(kind, x * factor, y * factor)
    if report.get("repeat"):
        return None
    if code in REVIEW:
        return None if review is None else REVIEW[code](review)
    return (shift and KEYS.get(f"shift {code}")) or KEYS.get(code)


def _stroke(report: Mapping[str, Any]) -> Request:
    shape = report["shape"]
    if shape not in h.SHAPES:
        raise ValueError(f"{shape!r} is no shape")
    places = [_finite(value) for value in report["points"]]
    points = np.array(places).reshape(-1, 2)
    if len(points) < (3 if shape == "polygon" else 1):
        raise ValueError("too few points")
    stroke = h.Stroke(shape, points, abs(_finite(report["radius"])), bool(report["erase"]))
    return grow(stroke) if shape == "scribble" else h.paint(stroke)


def _point(report: Mapping[str, Any]) -> tuple[float, float]:
    return _finite(report["x"]), _finite(report["y"])


def _zoom(report: Mapping[str, Any]) -> float:
    return min(max(_finite(report.get("zoom", 1.0)), 1e-3), 1e3)


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
    return isinstance(request, Edit) and request.change is DRAG
