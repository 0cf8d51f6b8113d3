"""Sessions on a set of three photos, to test with: noise, seen by cameras that are known."""

from __future__ import annotations

from pathlib import Path

from poseviewer.app.state.document import Document, Marks
from poseviewer.app.state.photo_set import OwnOfPhoto, PhotoSet
from poseviewer.app.state.session import Session
from poseviewer.files.view_set import SetChoice
from poseviewer.fit.registration import Registration
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.view_set import View, ViewSet
from tests.app.state.documents import make_photo
from tests.view_sets import CAMERA, CAMERAS_FROM_SET, MESH, NAMES, TRUTH

SCALE = 2.0
"""Lengths of the model's unit in one of the set's."""


def make_set(free_size: bool = False) -> ViewSet:
    """Three photos of noise, by the cameras of ``tests.view_sets``."""
    views = []
    for index, (name, place) in enumerate(zip(NAMES, CAMERAS_FROM_SET, strict=True)):
        pixels = make_photo(index).pixels[:1, :1].repeat(CAMERA.height, 0).repeat(CAMERA.width, 1)
        photo = Photo(pixels, name, f"{index:064d}", camera=CAMERA)
        moved = type(place)(place.rotation, place.translation / SCALE)
        views.append(View(name, photo, moved, path=Path(name)))
    return ViewSet("set.json", tuple(views), None, None if free_size else SCALE)


def make_set_session(free_size: bool = False) -> Session:
    """The model where it is, the first photo large."""
    views = make_set(free_size)
    own = tuple(OwnOfPhoto(None, None, Marks()) for _ in views.views)
    photos = PhotoSet(views, Path("set.json"), SetChoice(), own, (True,) * 3, 0, SCALE, free_size)
    photo, pose = views.views[0].photo, TRUTH[0]
    registration = Registration(photo, MESH, "m.ply", "0" * 64, None, pose, ())
    return Session(Document(registration, pose, photo_path=Path(NAMES[0]), views=photos))


def set_of(session: Session) -> PhotoSet:
    """The set at hand."""
    assert session.document.views is not None
    return session.document.views
