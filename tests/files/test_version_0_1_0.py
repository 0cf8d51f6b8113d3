"""Files that version 0.1.0 wrote (``tests/fixtures/v0_1_0``) still open, with what they said."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.batch.results import load_manifest, load_result
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.masks import mask_beside
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord, load_pose, set_frame
from poseviewer.files.scene import load_scene
from poseviewer.files.state.autosave import AutosavedSession, load_autosave
from poseviewer.files.symmetry import read_symmetry
from poseviewer.files.view_set import load_view_set, recorded_masks
from poseviewer.fit.settings import settings_from_json
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.frames import camera_as_integer_centres
from tests.meshes import make_bumpy

FIXTURES = Path(__file__).parents[1] / "fixtures" / "v0_1_0"
SIZES = {"paper_parallel": (960, 720), "in_set": (320, 240)}
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
    record = load_pose(path, *SIZES.get(name, (160, 120)))
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
    frame = set_frame(record)
    assert frame is not None
    assert frame.size == data["set"]["set_from_model"]["size"]
    assert [one.photo and one.photo.file for one in frame.others] == ["b.png", "c.png"]
    shutil.copy(FIXTURES / "views.json", tmp_path)
    for number, name in enumerate(("a.png", "b.png", "c.png")):
        save_image(tmp_path / name, np.full((240, 320, 3), 50 * number, np.uint8))
    views = load_view_set(tmp_path / "views.json")
    entries = json.loads((FIXTURES / "views.json").read_text())["views"]
    for view, entry in zip(views.views, entries, strict=True):
        assert view.name == entry["photo"]
        assert np.array_equal(
            view.camera_from_set.translation, entry["camera_from_set"]["translation"]
        )
    assert recorded_masks(FIXTURES / "in_set.pose.json", record, views) == {}


def test_a_scene_opens(tmp_path: Path) -> None:
    shutil.copy(FIXTURES / "three.scene.json", tmp_path)
    names = ("ball", "front", "apart")
    for name in ("three.png", *(f"{name}.ply" for name in names)):
        (tmp_path / name).write_text("it is only looked for\n")
    scene = load_scene(tmp_path / "three.scene.json")
    entries = json.loads((FIXTURES / "three.scene.json").read_text())["objects"]
    assert tuple(one.id for one in scene.objects) == names
    for one, entry in zip(scene.objects, entries, strict=True):
        transform = one.record.pose.camera_from_model
        assert np.array_equal(transform.rotation, entry["pose"]["camera_from_model"]["rotation"])
        assert one.record.verdict is not None
        assert one.record.verdict.word == entry["pose"]["verdict"]["word"]
    assert scene.objects[2].record.covariance is not None


def session(name: str) -> AutosavedSession:
    return load_autosave(FIXTURES / f"{name}.json")


@pytest.mark.parametrize("name", ["autosaved", "autosaved_candidates"])
def test_autosaved_sessions_open(name: str) -> None:
    kept = session(name)
    exact = json.loads((FIXTURES / f"{name}.json").read_text())["pose"]["exact"]
    assert kept.photo == Path("/photos/one/p.png")
    assert kept.model == Path("/photos/one/m.ply")
    assert np.array_equal(kept.pose.pose.camera_from_model.rotation, exact["rotation"])
    assert kept.pose.pose.camera.cx == exact["cx"]
    assert settings_from_json(kept.settings).method == "default"
    assert kept.mask is not None
    assert kept.mask.weights.shape == (120, 160)


def test_autosaved_sessions_of_several_objects_and_photos_open() -> None:
    kept = session("autosaved_three")
    assert sorted(one.model_name for one in (kept, *kept.others)) == [
        "apart.ply",
        "ball.ply",
        "front.ply",
    ]
    views = session("autosaved_set").views
    assert views is not None
    assert (views.path, views.left_out) == (Path("/photos/views/set.json"), ())


def test_symmetry_and_key_points_open() -> None:
    tube = make_bumpy(2)
    assert not read_symmetry(FIXTURES / "can.symmetry.json", tube).is_none
    keypoints = load_keypoints(FIXTURES / "car.glb", tube)
    data = json.loads((FIXTURES / "car.keypoints.json").read_text())
    assert keypoints is not None
    assert np.array_equal(keypoints.left.rear_wheel, data["left"]["rear_wheel"])


def test_a_batch_opens(tmp_path: Path) -> None:
    shutil.copytree(FIXTURES / "batch", tmp_path / "batch")
    manifest = load_manifest(tmp_path / "batch")
    (job,) = manifest.jobs
    assert manifest.settings.colour_reflectance
    (tmp_path / "batch" / "pictures").mkdir()
    (tmp_path / "batch" / "pictures" / f"p-{job.key}.jpg").touch()
    result = load_result(tmp_path / "batch", job.key)
    assert result is not None
    assert (result.verdict, result.photo, result.evaluations) == ("lost", "p.png", 100)
    assert load_pose(tmp_path / "batch" / result.pose, 160, 120).settings is not None
