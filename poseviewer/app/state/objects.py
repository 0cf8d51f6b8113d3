"""Edits of the list of objects and of the strip of views."""

from dataclasses import replace
from typing import Any

from poseviewer.app.state.document import Document, ObjectState
from poseviewer.app.state.edits import edit
from poseviewer.app.state.session import Session, is_in_sight
from poseviewer.errors import SettingsError
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.mesh.size import METRES
from poseviewer.geometry.painted_model import Painting
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.types import InView, SceneObject
from poseviewer.starts.sides import look_from

MAX_OBJECTS = 30
"""Number of objects; each is kept in memory and drawn."""
MAX_NAME_LETTERS = 60
"""Length of an object's name: a line of the list."""
MAX_TEXT_LETTERS = 1000
"""Length of its other texts: a paragraph."""


@edit
def pick_object(session: Session, object_id: int) -> Session:
    """Make an object active, by its id; no undo step."""
    return session.with_active(session.document.scene.index(str(object_id)))


@edit
def add_object(session: Session, model: ModelFile | None = None) -> Session:
    """Add an object without a pose and make it active; default: of the active one's model."""
    document = session.document
    session = session.with_document(with_added(document, model or document.model))
    display = replace(session.display, photo_alone=False)
    return replace(session, tool="pose", display=display).with_first_proposals


def with_added(document: Document, model: ModelFile) -> Document:
    """The document with a further, active object; settings and views are the active one's.

    Raises:
        SettingsError: too many objects, different units, or a free scale of several views.
    """
    if len(document.scene.objects) >= MAX_OBJECTS:
        raise SettingsError(f"{MAX_OBJECTS} objects are the most in one scene; remove one first")
    document = _with_scale_found(document)
    like, unit = document.object, model.unit
    if unit and like.model.unit not in (None, unit):
        raise SettingsError(
            f"{model.name} is in {unit}, {like.model.name} in {like.model.unit}: the models "
            "of a scene have to be in one unit; scale one of the files"
        )
    pose = look_from("three-quarter", model.mesh, model.keypoints, document.pose.camera)
    world_from_model = document.view.world_from_model(pose, like.world_from_model.scale)
    objects = document.scene.objects
    added = SceneObject(
        id=str(1 + max(int(item.id) for item in objects)),
        model=model,
        world_from_model=world_from_model,
        start=world_from_model,
        start_cameras=tuple(view.camera for view in document.scene.views),
        settings=replace(like.settings, lock=()),
        in_views=tuple(InView(is_compared=own.is_compared) for own in like.in_views),
        is_placed=False,
    )
    scene, states = replace(document.scene, objects=(*objects, added)), document.states
    return replace(document, scene=scene, states=(*states, ObjectState()), active=len(objects))


def _with_scale_found(document: Document) -> Document:
    """The document whose scale, searched for until then, is that at which the object was found."""
    verdict = document.object.result and document.object.result.verdict
    if not document.scene.free_scale or verdict is None or verdict.label == "lost":
        return document
    return replace(document, scene=replace(document.scene, free_scale=False))


@edit
def remove_object(session: Session, object_id: int) -> Session:
    """Remove one of several objects, by its id."""
    document = session.document
    index = document.scene.index(str(object_id))
    if len(document.scene.objects) == 1:
        raise SettingsError("this is the only object; open another model in its place")
    return session.with_document(document.without(index))


@edit
def alter_object(session: Session, object_id: int, **changes: Any) -> Session:
    """Change ``hidden``, ``locked`` or a text of an object, by its id."""
    index = session.document.scene.index(str(object_id))
    item = session.document.scene.objects[index]
    texts = {key: text for key, text in changes.items() if isinstance(text, str)}
    for key, text in texts.items():
        changes[key] = text[: MAX_NAME_LETTERS if key == "name" else MAX_TEXT_LETTERS]
    if all(getattr(item, key) == value for key, value in changes.items()):
        return session
    key = f"{min(texts)} {object_id}" if texts else None
    return session.with_document(session.document.with_object(index, **changes), key)


@edit
def take_painting(session: Session, object_id: str, painting: Painting) -> Session:
    """Paint the model of an object, by its id, and show its colours."""
    index = session.document.scene.index(object_id)
    session = session.with_document(session.document.with_object(index, painting=painting))
    return replace(session, display=replace(session.display, style="solid", photo_alone=False))


@edit
def unpaint(session: Session) -> Session:
    """Compare and draw the active object's model as its file has it."""
    if session.document.object.painting is None:
        return session
    return session.with_document(session.document.with_object(painting=None))


@edit
def set_unit(session: Session, unit: str | None) -> Session:
    """Say the length unit of all models; None: it is not known."""
    if unit == unit_of_models(session):
        return session
    document = session.document
    for index, item in enumerate(document.scene.objects):
        document = document.with_object(index, model=replace(item.model, unit=unit))
    return session.with_document(document)


def unit_of_models(session: Session) -> str | None:
    """Length unit of the models, a key of ``METRES``; None: it is not known."""
    unit = ConvertOptions().unit_of(session.document.scene)
    return unit if unit in METRES else None


@edit
def show_view(session: Session, view_index: int, file: PhotoFile | None = None) -> Session:
    """Show another view large, whose photo may have been read into ``file``; no undo step, and a
    search goes on.
    """
    if view_index == session.document.view_index or not 0 <= view_index < len(
        session.document.scene.views
    ):
        return session
    document, anchor = session.document.with_view(view_index, file), session.compared_scene
    if not (is_in_sight(document) or document.scene.has_many_views):
        name = document.view.name
        raise SettingsError(f"{name} does not show the model where it is now")
    return replace(session.with_new_view(), document=document, anchor=anchor, drag=None)


@edit
def compare_view(session: Session, view_index: int, on: bool) -> Session:
    """Compare the active object with a view, or leave the view out."""
    document = session.document
    compared = [own.is_compared for own in document.object.in_views]
    if not 0 <= view_index < len(compared) or compared[view_index] is on:
        return session
    if not on and sum(compared) == 1:
        raise SettingsError("one photo at least is compared: switch another one on first")
    changed = document.with_view(view_index).with_in_view(is_compared=on)
    if not document.scene.has_many_views:  # of many, each has been looked at by itself
        changed = changed.with_object(result=None)
    return session.with_document(changed.with_view(document.view_index))


def symmetry_text(item: SceneObject) -> str:
    """Say which poses of an object are equivalent."""
    if item.symmetry.is_none:
        return "no symmetry"
    return f"poses are one that differ by {item.symmetry.words}"
