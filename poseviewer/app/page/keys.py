"""The keys, what they do, and the panel that says so."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from poseviewer.app.state import commands as c

FINE, COARSE = 0.1, 10.0
"""Nudges with shift, and with ctrl, are so many times as large."""

NUDGES: Mapping[str, c.Nudge] = MappingProxyType(
    {
        "ArrowLeft": c.Nudge("move", -1.0, 0.0),
        "ArrowRight": c.Nudge("move", 1.0, 0.0),
        "ArrowUp": c.Nudge("move", 0.0, -1.0),
        "ArrowDown": c.Nudge("move", 0.0, 1.0),
        "KeyJ": c.Nudge("turn", -1.0, 0.0),
        "KeyL": c.Nudge("turn", 1.0, 0.0),
        "KeyI": c.Nudge("turn", 0.0, -1.0),
        "KeyK": c.Nudge("turn", 0.0, 1.0),
        "KeyU": c.Nudge("roll", -1.0),
        "KeyO": c.Nudge("roll", 1.0),
        "PageUp": c.Nudge("scale", 1.0),
        "PageDown": c.Nudge("scale", -1.0),
    }
)
LOOKS: Mapping[str, str] = MappingProxyType(
    {
        "Digit1": "outline",
        "Digit2": "solid",
        "Digit3": "relit",
        "Digit4": "normals",
        "Digit5": "residual",
        "Digit0": "none",
    }
)
REVIEW: Mapping[str, str] = MappingProxyType({"KeyN": "next", "KeyP": "previous", "KeyA": "accept"})
"""In a review."""
FORWARDED = [
    *NUDGES,
    *LOOKS,
    "Space",
    "KeyB",
    "KeyF",
    "KeyG",
    "KeyR",
    "KeyS",
    "KeyY",
    "KeyZ",
    *REVIEW,
    "Escape",
    "?",
]
"""``event.code`` (or ``event.key``) of the keys that the page hands on."""
LEFT_TO_BROWSER = ["KeyF", "KeyR", "KeyB", "KeyG", "Digit0", "Digit1", *REVIEW]
"""Not taken where ctrl is held: find, reload, and so on."""

HELP = """
| | |
|---|---|
| **drag** | move the model; a pin, a ring, if you hit one |
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
| **G** | rotation rings |
| **R** | back to the start pose |
| **Z**, **ctrl Z** / **Y**, **ctrl shift Z** | undo / redo |
| **S**, **ctrl S** | save the pose |
| **Esc** | let go, leave a tool |
| **A**, **N**, **P** | in a review: accept, next, previous |
"""


def command_for(report: Mapping[str, Any], searching: bool, hidden: bool, rings: bool) -> Any:
    """The command that a reported key stands for; None for none, or for ``Save``, ``Help`` and the
    steps of a review their names.
    """
    code, shift, ctrl = str(report.get("code")), bool(report.get("shift")), bool(report.get("ctrl"))
    if report.get("key") == "?":
        return "help"
    if code in NUDGES:
        nudge, factor = NUDGES[code], FINE if shift else COARSE if ctrl else 1.0
        return c.Nudge(nudge.kind, nudge.x * factor, nudge.y * factor)
    if report.get("repeat"):
        return None
    if code in LOOKS and not ctrl:
        return c.ChangeView(look=LOOKS[code], hidden=False)
    if code in REVIEW:
        return None if ctrl else REVIEW[code]
    if code == "Space":
        return c.StopSearch() if searching else c.StartSearch()
    if code == "KeyZ":
        return c.Redo() if shift else c.Undo()
    simple = {
        "KeyY": c.Redo(),
        "KeyB": c.ChangeView(hidden=not hidden),
        "KeyG": c.ChangeView(rings=not rings),
        "KeyR": c.ResetToStart(),
        "Escape": c.CancelDrag(),
        "KeyS": "save",
    }
    return simple.get(code)
