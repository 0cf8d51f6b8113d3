"""What the app opens with a calibration, with a pose of an undistorted photo, and again."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state.document import Document, verdict_of
from poseviewer.app.state.objects import add_object, alter_object
from poseviewer.app.state.pose_edits import nudge
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.opening import open_autosaved, open_file_set, open_photo, open_pose
from poseviewer.app.workers.saving import Autosaver, make_autosave
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import CalibrationFileError, PoseFileError
from poseviewer.files.cameras import Calibration
from poseviewer.files.photo import load_calibrated_photo, save_image
from poseviewer.files.pose import save_pose
from poseviewer.files.scene_assets import load_model
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.files.state.session_file import load_autosave
from poseviewer.geometry.lens import same_undistortion
from poseviewer.opening.sources import Sources, model_files, sort_set
from poseviewer.scene.types import OBJECT_TEXTS, SearchResult
from tests.app.state.documents import after as edited
from tests.app.state.documents import assert_same_pose, open_files
from tests.scene import Scene
from tests.several import make_three
from tests.textured import write_obj
from tests.writing import write


@pytest.fixture
def calibration(tmp_path: Path) -> Calibration:
    matrix = [[300.0, 0.0, 82.5], [0.0, 300.0, 57.5], [0.0, 0.0, 1.0]]
    content = {"camera_matrix": matrix, "dist_coeffs": [-0.9, 0, 0, 0, 0], "image_size": [160, 120]}
    return Calibration(write(tmp_path / "camera.json", content))


@pytest.fixture
def plain(scene: Scene) -> Document:
    return open_files(scene.photo, scene.model, scene.start)


@pytest.fixture
def undistorted(scene: Scene, calibration: Calibration) -> Document:
    return open_files(scene.photo, scene.model, scene.start, calibration)


def test_frames_that_are_dropped_are_a_sequence_of_the_open_model(scene, plain, calibration):
    folder = calibration.path.parent
    names = [folder / f"{number}.png" for number in (1, 2)]
    for name in names:
        name.write_bytes(scene.photo.read_bytes())
    opened = open_file_set(plain, sort_set([*names, calibration.path]), [])
    assert [frame.file.name for frame in opened.scene.frames] == ["1.png", "2.png"]
    assert opened.model.path == scene.model
    assert not opened.object.is_placed
    assert opened.photo.undistortion is not None
    restored = open_autosaved(replace(make_autosave(opened), notes=("A change is lost.",)))
    assert [frame.file.path for frame in restored.scene.frames] == names
    assert "A change is lost." in restored.scene.notes


def test_an_undistorted_photo_stays_so_in_files_and_sessions(
    scene: Scene, calibration: Calibration, plain: Document, undistorted: Document, tmp_path: Path
) -> None:
    wanted = load_calibrated_photo(scene.photo, calibration)
    assert not np.array_equal(wanted.pixels, plain.photo.pixels)
    corner = open_files(scene.photo, scene.model, None, calibration)
    assert {wanted.camera} == {corner.pose.camera, undistorted.pose.camera}
    (name,) = export("overlay", Session(undistorted))
    assert name == "p.m.undistorted.overlay.png"
    save_pose(tmp_path / "pose.json", pose_json(as_saved(undistorted.scene), 0, 0))
    posed = open_pose(plain, tmp_path / "pose.json")  # it brings that photo
    assert open_pose(posed, tmp_path / "pose.json").photo is posed.photo
    restored = open_autosaved(make_autosave(undistorted))
    assert same_undistortion(restored.photo.undistortion, undistorted.photo.undistortion)
    assert_same_pose(restored.pose, undistorted.pose, 0.0)
    for document in (corner, undistorted, posed, restored):
        np.testing.assert_array_equal(document.photo.pixels, wanted.pixels)


def test_texts_of_the_user_are_kept_unless_a_pose_file_has_others(plain, tmp_path):
    path, texts = tmp_path / "pose.json", {name: f"own {name}" for name in OBJECT_TEXTS}
    assert texts
    written = plain.with_object(**texts)
    assert written.placement != plain.placement  # it is unsaved
    save_pose(path, pose_json(as_saved(written.scene)))
    assert open_pose(plain, path).object.texts == texts
    save_pose(path, pose_json(as_saved(plain.scene)))
    assert open_pose(written, path).object.texts == texts


def test_all_objects_of_a_session_come_back(plain: Document, tmp_path: Path) -> None:
    other = write_obj(tmp_path, "wood.png")
    save_image(tmp_path / "wood.png", np.full((4, 4, 3), 90, np.uint8))
    added = add_object(load_model(other))
    others = add_object(), nudge("move", 9.0), added, nudge("turn", 3.0)
    changes = alter_object(2, hidden=True), alter_object(1, locked=True, name="ball")
    session = edited(Session(plain), *others, *changes)
    result = SearchResult(verdict=Verdict("found", 0.9), loss=0.1, unexplained=0.1)
    session = replace(session, document=session.document.with_object(result=result))
    Autosaver(tmp_path / "state").close(session)
    (path,) = (tmp_path / "state" / "sessions").iterdir()
    kept = load_autosave(path)
    opened = open_autosaved(kept)
    before, after = session.document.scene, opened.scene
    assert opened.object_id == 3
    for index, (one, again) in enumerate(zip(before.objects, after.objects, strict=True)):
        for name in ("id", "name", "hidden", "locked"):
            assert getattr(one, name) == getattr(again, name)
        assert one.model.path == again.model.path
        assert_same_pose(before.pose(index), after.pose(index), 0.0)
    assert verdict_of(opened.object) == "found"
    assert after.objects[0].mesh is after.objects[1].mesh
    # An object whose model is gone is said, and the others open.
    first, *others = kept.scene.objects
    gone = replace(first, model=replace(first.model, path=Path("gone.ply")))
    opened = open_autosaved(replace(kept, scene=replace(kept.scene, objects=(gone, *others))))
    assert [one.id for one in opened.scene.objects] == ["2", "3"]
    assert any(warning.startswith("gone.ply: is not where") for warning in opened.scene.notes)


def test_another_photo_is_that_of_all_objects(scene: Scene, undistorted: Document) -> None:
    session = edited(Session(undistorted), add_object(), nudge("move", 9.0))
    other = scene.photo.with_name("other.png")
    other.write_bytes(scene.photo.read_bytes())
    document = open_photo(session.document, other)
    assert document.photo.undistortion is None
    assert any("as taken" in note for note in document.scene.notes)
    assert [verdict_of(one) for one in document.scene.objects] == ["not placed", "not placed"]
    # As they stood to each other.
    was, now = (
        one.scene.pose(1).camera_from_model.translation
        - one.scene.pose(0).camera_from_model.translation
        for one in (session.document, document)
    )
    np.testing.assert_allclose(was, now, atol=1e-9)


def test_a_camera_alone_is_for_the_photo_at_hand(plain: Document, calibration: Calibration) -> None:
    opened = open_file_set(plain, Sources(calibration=calibration), [])
    assert opened.photo.undistortion is not None
    assert opened.mesh is plain.mesh
    seen, before = (one.pose.project(plain.mesh.centre) for one in (opened, plain))
    np.testing.assert_allclose(seen, before, atol=1e-6)
    assert opened.scene.notes[-1] == (
        "camera.json: the photo's camera was read from camera_matrix, image_size, dist_coeffs (as "
        "OpenCV, ROS, BOP, Open3D, NumPy); the pose was found by another camera: search again."
    )


def test_a_lens_of_no_said_model_is_opened_by_that_of_the_page(
    plain: Document, tmp_path: Path
) -> None:
    camera = {"camera_matrix": [[300, 0, 80], [0, 300, 60], [0, 0, 1]], "D": [0.1, 0.02, 0.01, 0]}
    files = sort_set([write(tmp_path / "camera.json", camera)])
    with pytest.raises(CalibrationFileError, match=r"with `Calibration\.lens_model`"):
        open_file_set(plain, files, [])
    undone = open_file_set(plain, files, [], lens_model="fisheye").photo.undistortion
    assert undone is not None
    assert undone.lens.model == "fisheye"


def test_photo_models_and_start_that_came_together_are_opened(scene: Scene) -> None:
    before = open_files(scene.photo, scene.model, None)
    files = sort_set([scene.photo, scene.model, scene.start, scene.photo.with_name("notes.txt")])
    opened = open_file_set(before, files, [scene.model])
    assert opened.object.is_placed
    assert opened.scene.notes[0] == "Not used: notes.txt."
    assert len(opened.scene.objects) == 1
    models = [scene.model] * 2
    of_models = Sources(models=tuple(model_files(model, []) for model in models))
    opened = open_file_set(before, of_models, models)
    assert [one.model.path for one in opened.scene.objects] == models


def test_files_outside_of_a_dropped_folder_are_refused(plain: Document, tmp_path: Path) -> None:
    data = json.loads(make_three(tmp_path).read_text())
    data["views"][0]["photo"]["file"] = "../three.png"
    inner = write(tmp_path / "dropped" / "s.scene.json", data)
    with pytest.raises(PoseFileError, match="outside of the folder that was dropped"):
        open_file_set(plain, Sources(scene=inner), [], inside=inner.parent)
