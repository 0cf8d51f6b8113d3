"""What the app opens with a calibration, with a pose of an undistorted photo, and again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.commands import Nudge
from poseviewer.app.state.document import SearchEnd
from poseviewer.app.state.objects import AddObject, AlterObject
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.exporting import export, record_of
from poseviewer.app.workers.opening import (
    Opened,
    open_file_set,
    open_files,
    open_objects,
    open_photo,
    open_pose,
    restore,
)
from poseviewer.files.cameras import Calibration
from poseviewer.files.file_set import FileSet, model_files, sort_set
from poseviewer.files.photo import load_calibrated_photo, load_photo, same_undistortion, save_image
from poseviewer.files.pose import PoseRecord, RecordedVerdict, save_pose
from poseviewer.files.state.autosave import AutosavedSession, load_autosave
from tests.scene import Scene
from tests.textured import write_obj


@pytest.fixture
def calibration(tmp_path: Path) -> Calibration:
    path = tmp_path / "camera.json"
    matrix = [[300.0, 0.0, 82.5], [0.0, 300.0, 57.5], [0.0, 0.0, 1.0]]
    content = {"camera_matrix": matrix, "dist_coeffs": [-0.9, 0, 0, 0, 0], "image_size": [160, 120]}
    path.write_text(json.dumps(content))
    return Calibration(path)


def kept_of(opened: Opened) -> AutosavedSession:
    registration = opened.document.registration
    photo = registration.photo
    record = PoseRecord(opened.document.pose, undistortion=photo.undistortion)
    paths = opened.document.photo_path, opened.document.model_path
    return AutosavedSession(
        paths[0], photo.name, photo.sha256, paths[1], registration.mesh_name,
        record, PoseRecord(registration.start), {}, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize("placed", [True, False])
def test_with_a_calibration_the_undistorted_photo_is_open(
    scene: Scene, calibration: Calibration, placed: bool
) -> None:
    wanted = load_calibrated_photo(scene.photo, calibration)
    opened = open_files(scene.photo, scene.model, scene.start if placed else None, calibration)
    photo = opened.document.registration.photo
    assert not np.array_equal(photo.pixels, load_photo(scene.photo).pixels)
    np.testing.assert_array_equal(photo.pixels, wanted.pixels)
    assert opened.document.pose.camera == wanted.camera
    session = Session(opened.document)
    assert record_of(session).undistortion == photo.undistortion
    (name,) = export("overlay", session)
    assert name == "p.undistorted.overlay.png"
    (pose,) = export("pose", session).values()
    assert "distortion" in json.loads(pose)


def test_a_pose_of_an_undistorted_photo_brings_that_photo(
    scene: Scene, calibration: Calibration, tmp_path: Path
) -> None:
    first = open_files(scene.photo, scene.model, scene.start, calibration)
    wanted = first.document
    save_pose(tmp_path / "pose.json", record_of(Session(wanted)))
    plain = open_files(scene.photo, scene.model, scene.start)
    (opened,) = open_pose(plain.document, tmp_path / "pose.json")
    assert not opened.pose_alone
    registration = opened.document.registration
    np.testing.assert_array_equal(registration.photo.pixels, wanted.registration.photo.pixels)
    # Once more: the photo is that one already.
    (again,) = open_pose(opened.document, tmp_path / "pose.json")
    assert again.pose_alone
    assert again.document.registration.photo is registration.photo


def test_what_an_earlier_session_left_is_undistorted_again(
    scene: Scene, calibration: Calibration
) -> None:
    before = open_files(scene.photo, scene.model, scene.start, calibration)
    (opened,) = restore(kept_of(before))
    now, then = opened.document.registration, before.document.registration
    np.testing.assert_array_equal(now.photo.pixels, then.photo.pixels)
    assert same_undistortion(now.photo.undistortion, then.photo.undistortion)
    assert opened.document.pose == before.document.pose


def test_another_photo_is_shown_as_taken_and_said_so(
    scene: Scene, calibration: Calibration
) -> None:
    before = open_files(scene.photo, scene.model, scene.start, calibration)
    other = scene.photo.with_name("other.png")
    other.write_bytes(scene.photo.read_bytes())
    opened = open_photo(before.document, other)
    photo = opened.document.registration.photo
    assert photo.undistortion is None
    np.testing.assert_array_equal(photo.pixels, load_photo(scene.photo).pixels)
    assert any("as taken" in warning for warning in opened.warnings)


def test_all_objects_of_a_session_come_back(scene: Scene, tmp_path: Path) -> None:
    other = write_obj(tmp_path, "wood.png")
    save_image(tmp_path / "wood.png", np.full((4, 4, 3), 90, np.uint8))
    ((added,), _) = open_objects([other])
    session = Session(open_files(scene.photo, scene.model, scene.start).document)
    for command in (
        AddObject(),
        Nudge("move", 9.0),
        added,
        Nudge("turn", 3.0),
        AlterObject(2, hidden=True),
        AlterObject(1, locked=True, name="ball"),
    ):
        session = update(session, command)
        assert not session.error_message
    verdict = RecordedVerdict("found", 0.9)
    record = PoseRecord(session.document.pose, verdict=verdict)
    session = replace(session, document=replace(session.document, end=SearchEnd(record)))
    Autosaver(tmp_path / "state").close(session)
    (path,) = (tmp_path / "state" / "sessions").iterdir()
    kept = load_autosave(path)
    (opened,) = restore(kept)
    before, after = session.document.objects, opened.document.objects
    assert opened.document.number == 3
    for one, again in zip(before, after, strict=True):
        for name in ("number", "name", "hidden", "locked", "model_path"):
            assert getattr(one, name) == getattr(again, name)
        np.testing.assert_array_equal(
            one.pose.camera_from_model.rotation, again.pose.camera_from_model.rotation
        )
        assert one.pose.camera == again.pose.camera
        assert again.registration.photo is opened.document.registration.photo
    assert opened.document.verdict == "found"
    assert after[0].registration.mesh is after[1].registration.mesh
    # An object whose model is gone is said, and the others open.
    gone = replace(kept.others[0], model=tmp_path / "gone.ply", model_name="gone.ply")
    (opened,) = restore(replace(kept, others=(gone, kept.others[1])))
    assert [one.number for one in opened.document.objects] == [2, 3]
    assert any(warning.startswith("gone.ply: is not where") for warning in opened.warnings)


def test_another_photo_is_that_of_all_objects(scene: Scene) -> None:
    session = Session(open_files(scene.photo, scene.model, scene.start).document)
    session = update(update(session, AddObject()), Nudge("move", 9.0))
    other = scene.photo.with_name("other.png")
    other.write_bytes(scene.photo.read_bytes())
    document = open_photo(session.document, other).document
    assert [one.verdict for one in document.objects] == ["not placed", "not placed"]
    (one,) = document.others
    assert one.registration.photo is document.registration.photo
    # As they stood to each other.
    was, now = (
        a.pose.camera_from_model.translation - b.pose.camera_from_model.translation
        for a, b in ((session.document, session.document.others[0]), (document, one))
    )
    np.testing.assert_allclose(was, now, atol=1e-9)


def test_a_camera_alone_is_for_the_photo_at_hand(scene: Scene, calibration: Calibration) -> None:
    before = open_files(scene.photo, scene.model, scene.start).document
    opened = open_file_set(before, FileSet(camera=calibration.path), [])
    registration = opened.document.registration
    assert registration.photo.undistortion is not None
    assert registration.mesh is before.registration.mesh
    centre = registration.mesh.centre
    moved = opened.document.pose.project(centre) - before.pose.project(centre)
    np.testing.assert_allclose(moved, 0.0, atol=1e-6)


def test_photo_models_and_start_that_came_together_are_opened(scene: Scene) -> None:
    before = open_files(scene.photo, scene.model, None).document
    files = sort_set([scene.photo, scene.model, scene.start, scene.photo.with_name("notes.txt")])
    opened = open_file_set(before, files, [scene.model])
    assert not opened.document.awaits_place
    assert opened.warnings[0] == "Not used: notes.txt."
    assert not opened.objects
    models = [scene.model] * 2
    opened = open_file_set(
        before, FileSet(models=tuple(model_files(m, []) for m in models)), models
    )
    assert [one.path for one in opened.objects] == [scene.model]
