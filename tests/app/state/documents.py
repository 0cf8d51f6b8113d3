"""Documents and sessions to test with: noise for a photo, a box for a car."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.document import Document, label_of
from poseviewer.app.state.dragging import Drag
from poseviewer.app.state.edits import Edit, update
from poseviewer.app.state.results import SearchRequest
from poseviewer.app.state.session import Session
from poseviewer.app.workers.opening import open_sources
from poseviewer.errors import PoseViewerError
from poseviewer.files.cameras import Calibration
from poseviewer.files.image_sequence import ImageSequence
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.opening.sources import Sources
from poseviewer.scene.assets import ModelFile, PhotoFile
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import View, scene_at
from poseviewer.starts.sides import look_from
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from tests.meshes import make_box, make_bumpy

WIDTH, HEIGHT = 160, 120
PERSPECTIVE = Perspective(300.0, 240.0, 83.0, 58.0, WIDTH, HEIGHT)
PARALLEL = Parallel(25.0, 83.0, 58.0, WIDTH, HEIGHT)
CAMERAS = pytest.mark.parametrize("camera", [PARALLEL, PERSPECTIVE], ids=["parallel", "pinhole"])
BUMPY = make_bumpy(2)
CAR = make_box((4.0, 1.7, 1.3))


def make_photo(seed=0) -> Photo:
    """Noise in colour."""
    pixels = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return Photo(pixels, f"{seed}.png", f"{seed:064d}")


def make_keypoints() -> VehicleKeypoints:
    """Wheels of ``CAR``, which looks along +x with z upwards."""
    sides = [
        SideKeypoints(*np.array([[-1.2, y, -0.4], [1.2, y, -0.4], [0.0, np.sign(y), 0.0]]))
        for y in (0.85, -0.85)
    ]
    return VehicleKeypoints(*sides)


def make_document(
    camera: Camera = PERSPECTIVE,
    vehicle: bool = False,
    photo: Photo | None = None,
    mesh: Mesh = BUMPY,
    settings: FitSettings | None = None,
) -> Document:
    """A model before a photo, a little off its middle."""
    keypoints = make_keypoints() if vehicle else None
    mesh = CAR if vehicle else mesh
    pose = Pose(camera, RigidTransform.from_rotation_vector([0.4, -0.3, 0.2], [0.2, -0.1, 8.0]))
    if vehicle:
        pose = look_from("three-quarter", CAR, keypoints, camera)
    photo = photo or make_photo()
    model = ModelFile.of(mesh, None, "0" * 64, name="m.ply", keypoints=keypoints)
    return Document.of(scene_at(View(PhotoFile.of(photo), camera), model, pose, settings=settings))


def make_session(*arguments, **more) -> Session:
    """A session with ``make_document``'s document, no history."""
    return Session(make_document(*arguments, **more))


def after(session: Session, *edits: Edit) -> Session:
    """The session after edits none of which is refused."""
    for edit in edits:
        session = update(session, edit)
    return session


def refused(session: Session, edit: Edit) -> str:
    """The sentence by which an edit is refused."""
    with pytest.raises(PoseViewerError) as error:
        update(session, edit)
    sentence = str(error.value)
    assert sentence.endswith(".")
    names = tuple(map(label_of, session.document.scene.objects))
    assert sentence[0] == sentence[0].upper() or sentence.startswith(names)
    return sentence


def asked_of(session: Session) -> SearchRequest:
    """What is searched for."""
    assert session.search is not None
    return session.search


def held(session: Session) -> Session:
    """The session while the model is dragged."""
    return replace(session, drag=Drag(lambda document, _: document, before=session.document))


def moved_document(document: Document, step: float) -> Document:
    """The same with another pose."""
    place = document.pose.camera_from_model
    shifted = RigidTransform(place.rotation, place.translation + np.array([step, 0.0, 0.0]))
    return document.at_pose(replace(document.pose, camera_from_model=shifted))


def assert_same_pose(own: Pose, its: Pose, atol: float = 1e-9) -> None:
    """Fail unless both are one but for rounding."""
    a, b = own.camera_from_model, its.camera_from_model
    np.testing.assert_allclose(a.rotation, b.rotation, atol=atol)
    np.testing.assert_allclose(a.translation, b.translation, atol=atol)
    assert own.camera == its.camera


def open_files(
    photo: Path | ImageSequence,
    model: Path,
    start: Path | None,
    calibration: Calibration | None = None,
) -> Document:
    """A photo, or frames, with a model and perhaps its start, as the app opens them."""
    files = Sources(model=model, start=start, calibration=calibration)
    is_sequence = isinstance(photo, ImageSequence)
    return open_sources(replace(files, **{"frames" if is_sequence else "photo": photo}))
