"""What is still made ready, above all else in the left panel, with a bar; nothing when it is."""

from __future__ import annotations

import viser

from poseviewer.app.page.controls import plain, set_properties
from poseviewer.app.state.session import Session

COMPILING = (
    "**Compiling, this once: {share:.0%}**  \n"
    "Place the model meanwhile, by a sketch of its outline. Loss, maps and a search that is asked "
    "for begin by themselves."
)


class PreparingPanel:
    """A sentence and a bar."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._text = gui.add_markdown("", visible=False)
        self._bar = gui.add_progress_bar(0.0, visible=False, color="cyan", animated=True)

    def show(self, session: Session) -> None:
        """Bring them to the session."""
        preparation = session.preparation
        share = None if preparation is None else preparation.share
        trouble = "" if preparation is None else preparation.trouble
        set_properties(self._bar, visible=share is not None)
        set_properties(self._text, visible=share is not None or bool(trouble))
        if share is not None:
            set_properties(self._bar, value=100.0 * share)
            set_properties(self._text, content=COMPILING.format(share=share))
        elif trouble:
            set_properties(self._text, content=f"**{plain(trouble)}**")
