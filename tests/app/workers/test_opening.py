"""What the app opens with a calibration, with a pose of an undistorted photo, and again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from poseviewer.app.state.commands import nudge
from poseviewer.app.state.document import verdict_of
from poseviewer.app.state.objects import add_object, alter_object
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.app.workers.autosaving import Autosaver, kept_of
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.opening import (
    open_autosaved,
    open_file_set,
    open_files,
    open_photo,
    open_pose,
    open_scene,
)
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseFileError
from poseviewer.files.cameras import Calibration
from poseviewer.files.file_set import FileSet, model_files, sort_set
from poseviewer.files.photo import load_calibrated_photo, load_photo, same_undistortion, save_image
from poseviewer.files.pose import save_pose
from poseviewer.files.state.autosave import load_autosave
from poseviewer.fit.scene import SearchResult
from poseviewer.starts.loading import load_model, pose_record
from tests.app.state.documents import assert_same_pose
from tests.scene import Scene
from tests.several import make_three
from tests.textured import write_obj


@pytest.fixture
def calibration(tmp_path: Path) -> Calibration:
    path = tmp_path / "camera.json"
    matrix = [[300.0, 0.0, 82.5], [0.0, 300.0, 57.5], [0.0, 0.0, 1.0]]
    content = {"camera_matrix": matrix, "dist_coeffs": [-0.9, 0, 0, 0, 0], "image_size": [160, 120]}
    path.write_text(json.dumps(content))
    return Calibration(path)


@pytest.mark.parametrize("placed", [True, False])
def test_with_a_calibration_the_undistorted_photo_is_open(
    scene: Scene, calibration: Calibration, placed: bool
) -> None:
    wanted = load_calibrated_photo(scene.photo, calibration)
    opened = open_files(scene.photo, scene.model, scene.start if placed else None, calibration)
    photo = opened.photo
    assert not np.array_equal(photo.pixels, load_photo(scene.photo).pixels)
    np.testing.assert_array_equal(photo.pixels, wanted.pixels)
    assert opened.pose.camera == wanted.camera
    session = Session(opened)
    (name,) = export("overlay", session)
    assert name == "p.undistorted.overlay.png"
    (pose,) = export("pose", session).values()
    assert "distortion" in json.loads(pose)


def test_a_pose_of_an_undistorted_photo_brings_that_photo(
    scene: Scene, calibration: Calibration, tmp_path: Path
) -> None:
    first = open_files(scene.photo, scene.model, scene.start, calibration)
    wanted = first
    save_pose(tmp_path / "pose.json", pose_record(wanted.scene, 0, 0))
    plain = open_files(scene.photo, scene.model, scene.start)
    opened = open_pose(plain, tmp_path / "pose.json")
    photo = opened.photo
    np.testing.assert_array_equal(photo.pixels, wanted.photo.pixels)
    # Once more: the photo is that one already.
    again = open_pose(opened, tmp_path / "pose.json")
    assert again.photo is photo


def test_what_an_earlier_session_left_is_undistorted_again(
    scene: Scene, calibration: Calibration
) -> None:
    before = open_files(scene.photo, scene.model, scene.start, calibration)
    opened = open_autosaved(kept_of(before))
    now, then = opened, before
    np.testing.assert_array_equal(now.photo.pixels, then.photo.pixels)
    assert same_undistortion(now.photo.undistortion, then.photo.undistortion)
    assert_same_pose(now.pose, then.pose, 0.0)


def test_another_photo_is_shown_as_taken_and_said_so(
    scene: Scene, calibration: Calibration
) -> None:
    before = open_files(scene.photo, scene.model, scene.start, calibration)
    other = scene.photo.with_name("other.png")
    other.write_bytes(scene.photo.read_bytes())
    opened = open_photo(before, other)
    photo = opened.photo
    assert photo.undistortion is None
    np.testing.assert_array_equal(photo.pixels, load_photo(scene.photo).pixels)
    assert any("as taken" in warning for warning in opened.scene.notes)


def test_all_objects_of_a_session_come_back(scene: Scene, tmp_path: Path) -> None:
    other = write_obj(tmp_path, "wood.png")
    save_image(tmp_path / "wood.png", np.full((4, 4, 3), 90, np.uint8))
    added = add_object(load_model(other))
    session = Session(open_files(scene.photo, scene.model, scene.start))
    for command in (
        add_object(),
        nudge("move", 9.0),
        added,
        nudge("turn", 3.0),
        alter_object(2, hidden=True),
        alter_object(1, locked=True, name="ball"),
    ):
        session = update(session, command)
    result = SearchResult(Verdict("found", 0.9), 0.1, 0.1)
    session = replace(session, document=session.document.with_object(result=result))
    Autosaver(tmp_path / "state").close(session)
    (path,) = (tmp_path / "state" / "sessions").iterdir()
    kept = load_autosave(path)
    opened = open_autosaved(kept)
    before, after = session.document.scene, opened.scene
    assert opened.number == 3
    for index, (one, again) in enumerate(zip(before.objects, after.objects, strict=True)):
        for name in ("id", "name", "hidden", "locked"):
            assert getattr(one, name) == getattr(again, name)
        assert one.model.path == again.model.path
        assert_same_pose(before.pose(index), after.pose(index), 0.0)
    assert verdict_of(opened.object) == "found"
    assert after.objects[0].mesh is after.objects[1].mesh
    # An object whose model is gone is said, and the others open.
    first, *others = kept.scene.objects
    gone = structs.replace(first, model=structs.replace(first.model, file="gone.ply"))
    record = structs.replace(kept.scene, objects=(gone, *others))
    opened = open_autosaved(structs.replace(kept, scene=record))
    assert [one.id for one in opened.scene.objects] == ["2", "3"]
    assert any(warning.startswith("gone.ply: is not where") for warning in opened.scene.notes)


def test_another_photo_is_that_of_all_objects(scene: Scene) -> None:
    session = Session(open_files(scene.photo, scene.model, scene.start))
    session = update(update(session, add_object()), nudge("move", 9.0))
    other = scene.photo.with_name("other.png")
    other.write_bytes(scene.photo.read_bytes())
    document = open_photo(session.document, other)
    assert [verdict_of(one) for one in document.scene.objects] == ["not placed", "not placed"]
    # As they stood to each other.
    was, now = (
        one.scene.pose(1).camera_from_model.translation
        - one.scene.pose(0).camera_from_model.translation
        for one in (session.document, document)
    )
    np.testing.assert_allclose(was, now, atol=1e-9)


def test_a_camera_alone_is_for_the_photo_at_hand(scene: Scene, calibration: Calibration) -> None:
    before = open_files(scene.photo, scene.model, scene.start)
    opened = open_file_set(before, FileSet(camera=calibration.path), [])
    assert opened.photo.undistortion is not None
    assert opened.mesh is before.mesh
    centre = before.mesh.centre
    moved = opened.pose.project(centre) - before.pose.project(centre)
    np.testing.assert_allclose(moved, 0.0, atol=1e-6)


def test_photo_models_and_start_that_came_together_are_opened(scene: Scene) -> None:
    before = open_files(scene.photo, scene.model, None)
    files = sort_set([scene.photo, scene.model, scene.start, scene.photo.with_name("notes.txt")])
    opened = open_file_set(before, files, [scene.model])
    assert opened.object.is_placed
    assert opened.scene.notes[0] == "Not used: notes.txt."
    assert len(opened.scene.objects) == 1
    models = [scene.model] * 2
    opened = open_file_set(
        before, FileSet(models=tuple(model_files(m, []) for m in models)), models
    )
    paths = [one.model.path for one in opened.scene.objects]
    assert paths == models


def test_files_outside_of_a_dropped_folder_are_refused(tmp_path: Path) -> None:
    before = open_scene(make_three(tmp_path))
    inner = tmp_path / "dropped"
    inner.mkdir()
    data = json.loads((tmp_path / "three.scene.json").read_text())
    data["views"][0]["photo"]["file"] = "../three.png"
    (inner / "s.scene.json").write_text(json.dumps(data))
    files = FileSet(scene=inner / "s.scene.json")
    with pytest.raises(PoseFileError, match="outside of the folder that was dropped"):
        open_file_set(before, files, [], inside=inner)
