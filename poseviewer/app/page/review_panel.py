"""The folder "Review": where in the queue, what is said of the row, and what can be said."""

from __future__ import annotations

from html import escape

import viser

from poseviewer.app.page.fields import Post, button, choices, set_property
from poseviewer.app.reviewing import ReviewState
from poseviewer.app.state.requests import Annotate, Review


class ReviewPanel:
    """Shown in a review alone."""

    def __init__(self, gui: viser.GuiApi, post: Post) -> None:
        self._key = ""
        with gui.add_folder("Review"):
            self._where = gui.add_markdown("")
            button(gui, "Accept (A)", post, lambda _: Review("accept"), icon="check", color="cyan")
            choices(
                gui,
                "Go",
                post,
                {"Previous (P)": Review("previous"), "Next (N)": Review("next")},
            )
            self._back = button(gui, "Take back", post, lambda _: Review("take back"), color="gray")
            self._note = gui.add_text("Note", "")

            @self._note.on_update
            async def _(event: viser.GuiEvent) -> None:
                if event.client is not None and self._key:
                    post(Annotate(self._key, self._note.value))

    def show(self, state: ReviewState) -> None:
        """Bring the panel to the row at hand."""
        set_property(self._where, "content", _text(state))
        set_property(self._back, "visible", bool(state.row.result.review))
        # What is being typed is not written over: only another row brings another note.
        if self._key != state.row.job.key:
            self._key = state.row.job.key
            set_property(self._note, "value", state.row.result.note)


def _text(state: ReviewState) -> str:
    row, queue = state.row, state.queue
    result = row.result
    said = result.review or "not accepted"
    if state.mended and not result.failed:
        said = f"● pose changed, {said if result.review else 'not accepted yet'}"
    lines = [
        f"**{state.place} of {len(queue.rows)}**, {queue.accepted} accepted",
        f"row {row.job.row}: {escape(said)}",
    ]
    if result.failed:
        lines.append(escape(f"failed: {result.reason}"))
    elif result.start_loss:
        loss = "-" if result.loss is None else f"{result.loss:.4f}"
        lines.append(f"loss {loss}, at the start {result.start_loss:.4f}")
    verdict = getattr(result, "verdict", "")
    if verdict and not result.review:
        lines.append(escape(f"verdict: {verdict}"))
    if state.trouble:
        lines.append(escape(state.trouble))
    return "  \n".join(lines)
