"""Table of actions: each one's edit, keys, button with its tooltip, step, and row of the help."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state import marking as m
from poseviewer.app.state.edits import Edit, SavePose
from poseviewer.app.state.objects import add_object

LOOKS = {"1": "outline", "2": "solid", "3": "relit", "4": "normals", "5": "residual", "0": "none"}
"""Drawing of the model by each key."""
CODES = {"space": "Space", "Esc": "Escape"}
"""``event.code`` of the keys that are neither letters nor digits."""


BOX = "Draw a rectangle about the object; starting poses are proposed there"
PROPOSE = "Look for starting poses, in the box, the region or the whole photo"
HIDE = "Hide what is in front: wheel brush size, alt erase"
HIDE_FOUND = "Hide what the search took for something in front, to be corrected"
COMPARE = "Search from the start by one loss, then by the other, and set the ends side by side"
REGION, DRAWING = "Compare what lies in a rectangle alone", "Drag on the photo ..."
END = "Let go, leave a tool, stop what is looked for or read"


@dataclass(frozen=True, slots=True)
class Action:
    """Something that a key or a button asks for."""

    asked: Edit | SavePose
    step: Literal["Open", "Place", "Fit", "Judge", "Save"]
    """Tab of its button, or of the work in which its keys are used."""
    name: str
    """Text of the button or checkbox; "" for none."""
    tooltip: str
    """Sentence of the button's tooltip and of the help dialog."""
    keys: str = ""
    """Names of its keys in the help dialog, with commas between."""
    end: str = ""
    """Text of the button while it would end what it began."""

    @property
    def label(self) -> str:
        """Label of the button, with its first key."""
        return self._with_key(self.name)

    @property
    def end_label(self) -> str:
        """Label of the button while it would end what it began."""
        return self._with_key(self.end)

    def _with_key(self, text: str) -> str:
        return f"{text} ({self.keys.split(', ')[0]})" if self.keys else text

    @property
    def codes(self) -> tuple[str, ...]:
        """``event.code`` of the keys, some with "shift " before; ctrl makes no difference."""
        return tuple(map(_code, filter(None, self.keys.split(", "))))


def _code(key: str) -> str:
    *held, last = key.replace("ctrl ", "").split()
    usual = f"{'Digit' if last.isdigit() else 'Key'}{last}"
    return " ".join((*held, CODES.get(last, usual)))


ACTIONS: Mapping[str, Action] = {
    "add same": Action(
        add_object(), "Open", "Add the same model again", "Add an object of the active one's model"
    ),
    "undo": Action(c.undo(), "Place", "Undo", "Go one step back", "Z, ctrl Z"),
    "redo": Action(c.redo(), "Place", "Redo", "Go one step on again", "Y, ctrl shift Z"),
    "reset": Action(c.reset_to_start(), "Place", "Reset to start", "Go back to the start", "R"),
    "start": Action(c.make_start(), "Place", "Make this the start", "Start from the pose at hand"),
    "box": Action(c.toggle_box(), "Place", "Fit to box", BOX, end=DRAWING),
    "propose": Action(c.propose_starts(), "Place", "Propose starts", PROPOSE, end="Stop looking"),
    "previous": Action(c.step_proposals(-1), "Place", "Previous", "Start from the proposal before"),
    "next": Action(c.step_proposals(), "Place", "Next", "Start from the next likely proposal"),
    "pairs": Action(c.set_tool("pairs"), "Place", "Point pairs", "Click points, model then photo"),
    "wheels": Action(c.set_tool("wheels"), "Place", "Wheels", "Click points of a car's two rims"),
    "unmark": Action(m.remove_mark(), "Place", "Remove last mark", "Take the last mark away"),
    "clear": Action(m.clear_marks(), "Place", "Clear marks", "Take all marks away; the pose stays"),
    "done": Action(c.set_tool("pose"), "Place", "Done (Esc)", "Drags move the model again"),
    "search": Action(c.toggle_search(), "Fit", "Search", "Start, stop the search", "space", "Stop"),
    "search all": Action(c.search_all(), "Fit", "Search all", "Search for all objects in turn"),
    "keep": Action(c.accept_search(), "Fit", "Keep it", "Keep the pose; put the search away"),
    "revert": Action(c.revert_search(), "Fit", "Go back", "Go back to the pose before (Z)"),
    "hide": Action(c.toggle_hiding(), "Fit", "Hide what is in front", HIDE, "H", "Done hiding"),
    "hide found": Action(h.hide_found(), "Fit", "Hide what the search found", HIDE_FOUND),
    "unhide": Action(h.unhide(), "Fit", "Clear hidden areas", "Let all pixels count again"),
    "compare": Action(c.compare_losses(), "Fit", "Compare both losses", COMPARE),
    "region": Action(c.set_tool("region"), "Fit", "Draw a region", REGION, end=DRAWING),
    "clear region": Action(c.clear_region(), "Fit", "Clear the region", "Compare the whole photo"),
    **{
        look: Action(c.change(look=look, photo_alone=False), "Judge", "", "", key)
        for key, look in LOOKS.items()
    },
    "blink": Action(c.toggle_model(), "Judge", "Photo alone", "Blink: photo, model", "B"),
    "save": Action(SavePose(), "Save", "Save pose", "Save the pose", "S, ctrl S"),
    "end": Action(c.cancel_drag(), "Place", "", END, "Esc"),
}
"""All that buttons and keys ask for; nudges and keys of a review have tables of their own."""
GESTURES = {
    "drag": "Move the model; a pin, if you hit one",
    "shift + drag": "Turn it as a ball about its centre",
    "ctrl + drag": "Roll it, and make it larger or smaller",
    "double-click": "Pin the surface there, or take the pin away",
    "wheel, right drag, F": "Zoom at the pointer, pan, whole photo",
    "arrows": "Move by 1 px",
    "J L, I K, U O": "Turn, tilt, roll by 1 degree",
    "page up / down": "1 % larger, smaller",
    "shift / ctrl": "With one of these: a tenth, ten times as much",
    "1 2 3 4 5, 0": "Outline, solid, relit, normals, residual, nothing",
    "A, X, N, P": "In a review: accept, reject, next, previous",
}
"""Gestures of the mouse, and keys of other tables, in the help dialog."""


def help_table() -> str:
    """All that mouse and keys do, and the step that it belongs to (markdown)."""
    keyed = [(own.keys, own.tooltip, own.step) for own in ACTIONS.values() if own.keys]
    rows = [*((keys, does, "") for keys, does in GESTURES.items()), *filter(lambda r: r[1], keyed)]
    head = "| | | |\n|---|---|---|\n"
    return head + "".join(
        f"| **{keys.replace(', ', '**, **')}** | {does} | {step} |\n" for keys, does, step in rows
    )
