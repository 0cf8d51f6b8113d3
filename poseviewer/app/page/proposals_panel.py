"""The part of "Quick start" that needs no marks but a rectangle: proposed start poses."""

from __future__ import annotations

import viser

from poseviewer.app.page.fields import Post, button, set_property
from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session

BOX_HINT = "drag a rectangle about the object &nbsp;·&nbsp; Esc: leave it"


class ProposalsPanel:
    """The part of "Quick start" that needs no marks but a rectangle."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._box = button(gui, "Draw a box", post, lambda _: c.SetTool("box"), color="gray")
        self._propose = button(gui, "Propose starts", post, lambda _: c.ProposeStarts())
        self._text = gui.add_markdown("")
        self._steps = [
            button(gui, "Next proposal", post, lambda _: c.StepProposals(1), color="gray"),
            button(gui, "Take it", post, lambda _: c.TakeProposal(), icon="check"),
        ]

    def show(self, session: Session) -> None:
        """What is proposed, and which of it is shown."""
        asked = session.proposals
        running = asked is not None and asked.running
        drawing = session.tool == "box"
        set_property(self._box, "label", "Drag on the photo ..." if drawing else "Draw a box")
        set_property(self._propose, "label", "Looking ..." if running else "Propose starts")
        set_property(self._propose, "disabled", running)
        there = (
            asked is not None and bool(asked.poses) and asked.document.shows_same(session.document)
        )
        for handle in self._steps:
            set_property(handle, "visible", there)
        set_property(self._text, "content", proposals_text(session))


def proposals_text(session: Session) -> str:
    """How it stands, for the panel (markdown)."""
    asked = session.proposals
    if asked is not None and asked.running:
        return "Trying views from everywhere: some seconds, longer without a box."
    if asked is not None and asked.poses and asked.document.shows_same(session.document):
        return f"**proposal {asked.index + 1} of {len(asked.poses)}**, the likeliest first"
    if session.document.marks.box is None and session.document.settings.region is None:
        return "Draw a box about the object; without one, the whole photo is searched."
    return ""
