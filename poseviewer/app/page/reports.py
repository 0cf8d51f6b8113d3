"""Requests of mouse and keys, from the reports of the page's script."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from inspect import signature
from operator import or_
from typing import Annotated, Literal, TypeVar, get_type_hints

import msgspec
import numpy as np

from poseviewer.app.state import objects as o
from poseviewer.app.state.edits import (
    AskStill,
    Edit,
    Px,
    ReviewRow,
    SavePose,
    ShowHelp,
    cancel_drag,
    drag_to,
    enlarge_map,
    release,
)
from poseviewer.app.state.frame_edits import edit_frames, go_to_frame, press_arrow, step_frame
from poseviewer.app.state.hiding import Shape, Stroke, bring_back, paint
from poseviewer.app.state.keys_and_buttons import KEYS
from poseviewer.app.state.marking import mark_model, turn_model
from poseviewer.app.state.pointer_edits import double_press, press
from poseviewer.app.state.pose_edits import nudge, pick_in_landscape
from poseviewer.app.state.search_edits import find_focal_length, take_start
from poseviewer.app.workers.tasks import Request, grow
from poseviewer.errors import printable
from poseviewer.opening.uploads import why_not_sent, why_unfit

FINE = 0.1
"""Factor of nudges with shift."""
COARSE = 10.0
"""Factor of nudges with ctrl."""
MAX_SAID = 40
"""Letters of a text that a sentence says again."""


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours and size of text that a browser prefers, and its room."""

    light: bool = False
    text: Annotated[float, msgspec.Meta(ge=0.5, le=3.0)] = 1.0
    """Size of text, in times of the usual one."""
    width: float = 2000.0
    """Width of the window, CSS px."""


@dataclass(frozen=True, slots=True)
class SeenMaps:
    """Whether a page shows the maps."""

    seen: bool


T = TypeVar("T")
Meaning = Request | Theme | SeenMaps | str | None
"""Meaning of a report: a request, or a sentence for the page that it comes from."""


def _object(object_id: int, what: Literal["hidden", "locked"], on: bool) -> Edit:
    return o.alter_object(object_id, **{what: on})


def _key(
    code: str,
    key: str = "",
    shift: bool = False,
    ctrl: bool = False,
    alt: bool = False,
    repeat: bool = False,
) -> Request | None:
    # A sign that was typed goes first: other keyboards have it at another place, or with shift.
    action = KEYS.get(key) or (shift and KEYS.get(f"shift {code}")) or KEYS.get(code)
    factor = FINE if shift else COARSE if ctrl else 1.0
    match action and action.request:
        case Edit(arguments=(x, y)) as edit if edit.calls(press_arrow):
            to_move = nudge("move", factor * x, factor * y)
            return to_move if alt else press_arrow(x, y, factor)
        case Edit(arguments=(kind, *steps)) as edit if edit.calls(nudge):
            return nudge(kind, *(factor * step for step in steps))
        case Edit() as edit if edit.calls(step_frame):
            return edit
        case Edit() | SavePose() | ReviewRow() | ShowHelp() as request if not repeat:
            return request
    return None


def _stroke(shape: Shape, points: list[Px], radius: Px, erase: bool) -> Request | None:
    if len(points) % 2 or len(points) < (6 if shape == "polygon" else 2):
        return None
    stroke = Stroke(shape, np.reshape(points, (-1, 2)), abs(radius), erase)
    return grow(stroke) if shape == "scribble" else paint(stroke)


def _no_number(name: str, text: str) -> str:
    said, written = printable(name, MAX_SAID), printable(text, MAX_SAID)
    return f"{said}: {written!r} is no number as it is written; wanted one such as 1390.5."


MEANINGS: Mapping[str, Callable[..., Meaning]] = {
    "press": press,
    "drag": drag_to,
    "release": release,
    "cancel": cancel_drag,
    "double": double_press,
    "stroke": _stroke,
    "key": _key,
    "pick": pick_in_landscape,
    "enlarge": enlarge_map,
    "pick object": o.pick_object,
    "remove object": o.remove_object,
    "alter object": _object,
    "part": bring_back,
    "find focal length": find_focal_length,
    "mark model": mark_model,
    "turn model": turn_model,
    "start": take_start,
    "photo": o.show_view,
    "compare photo": o.compare_view,
    "frame": go_to_frame,
    "frames": edit_frames,
    "still": AskStill,
    "row": ReviewRow,
    "theme": Theme,
    "maps": SeenMaps,
    "unfit": why_unfit,
    "not sent": why_not_sent,
    "no number": _no_number,
}
"""Meaning of a report of each kind, made of its other fields by their names."""


def _form(kind: str, meaning: Callable[..., Meaning]) -> type[msgspec.Struct]:
    """A struct of the arguments that a report of a kind gives."""
    hints = get_type_hints(meaning, include_extras=True)
    fields = [
        (name, hints[name]) if given.default is given.empty else (name, hints[name], given.default)
        for name, given in signature(meaning).parameters.items()
        if name != "session"
    ]
    return msgspec.defstruct(meaning.__name__, fields, tag_field="kind", tag=kind)


FORMS = {_form(kind, meaning): meaning for kind, meaning in MEANINGS.items()}
DECODER = msgspec.json.Decoder(reduce(or_, FORMS))


def meaning_of(report: object, client: int = 0) -> Meaning:
    """The meaning of a report (JSON) of a page; None for one that makes no sense."""
    try:
        form = DECODER.decode(str.encode(report))  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, RecursionError, msgspec.MsgspecError):
        return None  # not from our script: nothing to do, and nobody to tell
    meaning = FORMS[type(form)](**msgspec.structs.asdict(form))
    return replace(meaning, client=client) if isinstance(meaning, ShowHelp | AskStill) else meaning


def newest_drags(requests: list[T]) -> list[T]:
    """The requests without those drags that another one follows at once."""
    is_drag = [isinstance(request, Edit) and request.calls(drag_to) for request in requests]
    pairs = zip(requests, is_drag, [*is_drag[1:], False], strict=False)
    return [request for request, now, next_one in pairs if not (now and next_one)]
