"""Requests that mouse and keys stand for, from the reports of the page's script."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from inspect import signature
from operator import or_
from typing import Annotated, Literal, get_type_hints

import msgspec
import numpy as np

from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state import marking as m
from poseviewer.app.state import objects as o
from poseviewer.app.state.actions import ACTIONS, LOOKS
from poseviewer.app.state.edits import Edit, Px
from poseviewer.app.workers.tasks import Request, ShowHelp, Task, grow
from poseviewer.files.state.uploads import why_not_sent, why_unfit

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
    code: action.asked for action in ACTIONS.values() for code in action.codes
}
REVIEW: Mapping[str, Callable[[Reviewer], Task]] = {
    "KeyN": lambda review: review.step(1),
    "KeyP": lambda review: review.step(-1),
    "KeyA": lambda review: review.decide("accepted"),
    "KeyX": lambda review: review.decide("rejected"),
}
"""Keys of a review."""
FORWARDED = [*NUDGES, *KEYS, "KeyF", *REVIEW, "?"]
"""``event.code`` (or ``event.key``) of the keys that the page hands on, or heeds itself."""
LEFT_TO_BROWSER = ["KeyF", "KeyR", "KeyB", "KeyH", *(f"Digit{key}" for key in LOOKS), *REVIEW]
"""Not taken where ctrl is held: find, reload, and so on."""
DRAG = c.drag_to(0.0, 0.0).change


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours and size of text that a browser prefers."""

    light: bool = False
    text: Annotated[float, msgspec.Meta(ge=0.5, le=3.0)] = 1.0
    """Size of text, in times of the usual one."""


Answer = Request | Theme | str | None
"""Meaning of a report: a request, or a sentence for the page that it comes from."""


def _object(number: int, what: Literal["hidden", "locked"], on: bool) -> Edit:
    return o.alter_object(number, **{what: on})


def _key(
    client: int,
    review: Reviewer | None,
    code: str,
    key: str = "",
    shift: bool = False,
    ctrl: bool = False,
    repeat: bool = False,
) -> Request | None:
    if key == "?":
        return ShowHelp(client)
    if code in NUDGES:
        kind, x, y = NUDGES[code]
        factor = FINE if shift else COARSE if ctrl else 1.0
        return c.nudge(kind, x * factor, y * factor)
    if repeat:
        return None
    if code in REVIEW:
        return None if review is None else REVIEW[code](review)
    return (shift and KEYS.get(f"shift {code}")) or KEYS.get(code)


def _stroke(shape: h.Shape, points: list[Px], radius: Px, erase: bool) -> Request | None:
    if len(points) % 2 or len(points) < (6 if shape == "polygon" else 2):
        return None
    stroke = h.Stroke(shape, np.reshape(points, (-1, 2)), abs(radius), erase)
    return grow(stroke) if shape == "scribble" else h.paint(stroke)


def _row(review: Reviewer | None, index: int) -> Task | None:
    return None if review is None else review.open_row(index)


MEANINGS: Mapping[str, Callable[..., Answer]] = {
    "press": c.press,
    "drag": c.drag_to,
    "release": c.release,
    "cancel": c.cancel_drag,
    "double": c.double_press,
    "stroke": _stroke,
    "key": _key,
    "pick": c.pick_in_landscape,
    "enlarge": c.enlarge_map,
    "pick object": o.pick_object,
    "remove object": o.remove_object,
    "alter object": _object,
    "part": h.bring_back,
    "mark model": m.mark_model,
    "start": c.take_start,
    "photo": o.show_view,
    "compare photo": o.compare_view,
    "row": _row,
    "theme": Theme,
    "unfit": why_unfit,
    "not sent": why_not_sent,
}
"""Meaning of a report of each kind, made of its other fields by their names."""


OURS = ("session", "client", "review")
"""Arguments that no report gives."""


def _form(kind: str, meaning: Callable[..., Answer]) -> type[msgspec.Struct]:
    """A struct of the arguments that a report of a kind gives."""
    hints = get_type_hints(meaning, include_extras=True)
    fields = [
        (name, hints[name]) if given.default is given.empty else (name, hints[name], given.default)
        for name, given in signature(meaning).parameters.items()
        if name not in OURS
    ]
    return msgspec.defstruct(meaning.__name__, fields, tag_field="kind", tag=kind)


FORMS = {_form(kind, meaning): meaning for kind, meaning in MEANINGS.items()}
DECODER = msgspec.json.Decoder(reduce(or_, FORMS))


def meaning_of(report: object, client: int = 0, review: Reviewer | None = None) -> Answer:
    """The meaning of a report (JSON) of a page; None for one that makes no sense."""
    try:
        form = DECODER.decode(str.encode(report))  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, RecursionError, msgspec.MsgspecError):
        return None  # not from our script: nothing to do, and nobody to tell
    meaning = FORMS[type(form)]
    wanted, ours = signature(meaning).parameters, {"client": client, "review": review}
    given = msgspec.structs.asdict(form)
    return meaning(**given, **{name: ours[name] for name in ours if name in wanted})


def newest_drags(requests: list[Request]) -> list[Request]:
    """The requests without those drags that another one follows at once."""
    following = [*requests[1:], None]
    return [a for a, b in zip(requests, following, strict=False) if not _are_drags(a, b)]


def _are_drags(*requests: Request | None) -> bool:
    return all(isinstance(request, Edit) and request.change is DRAG for request in requests)
