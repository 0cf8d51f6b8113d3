"""What the app opens with a calibration, with a pose of an undistorted photo, and again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import export, record_of
from poseviewer.app.workers.opening import Opened, open_files, open_photo, open_pose, restore
from poseviewer.files.cameras import Calibration
from poseviewer.files.photo import load_calibrated_photo, load_photo, same_undistortion
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.files.state.autosave import AutosavedSession
from tests.scene import Scene


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
        registration.mesh_sha256, record, PoseRecord(registration.start), {}, True, 0.0, 1,
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
    ((name, content),) = export("overlay", session).items()
    assert name == "p.undistorted.overlay.png"
    assert b"p.png, undistorted" in content
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
