"""What a user asks of the objects of a document, of its views, and of a model's symmetry: which is
active, or large; one more, one less; which poses are one.
"""

from __future__ import annotations

from dataclasses import replace

from poseviewer.app.state.commands import Command, WorkerUpdate
from poseviewer.app.state.document import Document
from poseviewer.app.state.session import Outlines, Session
from poseviewer.errors import SettingsError
from poseviewer.fit.scene import InView, LoadedModel, SceneObject
from poseviewer.starts.placing import look_from

MOST_OBJECTS = 30
"""All of them are kept in memory, and drawn."""
LONGEST_NAME = 60
"""Letters."""


class PickObject(Command):
    """All that follows is about another object. No step: undo leads to what was done before."""

    number: int

    def __call__(self, session: Session) -> Session:
        index = session.document.index_of(self.number)
        return session if index is None else session.with_active(index)


class AddObject(Command, eq=False):
    """One more object of a model that is ready, active, and to be put where a photo has it; None:
    of the active one's model.
    """

    model: LoadedModel | None = None

    def __call__(self, session: Session) -> Session:
        document = session.document
        added = session.with_document(with_added(document, self.model or document.model))
        return replace(added, tool="pose", look=replace(added.look, hidden=False))


def with_added(document: Document, model: LoadedModel) -> Document:
    """The document with one more object of a model, active, compared as the one before.

    Raises:
        SettingsError: there are too many, the models are in different units, or the scale of
            several views is not known.
    """
    if len(document.scene.objects) >= MOST_OBJECTS:
        raise SettingsError(f"{MOST_OBJECTS} objects are the most in one scene; remove one first")
    like, unit = document.object, model.mesh.unit
    if unit and like.model.mesh.unit not in (None, unit):
        raise SettingsError(
            f"{model.name} is in {unit}, {like.model.name} in {like.model.mesh.unit}: the models "
            "of a scene have to be in one unit; scale one of the files"
        )
    pose = look_from("three-quarter", model.mesh, model.keypoints, document.pose.camera)
    place = document.view.world_from_model(pose, like.world_from_model.scale)
    settings = replace(like.settings, lock=())
    in_views = tuple(InView(is_compared=own.is_compared) for own in like.in_views)
    new = SceneObject("", model, place, settings, in_views=in_views, is_placed=False)
    return document.with_new(new)


class RemoveObject(Command):
    """One of several objects goes."""

    number: int

    def __call__(self, session: Session) -> Session:
        document = session.document
        index = document.index_of(self.number)
        if index is None:
            return session
        if len(document.scene.objects) == 1:
            raise SettingsError("this is the only object; open another model in its place")
        return session.with_document(document.without(index))


class AlterObject(Command):
    """Hide or show, lock or unlock, or rename an object; None leaves as it is."""

    number: int
    hidden: bool | None = None
    locked: bool | None = None
    name: str | None = None

    def __call__(self, session: Session) -> Session:
        index = session.document.index_of(self.number)
        if index is None:
            return session
        one = session.document.scene.objects[index]
        changes = self.given("hidden", "locked")
        if self.name is not None:
            changes["name"] = self.name[:LONGEST_NAME]
        if all(getattr(one, key) == value for key, value in changes.items()):
            return session
        # One step back leads to before the whole of a name, not to its first letter.
        what = f"name {self.number}"
        typed_on = session.typed == (what, session.document) and not session.history.future
        document = session.document.with_object(index, **changes)
        altered = session.with_document(document, same_step=typed_on and "name" in changes)
        return replace(altered, typed=(what, document)) if "name" in changes else altered


class OutlinesDrawn(WorkerUpdate, eq=False):
    """A worker has drawn what is drawn beside the active object."""

    outlines: Outlines

    def __call__(self, session: Session) -> Session:
        return replace(session, outlines=self.outlines)


class LookAt(Command):
    """Another view is large. No step: undo leads to what was done before; a search goes on."""

    index: int

    def __call__(self, session: Session) -> Session:
        is_there = 0 <= self.index < len(session.document.scene.views)
        return session.with_view(self.index) if is_there else session


class CompareView(Command):
    """Compare the active object with a view, or leave it out."""

    index: int
    on: bool

    def __call__(self, session: Session) -> Session:
        document = session.document
        compared = [own.is_compared for own in document.object.in_views]
        if not 0 <= self.index < len(compared) or compared[self.index] is self.on:
            return session
        if not self.on and sum(compared) == 1:
            raise SettingsError("one photo at least is compared: switch another one on first")
        # What a search said was said by other photos.
        changed = document.with_view(self.index).with_own(is_compared=self.on)
        return session.with_document(changed.with_object(result=None).with_view(document.at))


def symmetry_text(model: LoadedModel) -> str:
    """Which poses count as one."""
    if model.whole_symmetry.is_none:
        return "no symmetry"
    if model.symmetry.is_none:
        return "no symmetry with parts left out"
    return f"poses are one that differ by {model.symmetry.words}"
