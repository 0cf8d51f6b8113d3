"""Proposed starts in the app: the thread that looks for them, and their controls."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import viser

from poseviewer.app.page.fields import Post, button, set_property
from poseviewer.app.state import commands as c
from poseviewer.app.state.proposing import wanted_of
from poseviewer.app.state.session import Session
from poseviewer.app.workers.worker import Worker, yield_to_others
from poseviewer.geometry.camera import Pose
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.automatic import propose

BOX_HINT = "drag a rectangle about the object &nbsp;·&nbsp; Esc: leave it"


class Proposer:
    """Looks for proposals, one request after the other, beside the page."""

    def __init__(self, ring: Callable[[], None]) -> None:
        self._worker: Worker[tuple[Pose, ...]] = Worker("proposer", ring)
        self._numbers: dict[int, int] = {}

    def start(self, session: Session, renderer: SoftwareRenderer) -> None:
        """Begin what is asked for and not begun yet."""
        asked = session.proposing
        if asked is None or not asked.running or asked.number in self._numbers.values():
            return
        wanted, own = wanted_of(asked.document), renderer.clone()

        def run() -> Iterator[tuple[Pose, ...]]:
            yield tuple(one.pose for one in propose(wanted, own, yield_to_others).found)

        self._numbers = {self._worker.start(run): asked.number}

    def take(self) -> c.StartsProposed | c.ProposingFailed | None:
        """What has come of it; None for nothing yet."""
        news = self._worker.take()
        if news is None:
            return None
        number = self._numbers.get(news.ticket, 0)
        if news.error is not None:
            return c.ProposingFailed(number, str(news.error))
        return None if news.item is None else c.StartsProposed(number, news.item)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()


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
        asked = session.proposing
        running = asked is not None and asked.running
        drawing = session.tool == "box"
        set_property(self._box, "label", "Drag on the photo ..." if drawing else "Draw a box")
        set_property(self._propose, "label", "Looking ..." if running else "Propose starts")
        set_property(self._propose, "disabled", running)
        there = asked is not None and bool(asked.poses) and asked.is_about(session.document)
        for handle in self._steps:
            set_property(handle, "visible", there)
        set_property(self._text, "content", proposals_text(session))


def proposals_text(session: Session) -> str:
    """How it stands, for the panel (markdown)."""
    asked = session.proposing
    if asked is not None and asked.running:
        return "Trying views from everywhere: some seconds, longer without a box."
    if asked is not None and asked.poses and asked.is_about(session.document):
        return f"**proposal {asked.index + 1} of {len(asked.poses)}**, the likeliest first"
    if session.document.marks.box is None and session.document.settings.region is None:
        return "Draw a box about the object; without one, the whole photo is searched."
    return ""
