"""Proposed starts in the app: the thread that looks for them, and their controls."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session
from poseviewer.app.workers.worker import Worker, yield_to_others
from poseviewer.geometry.camera import Pose
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.automatic import propose


class Proposer:
    """Looks for proposals, one request after the other, beside the page."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._worker: Worker[tuple[Pose, ...]] = Worker("proposer", notify)
        self._numbers: dict[int, int] = {}

    def start(self, session: Session, renderer: SoftwareRenderer) -> None:
        """Begin what is asked for and not begun yet."""
        asked = session.proposals
        if asked is None or not asked.running or asked.number in self._numbers.values():
            return
        wanted, own = asked.query, renderer.clone()

        def run() -> Iterator[tuple[Pose, ...]]:
            yield tuple(one.pose for one in propose(wanted, own, yield_to_others).found)

        self._numbers = {self._worker.start(run): asked.number}

    def take(self) -> c.StartsProposed | c.ProposingFailed | None:
        """What has come of it; None for nothing yet."""
        latest = self._worker.take()
        if latest is None:
            return None
        number = self._numbers.get(latest.ticket, 0)
        if latest.error is not None:
            return c.ProposingFailed(number, str(latest.error))
        return None if latest.item is None else c.StartsProposed(number, latest.item)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()
