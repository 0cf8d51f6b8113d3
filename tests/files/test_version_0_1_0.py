"""Files that version 0.1.0 wrote (``tests/fixtures/v0_1_0``) still open, with what they said."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.batch.results import load_batch, load_result
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.masks import mask_beside
from poseviewer.files.photo import save_image
from poseviewer.files.photo_sets import load_views
from poseviewer.files.pose import PoseRecord, load_pose
from poseviewer.files.scene_file import load_scene, mask_in, scene_of_pose
from poseviewer.files.state.autosave import AutosavedSession, load_autosave
from poseviewer.files.symmetry import read_symmetry
from poseviewer.files.writing import sha256_of
from poseviewer.fit.settings import settings_from_json
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.frames import camera_as_integer_centres
from tests.meshes import make_bumpy
from tests.view_sets import write_views

FIXTURES = Path(__file__).parents[1] / "fixtures" / "v0_1_0"
VERDICTS = {
    "default": "found",
    "free_focal": "doubtful",
    "masked": "doubtful",
    "undistorted": "found",
    "paper_parallel": "lost",
    "in_set": "lost",
}


def opened(name: str) -> tuple[PoseRecord, dict[str, Any]]:
    """The pose as today's reader has it, and the file's JSON."""
    path = FIXTURES / f"{name}.pose.json"
    record = load_pose(path)
    assert record.warnings == ()
    return record, json.loads(path.read_text())


@pytest.mark.parametrize("name", VERDICTS)
def test_pose_files_open(name: str) -> None:
    record, data = opened(name)
    transform = record.pose.camera_from_model
    assert np.array_equal(transform.rotation, data["camera_from_model"]["rotation"])
    assert np.array_equal(transform.translation, data["camera_from_model"]["translation"])
    camera = camera_as_integer_centres(record.pose.camera)
    assert {key: getattr(camera, key) for key in data["camera"]} == data["camera"]
    assert record.verdict is not None
    assert (record.verdict.word, record.verdict.probability) == (
        VERDICTS[name],
        data["verdict"]["probability"],
    )
    assert record.verdict.reasons
    assert (record.loss, record.unexplained, record.seen) == (
        data["loss"],
        data["unexplained"],
        data["seen"],
    )
    assert record.chart is not None
    assert list(record.chart.parameters) == data["chart"]["numbers"]
    assert record.photo is not None
    assert record.photo.sha256 == data["photo"]["sha256"]
    assert record.model is not None
    assert record.model.file == data["model"]["file"]


def test_settings_of_pose_files_open() -> None:
    record, _ = opened("default")
    settings = settings_from_json(record.settings or {})
    assert (settings.method, settings.chart) == ("default", "auto")
    assert settings.limits.evaluations == 300
    record, _ = opened("free_focal")
    assert settings_from_json(record.settings or {}).free_focal
    record, _ = opened("paper_parallel")
    settings = settings_from_json(record.settings or {})
    assert (settings.method, settings.pixels, settings.grey) == ("paper", "clip", True)
    assert (settings.options.multi_starts, settings.options.step) == (6, 0.04)


def test_what_pose_files_say_beside_the_pose_opens() -> None:
    record, data = opened("free_focal")
    assert isinstance(record.pose.camera, Perspective)
    assert record.covariance is not None
    assert np.array_equal(record.covariance.matrix, data["uncertainty"]["covariance"])
    assert record.covariance.matrix.shape == (7, 7)
    record, _ = opened("paper_parallel")
    assert isinstance(record.pose.camera, Parallel)
    record, data = opened("undistorted")
    assert record.undistortion is not None
    assert list(record.undistortion.lens.coefficients) == data["distortion"]["coefficients"]
    record, _ = opened("masked")
    mask, notes = mask_beside(FIXTURES / "masked.pose.json", record, 160, 120)
    assert notes == ()
    assert mask is not None
    assert not mask.weights[:, :70].any()
    assert mask.weights[:, 75:].mean() > 0.9


def test_a_pose_in_a_set_of_photos_opens(tmp_path: Path) -> None:
    record, data = opened("in_set")
    scene = scene_of_pose(tmp_path / "in_set.pose.json", record)
    assert scene.objects[0].place.scale == data["set"]["set_from_model"]["size"]
    for view, entry in enumerate(data["set"]["views"]):
        pose, wanted = scene.pose(0, view), entry["camera_from_model"]
        assert scene.views[view].path == tmp_path / entry["photo"]["file"]
        assert pose.camera == record.pose.camera
        np.testing.assert_allclose(pose.camera_from_model.rotation, wanted["rotation"], atol=1e-12)
        moved = pose.camera_from_model.translation
        np.testing.assert_allclose(moved, wanted["translation"], rtol=1e-12)


def test_a_set_of_photos_opens(tmp_path: Path) -> None:
    shutil.copy(FIXTURES / "views.json", tmp_path)
    for number, name in enumerate(("a.png", "b.png", "c.png")):
        save_image(tmp_path / name, np.full((240, 320, 3), 50 * number, np.uint8))
    views = load_views(tmp_path / "views.json")
    entries = json.loads((FIXTURES / "views.json").read_text())["views"]
    for view, entry in zip(views.views, entries, strict=True):
        assert view.name == entry["photo"]
        assert np.array_equal(
            view.camera_from_world.translation, entry["camera_from_set"]["translation"]
        )


def test_a_scene_opens(tmp_path: Path) -> None:
    shutil.copy(FIXTURES / "three.scene.json", tmp_path)
    names = ("ball", "front", "apart")
    for name in ("three.png", *(f"{name}.ply" for name in names)):
        (tmp_path / name).write_text("it is only looked for\n")
    scene = load_scene(tmp_path / "three.scene.json")
    entries = json.loads((FIXTURES / "three.scene.json").read_text())["objects"]
    assert tuple(one.id for one in scene.objects) == names
    for index, entry in enumerate(entries):
        record = scene.pose_record(index)
        transform = record.pose.camera_from_model
        assert np.array_equal(transform.rotation, entry["pose"]["camera_from_model"]["rotation"])
        assert record.verdict is not None
        assert record.verdict.word == entry["pose"]["verdict"]["word"]
    assert scene.pose_record(2).covariance is not None


def session(name: str) -> AutosavedSession:
    return load_autosave(FIXTURES / f"{name}.json")


@pytest.mark.parametrize("name", ["autosaved", "autosaved_candidates"])
def test_autosaved_sessions_open(name: str) -> None:
    kept = session(name)
    data = json.loads((FIXTURES / f"{name}.json").read_text())
    (view,), (one,), pose = kept.scene.views, kept.scene.objects, kept.scene.pose(0)
    assert view.path == Path("/photos/one/p.png")
    assert one.path == Path("/photos/one/m.ply")
    assert np.array_equal(pose.camera_from_model.rotation, data["pose"]["exact"]["rotation"])
    assert pose.camera.cx == data["pose"]["exact"]["cx"]
    assert one.start is not None
    assert np.array_equal(one.start.rotation, data["start"]["exact"]["rotation"])
    assert settings_from_json(one.settings or {}).method == "default"
    (own,) = one.in_views
    assert own.mask is not None
    assert mask_in(own.mask).weights.shape == (120, 160)


def test_autosaved_sessions_of_several_objects_and_photos_open(tmp_path: Path) -> None:
    kept = session("autosaved_three")
    names = sorted(one.path.name for one in kept.scene.objects)
    assert names == ["apart.ply", "ball.ply", "front.ply"]
    assert kept.active_object in [one.id for one in kept.scene.objects]
    views, model, _ = write_views(tmp_path)
    data = json.loads((FIXTURES / "autosaved_set.json").read_text())
    data["views"].update(path=str(views), left_out=["c.png"])
    data["photo_sha256"] = sha256_of(tmp_path / "b.png")
    (tmp_path / "session.json").write_text(json.dumps(data | {"model": str(model)}))
    kept = load_autosave(tmp_path / "session.json")
    assert kept.photo_names == ("a.png", "b.png", "c.png")
    assert (kept.active_view, kept.scene.free_scale) == (1, data["views"]["free_size"])
    (one,), pose = kept.scene.objects, kept.scene.pose(0, 1)
    assert [own.is_compared for own in one.in_views] == [True, True, False]
    exact = data["pose"]["exact"]["rotation"]
    np.testing.assert_allclose(pose.camera_from_model.rotation, exact, atol=1e-12)
    wanted = data["pose"]["file"]["camera_from_model"]["translation"]
    np.testing.assert_allclose(pose.camera_from_model.translation, wanted, atol=1e-9)


def test_symmetry_and_key_points_open() -> None:
    tube = make_bumpy(2)
    assert not read_symmetry(FIXTURES / "can.symmetry.json", tube).is_none
    keypoints = load_keypoints(FIXTURES / "car.glb", tube)
    data = json.loads((FIXTURES / "car.keypoints.json").read_text())
    assert keypoints is not None
    assert np.array_equal(keypoints.left.rear_wheel, data["left"]["rear_wheel"])


def test_a_batch_opens(tmp_path: Path) -> None:
    shutil.copytree(FIXTURES / "batch", tmp_path / "batch")
    batch = load_batch(tmp_path / "batch")
    (job,) = batch.jobs
    assert batch.settings.colour_reflectance
    (tmp_path / "batch" / "pictures").mkdir()
    (tmp_path / "batch" / "pictures" / f"p-{job.key}.jpg").touch()
    result = load_result(tmp_path / "batch", job.key)
    assert result is not None
    assert (result.verdict, result.evaluations) == ("lost", 100)
    assert load_pose(tmp_path / "batch" / result.pose, 160, 120).settings is not None
