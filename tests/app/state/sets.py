"""Sessions on three photos, to test with: one colour each, seen by cameras that are known."""

from collections.abc import Sequence
from pathlib import Path

from poseviewer.app.state.document import Document
from poseviewer.app.state.session import Session
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.world_pose import View
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import LoadedModel, Scene, SceneObject
from tests import several
from tests.app.state.documents import make_photo
from tests.view_sets import CAMERA, CAMERAS_FROM_SET, MESH, NAMES, TRUTH

SCALE = 0.5
"""Lengths of the world's unit in one of the model's."""


def make_views_of() -> tuple[View, ...]:
    """Three photos, by the cameras of ``tests.view_sets``."""
    views = []
    for index, (name, place) in enumerate(zip(NAMES, CAMERAS_FROM_SET, strict=True)):
        pixels = make_photo(index).pixels[:1, :1].repeat(CAMERA.height, 0).repeat(CAMERA.width, 1)
        photo = Photo(pixels, name, f"{index:064d}", camera=CAMERA)
        moved = RigidTransform(place.rotation, SCALE * place.translation)
        views.append(View(name, photo, CAMERA, moved, path=Path(name)))
    return tuple(views)


def make_set_session(free_scale: bool = False) -> Session:
    """The model where it is, the first photo large."""
    views = make_views_of()
    place = views[0].world_from_model(TRUTH[0], SCALE)
    one = SceneObject("1", LoadedModel(MESH, "m.ply", "0" * 64), place)
    return Session(Document.of(Scene(views, (one,), "set.json", free_scale=free_scale)))


def document_of(poses: Sequence[Pose], settings: FitSettings | None = None) -> Document:
    """Some of the objects of ``tests.several`` in their photo, the first active."""
    photo = several.make_photo()
    view = View(photo.name, photo, poses[0].camera)
    objects = tuple(
        SceneObject(
            str(number),
            LoadedModel(mesh, f"{number}.ply", str(number) * 64),
            view.world_from_model(pose),
            settings or FitSettings(),
        )
        for number, (mesh, pose) in enumerate(zip(several.MESHES, poses, strict=False), 1)
    )
    return Document.of(Scene((view,), objects))
