"""Tools in the step "Fit" that hide parts of the photo and leave out parts of the model."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from poseviewer.app.page.controls import Controls, kept, on_press
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state.session import Session
from poseviewer.geometry.mesh import Mesh

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


def add_hiding(controls: Controls) -> None:
    """The tools that hide, and what is hidden."""

    def is_hiding(session: Session) -> bool:
        return session.tool in h.HIDING

    def hidden(session: Session) -> tuple[Any, ...]:
        document = session.document
        ended = None if session.searching else session.search
        return document.own.mask, document.object.result, document.at, ended

    controls.action("hide", is_hiding, icon="brush")
    tools = {tool.capitalize(): c.set_tool(tool) for tool in h.HIDING}
    controls.choices("Tool", tools, lambda s: s.tool.capitalize(), visible=is_hiding)
    erase = controls.gui.add_checkbox("Erase (alt)", False)
    controls.bind(erase, "erasing", visible=lambda s: s.tool in h.SHAPES)
    controls.text(kept(hidden, hidden_text))
    has_found = kept(hidden, lambda s: h.found_hidden(s) is not None)
    controls.action("hide found", visible=has_found)
    controls.action("unhide", visible=lambda s: is_hiding(s) and s.document.own.mask is not None)
    controls.html(lambda s: parts_left_out(s.document.mesh))


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
        f"{on_press('part', index=index)}>Bring back</button></li>"
        for index, name in enumerate(mesh.left_out)
    )
    return f'<div class="pv-parts">Left out of the model:<ul>{rows}</ul></div>' if rows else ""
