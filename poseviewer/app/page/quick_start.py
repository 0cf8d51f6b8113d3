"""The folder "Quick start": point pairs, wheels, proposals; and what is to be clicked next."""

from __future__ import annotations

from html import escape

import viser

from poseviewer.app.page.fields import Post, button, choices, set_property
from poseviewer.app.page.proposals_panel import BOX_HINT, ProposalsPanel
from poseviewer.app.state import commands as c
from poseviewer.app.state.document import WHEELS
from poseviewer.app.state.marking import MARKING, pair_errors
from poseviewer.app.state.requests import FindWheels, Request, UseLastPose
from poseviewer.app.state.session import Session
from poseviewer.starts.point_pairs import fewest_pairs
from poseviewer.vehicle.ellipses import FEWEST_RIM_POINTS

REGION_HINT = "drag a rectangle on the photo &nbsp;·&nbsp; Esc: leave it"
FIND, DRAW = "Find wheels in the region", "Find wheels: draw a region"
_OTHERWISE = " &nbsp;·&nbsp; drag a mark, double-click removes it &nbsp;·&nbsp; Esc: end"


class QuickStartPanel:
    """A pose from marks on the photo."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._shown: object = None
        with gui.add_folder("Quick start", expand_by_default=False):
            choices(
                gui,
                "Mark",
                post,
                {"Point pairs": c.SetTool("pairs"), "Wheels": c.SetTool("wheels")},
            )
            self._has_region = False
            self._find = button(gui, DRAW, post, lambda _: self._asked(), color="gray")
            self._again = button(
                gui, "Draw another region", post, lambda _: c.SetTool("region"), color="gray"
            )
            self._proposals = ProposalsPanel(gui, post)
            last = UseLastPose()
            button(gui, "From the last saved pose", post, lambda _: last, color="gray")
            self._text = gui.add_markdown("")
            self._buttons = [
                button(gui, "Remove last mark", post, lambda _: c.RemoveMark(), color="gray"),
                button(gui, "Clear marks", post, lambda _: c.ClearMarks(), color="gray"),
                button(gui, "Done (Esc)", post, lambda _: c.SetTool("pose"), color="gray"),
            ]

    def _asked(self) -> Request:
        """Wheels are looked for in the region; where there is none yet, it is drawn first."""
        return FindWheels() if self._has_region else c.SetTool("region")

    def show(self, session: Session) -> None:
        """Say what is marked, and how well the pose shows it."""
        key = (session.document, session.tool, session.proposals)
        if self._shown == key:
            return
        self._shown = key
        self._has_region = session.document.settings.region is not None
        set_property(self._find, "label", FIND if self._has_region else DRAW)
        set_property(self._again, "visible", self._has_region)
        self._proposals.show(session)
        set_property(self._text, "content", _text(session))
        for handle in self._buttons:
            set_property(handle, "visible", session.tool in MARKING)


def hint_of(session: Session) -> str:
    """The line over the photo; "" for the usual one."""
    if session.tool in ("region", "box"):
        return REGION_HINT if session.tool == "region" else BOX_HINT
    return f"<b>{_next(session)}</b>{_OTHERWISE}" if session.tool in MARKING else ""


def _next(session: Session) -> str:
    """What the next click is for."""
    marks = session.document.marks
    if session.tool == "wheels":
        wheel, point = divmod(len(marks.rims), FEWEST_RIM_POINTS)
        if wheel == WHEELS:
            return "space: search from here"
        name = ("rear", "front")[wheel]
        return f"click the {name} wheel's rim: point {point + 1} of {FEWEST_RIM_POINTS}"
    number = len(marks.pairs)
    if marks.waits_for_pixel:
        return f"pair {number}: click the same point on the photo"
    return f"pair {number + 1}: click a point of the model (2 shows it solid)"


def _text(session: Session) -> str:
    document = session.document
    marks = document.marks
    lines = []
    if marks.pairs and session.tool != "wheels":
        errors = pair_errors(document)
        rows = "".join(f"<br>pair {i}: {error:.1f} px" for i, error in enumerate(errors, 1))
        missing = fewest_pairs(document.pose.camera) - len(errors)
        lines.append(f"{missing} more to a pose" if missing > 0 else f"**off by**{rows}")
    elif session.tool == "pairs":
        lines.append(f"{fewest_pairs(document.pose.camera)} pairs give a pose")
    if session.tool == "wheels":
        lines.append(f"{len(marks.rims)} of {WHEELS * FEWEST_RIM_POINTS} points on the rims")
    if marks.note and session.tool in MARKING:
        lines.append(escape(marks.note))
    return "  \n".join(lines)
