"""From what a page's script reports to the command that it stands for."""

from __future__ import annotations

import math
from typing import Any

from poseviewer.app.page.keys import REVIEW, command_for
from poseviewer.app.state import commands as c
from poseviewer.app.state.requests import Report, Request, Review, SavePose, ShowHelp, Unfit
from poseviewer.app.state.session import Session
from poseviewer.files.state.uploads import why_unfit

LARGEST = 1e6
"""No pointer is farther than so many px from the photo's corner."""


def command_of(report: Report, session: Session) -> Request | None:
    """The request that a report means; None for one that makes no sense."""
    try:
        return _command_of(report, session)
    except (KeyError, OverflowError, TypeError, ValueError):
        return None  # not from our script: nothing to do, and nobody to tell


def _command_of(report: Report, session: Session) -> Request | None:
    content = report.content
    match content["kind"]:
        case "press":
            held = bool(content.get("shift")), bool(content.get("ctrl"))
            return c.Press(*_point(content), _zoom(content), *held)
        case "drag":
            return c.DragTo(*_point(content))
        case "release":
            return c.Release()
        case "cancel":
            return c.CancelDrag()
        case "double":
            return c.DoublePress(*_point(content), _zoom(content))
        case "pick":
            pair = int(content["first"]), int(content["second"])
            return c.PickInLandscape(*pair, _finite(content["u"]), _finite(content["v"]))
        case "enlarge":
            return c.ChangeLandscape(large=(int(content["first"]), int(content["second"])))
        case "model":
            wish = {"show": c.ShowCandidate, "drop": c.DropCandidate}[content["wish"]]
            return wish(int(content["index"]))
        case "key":
            meant = command_for(content, session.searching, session.look.hidden, session.look.rings)
            if meant == "save":
                return SavePose()
            if meant in REVIEW.values():
                return Review(meant)
            return ShowHelp(report.client) if meant == "help" else meant
        case "unfit":
            why = why_unfit(str(content["name"]), int(content["size"]))
            return Unfit(report.client, why)
    return None


def _point(content: dict[str, Any]) -> tuple[float, float]:
    return _finite(content["x"]), _finite(content["y"])


def _zoom(content: dict[str, Any]) -> float:
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
