"""Which model is it, in the app: the thread that compares models."""

from __future__ import annotations

from collections.abc import Callable

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session
from poseviewer.app.workers.worker import Worker
from poseviewer.confidence.identify import Identification, identifying
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.software.renderer import SoftwareRenderer

RendererOf = Callable[[Mesh], SoftwareRenderer]


class Identifier:
    """Compares models, one comparison after the other, beside the page."""

    def __init__(self, notify: Callable[[], None], renderer_of: RendererOf) -> None:
        """``renderer_of`` is called in the worker's thread."""
        self._worker: Worker[Identification] = Worker("identifier", notify)
        self._renderer_of = renderer_of
        self._numbers: dict[int, int] = {}

    def start(self, session: Session) -> None:
        """Begin what is asked for and not begun yet; let go of what is not wanted any more."""
        asked = session.candidates.comparison
        if asked is None or not asked.running:
            if self._worker.busy:
                self._worker.stop()
            return
        if asked.number not in self._numbers.values():
            ticket = self._worker.start(
                lambda: identifying(
                    asked.registrations,
                    asked.document.settings,
                    renderer_of=lambda mesh: self._renderer_of(mesh).clone(),
                )
            )
            self._numbers = {ticket: asked.number}

    def take(self) -> c.IdentificationAdvanced | c.IdentificationFailed | None:
        """What has come of it; None for nothing new."""
        latest = self._worker.take()
        if latest is None:
            return None
        number = self._numbers.get(latest.ticket, 0)
        if latest.error is not None:
            return c.IdentificationFailed(number, str(latest.error))
        return None if latest.item is None else c.IdentificationAdvanced(number, latest.item)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()
