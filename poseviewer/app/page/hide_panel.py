"""Tools in the step "Fit" that hide parts of the photo and leave out parts of the model."""

from __future__ import annotations

from html import escape

import numpy as np

from poseviewer.app.page.controls import Controls, on_press, set_properties, show_at_hand
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state.session import Session
from poseviewer.geometry.mesh import Mesh

HIDE = "Hide what is in front (H)"
TOOLS = {
    "Brush": c.set_tool("brush"),
    "Polygon": c.set_tool("polygon"),
    "Scribble": c.set_tool("scribble"),
    "Part": c.set_tool("part"),
}
ENDS = " &nbsp;·&nbsp; Esc: done"
DRAWING_ENDS = f" &nbsp;·&nbsp; <b>alt</b> erase{ENDS}"
HINTS = {
    "brush": "<b>Brush:</b> paint over what is in front &nbsp;·&nbsp; <b>wheel</b> its size, "
    f"ctrl + wheel zoom{DRAWING_ENDS}",
    "polygon": "<b>Polygon:</b> click corners about what is in front, or drag around it "
    f"&nbsp;·&nbsp; <b>Enter</b> or double-click closes it{DRAWING_ENDS}",
    "scribble": "<b>Scribble:</b> draw a line along what is in front: all of it is hidden, to its "
    f"edge{DRAWING_ENDS}",
    "part": "<b>Part:</b> press a part of the model that is to be left out &nbsp;·&nbsp; "
    f"2 shows it solid{ENDS}",
}
"""The line over the photo, by tool."""


class HidePanel:
    """The tools that hide, and what is hidden."""

    def __init__(self, controls: Controls) -> None:
        self._shown: object = None
        self._go = controls.button(HIDE, c.toggle_hiding(), icon="brush")
        self._tools = controls.choices("Tool", TOOLS)
        self._erase = controls.field(controls.gui.add_checkbox("Erase (alt)", False), h.set_erasing)
        self._text = controls.gui.add_markdown("", visible=False)
        self._found = controls.button("Hide what the search found", h.hide_found(), visible=False)
        self._clear = controls.button("Clear hidden areas", h.unhide())
        self._parts = controls.gui.add_html("", visible=False)

    def show(self, session: Session) -> None:
        """Bring the controls to the session."""
        own, tool = session.document, session.tool
        ended = None if session.searching else session.search
        end = session.document.object.result
        key = (own.own.mask, own.mesh, tool, session.erasing, ended, end)
        if self._shown == key:
            return
        self._shown, active = key, tool in h.HIDING
        set_properties(self._go, label="Done hiding (H)" if active else HIDE)
        set_properties(self._tools, visible=active)
        show_at_hand(self._tools, tool.capitalize() if active else None)
        self._erase.show(session.erasing, visible=tool in h.SHAPES)
        text = hidden_text(session)
        set_properties(self._text, content=text, visible=bool(text))
        set_properties(self._found, visible=h.found_hidden(session) is not None)
        set_properties(self._clear, visible=active and own.own.mask is not None)
        parts = parts_left_out(own.mesh)
        set_properties(self._parts, content=parts, visible=bool(parts))


def hidden_text(session: Session) -> str:
    """Say how much of the photo is hidden (markdown); "" where nothing is."""
    mask, found = session.document.own.mask, h.found_hidden(session)
    lines = []
    if mask is not None:
        lines.append(f"**{1.0 - float(np.mean(mask.weights)):.1%}** of the photo is hidden")
    if found is not None:
        lines.append(
            f"**{np.mean(found):.1%}** were taken for something in front by the search (violet)"
        )
    return "  \n".join(lines)


def parts_left_out(mesh: Mesh) -> str:
    """The parts that are left out, each with a button that brings it back (HTML)."""
    rows = "".join(
        f'<li>{escape(name or "(unnamed)")}<button type="button" '
        f"{on_press(kind='part', index=index)}>Bring back</button></li>"
        for index, name in enumerate(mesh.left_out)
    )
    return f'<div class="pv-parts">Left out of the model:<ul>{rows}</ul></div>' if rows else ""
