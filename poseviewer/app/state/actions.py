"""Table of actions: edit, keys, button and row of the help dialog of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from poseviewer.app.state import commands as c
from poseviewer.app.state.edits import Edit, SavePose

LOOKS = {
    "Digit1": "outline",
    "Digit2": "solid",
    "Digit3": "relit",
    "Digit4": "normals",
    "Digit5": "residual",
    "Digit0": "none",
}
"""Drawing of the model by each key."""


@dataclass(frozen=True, slots=True)
class Action:
    """Something that a key or a button asks for, or that the mouse does."""

    how: str = ""
    """Keys or mouse in the help dialog (markdown); "" for no row."""
    what: str = ""
    """Sentence of the help dialog on what they do."""
    asked: Edit | SavePose | None = None
    keys: tuple[str, ...] = ()
    """``event.code`` of the keys, some with "shift " before."""
    label: str = ""
    """Label of the button or checkbox; "" for none."""
    end: str = ""
    """Label of the button while it would end what it began."""


ACTIONS: Mapping[str, Action] = {
    "move": Action("**drag**", "move the model; a pin, if you hit one"),
    "turn": Action("**shift + drag**", "turn it as a ball about its centre"),
    "roll": Action("**ctrl + drag**", "roll it, and make it larger or smaller"),
    "pin": Action("**double-click**", "pin the surface there, or take the pin away"),
    "zoom": Action("**wheel**, **right drag**, **F**", "zoom at the pointer, pan, whole photo"),
    "nudge": Action("**arrows**", "move by 1 px"),
    "nudge turn": Action("**J L**, **I K**, **U O**", "turn, tilt, roll by 1 degree"),
    "nudge scale": Action("**page up / down**", "1 % larger, smaller"),
    "factor": Action("*with* **shift** / **ctrl**", "a tenth / ten times as much"),
    "search": Action(
        "**space**",
        "start and stop the search",
        c.toggle_search(),
        ("Space",),
        "Search (space)",
        "Stop (space)",
    ),
    "looks": Action("**1 2 3 4 5**, **0**", "outline, solid, relit, normals, residual, nothing"),
    **{
        name: Action(asked=c.change(look=name, photo_alone=False), keys=(code,))
        for code, name in LOOKS.items()
    },
    "blink": Action("**B**", "blink: photo, model", c.toggle_model(), ("KeyB",), "Photo alone (B)"),
    "hide": Action(
        "**H**",
        "hide what is in front: wheel brush size, **alt** erase",
        c.toggle_hiding(),
        ("KeyH",),
        "Hide what is in front (H)",
        "Done hiding (H)",
    ),
    "reset": Action(
        "**R**", "back to the start", c.reset_to_start(), ("KeyR",), "Reset to start (R)"
    ),
    "undo": Action("**Z**, **ctrl Z**", "undo", c.undo(), ("KeyZ",), "Undo (Z)"),
    "redo": Action("**Y**, **ctrl shift Z**", "redo", c.redo(), ("KeyY", "shift KeyZ"), "Redo (Y)"),
    "save": Action("**S**, **ctrl S**", "save the pose", SavePose(), ("KeyS",), "Save pose (S)"),
    "end": Action(
        "**Esc**",
        "let go, leave a tool, stop what is looked for or read",
        c.cancel_drag(),
        ("Escape",),
    ),
    "review": Action("**A**, **X**, **N**, **P**", "in a review: accept, reject, next, previous"),
}
"""All that mouse and keys do, by names; nudges and keys of a review have tables of their own."""


def buttons(*names: str) -> dict[str, Edit | SavePose]:
    """Edits of actions by the labels of their buttons."""
    actions = [ACTIONS[name] for name in names]
    return {action.label: action.asked for action in actions if action.asked is not None}
