"""What a user asks of the photos of a set: which one is large, and which are compared."""

from __future__ import annotations

from dataclasses import dataclass, replace

from poseviewer.app.state.commands import Command, WorkerUpdate
from poseviewer.app.state.photo_set import FEWEST_COMPARED
from poseviewer.app.state.session import Session, Strip
from poseviewer.errors import SettingsError


@dataclass(frozen=True, slots=True)
class LookAt(Command):
    """Another photo of the set is the large one. No step: undo leads to what was done before; a
    search goes on.
    """

    index: int

    def __call__(self, session: Session) -> Session:
        return session.looking_at(self.index)


@dataclass(frozen=True, slots=True)
class ComparePhoto(Command):
    """Compare a photo of the set, or leave it out."""

    index: int
    on: bool

    def __call__(self, session: Session) -> Session:
        views = session.document.views
        if views is None or not 0 <= self.index < len(views.compared):
            return session
        compared = list(views.compared)
        if compared[self.index] is self.on:
            return session
        compared[self.index] = self.on
        if sum(compared) < FEWEST_COMPARED:
            raise SettingsError(
                f"{FEWEST_COMPARED} photos at least are compared: switch another one on first"
            )
        # What a search said was said by other photos.
        document = session.document.unsearched
        assert document.views is not None  # as before
        views = replace(document.views, compared=tuple(compared))
        return session.with_document(replace(document, views=views))


@dataclass(frozen=True, slots=True, eq=False)
class StripDrawn(WorkerUpdate):
    """A worker has drawn the model in all photos of the set."""

    strip: Strip

    def __call__(self, session: Session) -> Session:
        return replace(session, strip=self.strip)
