"""Table of keys and buttons: the edit of each, its tooltip, its step, and its row of the help."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from poseviewer.app.state.edits import (
    Edit,
    ReviewRow,
    SavePose,
    ShowHelp,
    cancel_drag,
    redo,
    show_style,
    toggle_model,
    undo,
)
from poseviewer.app.state.frame_edits import MANY_FRAMES, press_arrow, step_frame
from poseviewer.app.state.hiding import hide_found, hide_in_all_frames, toggle_hiding, unhide
from poseviewer.app.state.marking import clear_marks, remark_wheels, remove_mark
from poseviewer.app.state.objects import add_object, unpaint
from poseviewer.app.state.pointer_edits import set_tool, toggle_measuring
from poseviewer.app.state.pose_edits import NudgeKind, make_start, nudge, reset_to_start
from poseviewer.app.state.search_edits import (
    accept_search,
    clear_region,
    compare_losses,
    propose_starts,
    revert_search,
    search_all,
    step_proposals,
    toggle_box,
    toggle_search,
)
from poseviewer.render.overlay import LOOKS

STYLES = {look.key: name for name, look in LOOKS.items() if look.key}
"""Look of the model by each key."""
NUDGES: Mapping[tuple[str, str], tuple[NudgeKind, float, float]] = {
    ("J", "L"): ("turn", 1.0, 0.0),
    ("I", "K"): ("turn", 0.0, 1.0),
    ("U", "O"): ("roll", 1.0, 0.0),
    ("page down", "page up"): ("scale", 1.0, 0.0),
}
"""Small step of the pose by the keys for it, backwards and forwards."""
ARROWS = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "up": (0.0, -1.0), "down": (0.0, 1.0)}
"""Direction of each arrow, right and down."""
FRAME_KEYS = {",": (-1, False), ".": (1, False), "[": (-1, True), "]": (1, True)}
"""Frames, or keys of a sequence, that a key of the keyboard steps on by."""
CODES = {
    "space": "Space",
    "Esc": "Escape",
    "?": "?",
    "page up": "PageUp",
    "page down": "PageDown",
    ",": ", Comma",
    ".": ". Period",
    "[": "[ BracketLeft",
    "]": "] BracketRight",
}
"""``event.key`` of signs, and ``event.code`` of keys but letters, digits and arrows."""
LEFT_WITH_CTRL = tuple("FRBHMAXNP123450")
"""Keys that stay the browser's while ctrl is held: find, reload, and so on."""
BOX = "Draw a rectangle about the object; starting poses are proposed there"
PROPOSE = "Look for starting poses, in the box, the region or the whole photo"
SEARCH = "Start, stop the search; in a sequence, mend what it changes"
HIDE = "Hide what is in front: wheel brush size, alt erase"
HIDE_FOUND = "Hide what the search took for something in front, to be corrected"
HIDE_ALL = "What is painted in this frame hides these pixels in all of them"
COMPARE = "Search from the start by each loss in turn, and set the ends side by side"
MEASURE = "Measure points of models, and the distance of two"
REGION = "Compare what lies in a rectangle alone"
UNPAINT = "Compare and draw the model as its file has it"
DRAWING = "Drag on the photo ..."
REMARK = "Press the middle of the model's wheels again"
END = "Let go, leave a tool, stop what is looked for, read or propagated"


@dataclass(frozen=True, slots=True)
class Action:
    """Something that a key or a button requests."""

    request: Edit | SavePose | ShowHelp | ReviewRow | Literal["showAll"]
    """``showAll`` is a function of the page's script."""
    step: Literal["Open", "Place", "Fit", "Judge", "Save", "Review", ""]
    """Tab of the button and of the keys; "": any."""
    name: str
    """Text of the button or checkbox; "": there is none."""
    tooltip: str
    """Tooltip, also in the help dialog; "": ``GESTURES`` has it."""
    keys: str = ""
    """Keys as named in the help dialog, with commas between."""
    end: str = ""
    """Text of the button while it ends what it began."""
    opens: Literal["", "forward", "always"] = ""
    """Whether the keys open the step: only from an earlier one, or always."""

    def label(self, ends: bool = False) -> str:
        """Label of the button, with its first key; ``ends`` chooses the text ``end``."""
        text = self.end if ends else self.name
        return f"{text} ({self.keys.split(', ')[0]})" if self.keys else text

    @property
    def codes(self) -> tuple[str, ...]:
        """``event.code`` or ``event.key`` of the keys, with "shift " before where it is held; ctrl
        is ignored.
        """
        return tuple(code for key in filter(None, self.keys.split(", ")) for code in _codes(key))


def _codes(key: str) -> list[str]:
    held, last = "shift " * ("shift " in key), key.removeprefix("ctrl ").removeprefix("shift ")
    kind = "Digit" if last.isdigit() else "Key" if len(last) == 1 else "Arrow"
    return [held + code for code in CODES.get(last, kind + last.capitalize()).split()]


ACTIONS: Mapping[str, Action] = {
    "add same": Action(
        add_object(), "Open", "Add the same model again", "Add an object of the active one's model"
    ),
    "undo": Action(undo(), "Place", "Undo", "Go one step back", "Z, ctrl Z"),
    "redo": Action(redo(), "Place", "Redo", "Go one step on again", "Y, ctrl shift Z"),
    "reset": Action(reset_to_start(), "Place", "Reset", "Go back to the start", "R"),
    "start": Action(make_start(), "Place", "Set here", "Make the pose at hand the start"),
    "box": Action(toggle_box(), "Place", "Fit to box", BOX),
    "propose": Action(propose_starts(), "Place", "Propose starts", PROPOSE, end="Stop looking"),
    "previous": Action(step_proposals(-1), "Place", "Previous", "Start from the proposal before"),
    "next": Action(step_proposals(), "Place", "Next", "Start from the next likely proposal"),
    "pairs": Action(set_tool("pairs"), "Place", "Point pairs", "Click points, model then photo"),
    "wheels": Action(set_tool("wheels"), "Place", "Wheels", "Click points of a car's two rims"),
    "unmark": Action(remove_mark(), "Place", "Remove last mark", "Take the last mark away"),
    "clear": Action(clear_marks(), "Place", "Clear marks", "Take all marks away; the pose stays"),
    "remark": Action(remark_wheels(), "Place", "Mark the model's wheels anew", REMARK),
    "done": Action(set_tool("pose"), "Place", "Done (Esc)", "Drags move the model again"),
    "search": Action(toggle_search(), "Fit", "Search", SEARCH, "space", "Stop", "forward"),
    "search all": Action(search_all(), "Fit", "Search all", "Search for all objects in turn"),
    "keep": Action(accept_search(), "Fit", "Keep it", "Keep the pose; put the search away"),
    "revert": Action(revert_search(), "Fit", "Go back", "Go back to the pose before (Z)"),
    "hide": Action(
        toggle_hiding(), "Fit", "Hide what is in front", HIDE, "H", "Done hiding", opens="always"
    ),
    "hide found": Action(hide_found(), "Fit", "Hide what the search found", HIDE_FOUND),
    "hide all": Action(hide_in_all_frames(), "Fit", "Hide in all frames", HIDE_ALL),
    "unhide": Action(unhide(), "Fit", "Clear hidden areas", "Let all pixels count again"),
    "compare": Action(compare_losses(), "Fit", "Compare the losses", COMPARE),
    "region": Action(
        set_tool("region"), "Fit", "Draw a region", REGION, end="Drag on the photo ..."
    ),
    "clear region": Action(clear_region(), "Fit", "Clear the region", "Compare the whole photo"),
    **{style: Action(show_style(style), "Judge", "", "", key) for key, style in STYLES.items()},
    "blink": Action(toggle_model(), "Judge", "Photo alone", "Blink: photo, model", "B"),
    "measure": Action(toggle_measuring(), "Judge", "Measure", MEASURE, "M", "Done measuring"),
    "unpaint": Action(unpaint(), "Judge", "Unpaint", UNPAINT),
    "save": Action(SavePose(), "Save", "Save pose", "Save the pose", "S, ctrl S"),
    "end": Action(cancel_drag(), "Place", "", END, "Esc"),
    "help": Action(ShowHelp(), "Open", "Keys and mouse", "", "?"),
    "whole photo": Action("showAll", "", "", "", "F"),
    "next row": Action(ReviewRow("next"), "Review", "Next", "", "N"),
    "previous row": Action(ReviewRow("previous"), "Review", "Previous", "", "P"),
    "accept": Action(ReviewRow("accepted"), "Review", "Accept", "", "A"),
    "reject": Action(ReviewRow("rejected"), "Review", "Reject", "", "X"),
    **{
        key: Action(nudge(kind, sign * x, sign * y), "", "", "", key)
        for keys, (kind, x, y) in NUDGES.items()
        for key, sign in zip(keys, (-1.0, 1.0), strict=True)
    },
    **{key: Action(press_arrow(*to), "", "", "", key) for key, to in ARROWS.items()},
    **{
        held + key: Action(step_frame(by * times, between), "", "", "", held + key)
        for key, (by, between) in FRAME_KEYS.items()
        for held, times in (("", 1), ("shift ", MANY_FRAMES))
    },
}
"""Every button and key by its name."""
KEYS = {code: action for action in ACTIONS.values() for code in action.codes}
"""Action of each of ``Action.codes``."""
GESTURES = {
    "drag": "Move the model; a pin, if you hit one",
    "shift + drag": "Turn it as a ball about its centre",
    "ctrl + drag": "Roll it, and make it larger or smaller",
    "double-click": "Pin the surface there, or take the pin away",
    "wheel, right drag, F": "Zoom at the pointer, pan, whole photo",
    "arrows": "Move by 1 px; in a sequence, where they step, with alt",
    "J L, I K, U O": "Turn, tilt, roll by 1 degree",
    "page up / down": "1 % larger, smaller",
    "shift / ctrl": "With one of these: a tenth, ten times as much",
    "1 2 3 4 5, 0": "Outline, solid, relit, normals, residual, nothing",
    "A, X, N, P": "In a review: accept, reject, next, previous",
    "left right, comma period": "In a sequence: the frame before, the next one; with shift ten",
    "up down, [ ]": "In a sequence: the key before, the next one; with shift ten",
    "comma period": "Of many photos: the one before, the next one; with shift ten",
}
"""Rows of the help dialog for gestures of the mouse, and for keys that share a row."""


def help_table() -> str:
    """Make the markdown table of gestures and keys, with the step of each."""
    rows = [(keys, does, "") for keys, does in GESTURES.items()]
    rows += [(a.keys, a.tooltip, a.step) for a in ACTIONS.values() if a.keys and a.tooltip]
    lines = (f"| **{k.replace(', ', '**, **')}** | {does} | {step} |\n" for k, does, step in rows)
    return "| keys, mouse | what it does | step |\n|---|---|---|\n" + "".join(lines)


def client_keys() -> dict[str, dict[str, object]]:
    """Make the table of keys for ``client.js``, where it is described."""
    return {
        code.split()[-1]: {
            "call": action.request if action.request == "showAll" else "",
            "step": action.step,
            "label": action.label(),
            "opens": action.opens,
            "leave": action.keys in LEFT_WITH_CTRL,
        }
        for code, action in KEYS.items()
    }
