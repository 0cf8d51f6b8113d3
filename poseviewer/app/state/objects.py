"""What a user asks of the objects of a document, of the photos of its set, and of a model's
symmetry: which is picked, or large; one more, one less; which poses are one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from poseviewer.app.state.commands import Command, WorkerUpdate
from poseviewer.app.state.document import SceneObject
from poseviewer.app.state.photo_set import FEWEST_COMPARED
from poseviewer.app.state.session import Outlines, Session, Strip
from poseviewer.errors import SettingsError
from poseviewer.fit.registration import LoadedModel, Registration
from poseviewer.starts.placing import look_from

MOST_OBJECTS = 30
"""All of them are kept in memory, and drawn."""
LONGEST_NAME = 60
"""Letters."""


class PickObject(Command):
    """All that follows is about another object. No step: undo leads to what was done before."""

    number: int

    def __call__(self, session: Session) -> Session:
        return session.picking(self.number)


class AddObject(Command, eq=False):
    """One more object of a model that is ready, picked, and to be put where the photo has it; None:
    of the picked one's model.
    """

    model: LoadedModel | None = None
    path: Path | None = None

    def __call__(self, session: Session) -> Session:
        document = session.document
        own, path = replace(document.registration, warnings=()), document.model_path
        if self.model is not None:
            own, path = own.with_model(self.model), self.path
        pose = look_from("three-quarter", own.mesh, own.keypoints, document.pose.camera)
        own = replace(own, start=pose, start_is_guess=True, mask=None)
        settings = replace(document.settings, region=None, lock=())
        return _with(session, SceneObject(own, pose, settings, model_path=path))


def _with(session: Session, new: SceneObject) -> Session:
    if session.document.views is not None:
        raise SettingsError(
            "a set of photos has one object: open one of its photos alone to add another"
        )
    if len(session.document.objects) >= MOST_OBJECTS:
        raise SettingsError(f"{MOST_OBJECTS} objects are the most in one photo; remove one first")
    added = session.with_document(session.document.with_object(new))
    return replace(added, tool="pose", look=replace(added.look, hidden=False))


class RemoveObject(Command):
    """One of several objects goes."""

    number: int

    def __call__(self, session: Session) -> Session:
        document = session.document
        if document.numbered(self.number) is None:
            return session
        if not document.others:
            raise SettingsError("this is the only object; open another model in its place")
        return session.with_document(document.without(self.number))


class AlterObject(Command):
    """Hide or show, lock or unlock, or rename an object; None leaves as it is."""

    number: int
    hidden: bool | None = None
    locked: bool | None = None
    name: str | None = None

    def __call__(self, session: Session) -> Session:
        one = session.document.numbered(self.number)
        if one is None:
            return session
        name = None if self.name is None else self.name[:LONGEST_NAME]
        given = {"hidden": self.hidden, "locked": self.locked, "name": name}
        changes = {key: value for key, value in given.items() if value is not None}
        if all(getattr(one, key) == value for key, value in changes.items()):
            return session
        # One step back leads to before the whole of a name, not to its first letter.
        what = f"name {self.number}"
        typed_on = session.typed == (what, session.document) and not session.history.future
        document = session.document.altered(self.number, **changes)
        altered = session.with_document(document, same_step=typed_on and name is not None)
        return altered if name is None else replace(altered, typed=(what, document))


class OutlinesDrawn(WorkerUpdate, eq=False):
    """A worker has drawn the objects that are not picked."""

    outlines: Outlines

    def __call__(self, session: Session) -> Session:
        return replace(session, outlines=self.outlines)


class LookAt(Command):
    """Another photo of the set is the large one. No step: undo leads to what was done before; a
    search goes on.
    """

    index: int

    def __call__(self, session: Session) -> Session:
        return session.looking_at(self.index)


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


class StripDrawn(WorkerUpdate, eq=False):
    """A worker has drawn the model in all photos of the set."""

    strip: Strip

    def __call__(self, session: Session) -> Session:
        return replace(session, strip=self.strip)


def symmetry_text(own: Registration) -> str:
    """Which poses count as one."""
    if own.whole_symmetry.is_none:
        return "all poses are told apart"
    if own.symmetry.is_none:
        return "with parts left out, all poses are told apart"
    return f"poses are one that differ by {own.symmetry.words}"
