"""The first minute on the demo: four short hints, each shown until the user has done it."""

from __future__ import annotations

from collections.abc import Callable

from poseviewer.app.state.session import Session
from poseviewer.files.demo import demo_case
from poseviewer.files.writing import sha256_of


def _moved(now: Session, then: Session) -> bool:
    """Whether the user has given the model another pose."""
    still = now.drag is None and not now.searching
    return still and now.document.pose is not then.document.pose


HINTS: tuple[tuple[str, Callable[[Session, Session], bool]], ...] = (
    ("<b>Drag</b> the model, or one of its pins, roughly onto the car", _moved),
    (
        "Press <b>space</b>: the search brings it onto the photo",
        lambda now, _: now.search is not None and not now.searching,
    ),
    (
        "Press <b>5</b>: what the pose does not explain lights up",
        lambda now, _: now.look.name == "residual",
    ),
    ("Press <b>a map</b> of the loss: the pose goes there, and <b>Z</b> takes it back", _moved),
)
"""What to do next, and whether it was done, by the session now and when the hint came up."""


class Guide:
    """Which hint is due."""

    def __init__(self) -> None:
        self._photo = sha256_of(demo_case().photo)
        self._step = 0
        self._then: Session | None = None

    def text(self, session: Session) -> str:
        """The hint (HTML); "" once all were followed, and for photos of the user's own."""
        if session.document.registration.photo.sha256 != self._photo:
            return ""
        then = self._then = self._then or session
        if self._step < len(HINTS) and HINTS[self._step][1](session, then):
            self._step, self._then = self._step + 1, session
        if self._step == len(HINTS):
            return ""
        return f"{self._step + 1} of {len(HINTS)}: {HINTS[self._step][0]}"
