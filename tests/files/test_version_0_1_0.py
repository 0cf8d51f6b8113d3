"""Files that version 0.1.0 wrote (``tests/fixtures/v0_1_0``) still open, with what they said."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from poseviewer.batch.results import load_batch, load_result
from poseviewer.files.keypoints import load_keypoints
from poseviewer.files.masks import load_mask, mask_beside
from poseviewer.files.photo import save_image
from poseviewer.files.photo_sets import load_views
from poseviewer.files.pose import load_pose, pose_bytes
from poseviewer.files.scene_file import load_scene, scene_of_pose
from poseviewer.files.state.autosave import AutosavedSession, load_autosave
from poseviewer.files.symmetry import load_symmetry
from poseviewer.files.writing import sha256_of
from poseviewer.fit.settings import settings_from_json
from poseviewer.geometry.frames import camera_as_integer_centres
from tests.meshes import make_bumpy
from tests.view_sets import write_views

FIXTURES = Path(__file__).parents[1] / "fixtures" / "v0_1_0"
NAMES = ("default", "free_focal", "masked", "undistorted", "paper_parallel")


@pytest.mark.parametrize("name", NAMES)
def test_pose_files_open(name: str) -> None:
    path = FIXTURES / f"{name}.pose.json"
    record, data = load_pose(path), json.loads(path.read_text())
    assert json.loads(pose_bytes(path, record)) == data
    assert record.warnings == ()
    transform, camera = record.pose.camera_from_model, camera_as_integer_centres(record.pose.camera)
    assert np.array_equal(transform.rotation, data["camera_from_model"]["rotation"])
    assert {key: getattr(camera, key) for key in data["camera"]} == data["camera"]
    lens, sure = record.undistortion, record.covariance
    assert (lens is None, sure is None) == ("distortion" not in data, "uncertainty" not in data)
    settings = settings_from_json(record.settings or {})
    assert settings.free_focal == (name == "free_focal")
    if name == "paper_parallel":
        assert (settings.loss, settings.pixels, settings.grey) == ("paper", "clip", True)
        assert settings.searched_by == "simplex"
        assert (settings.options.multi_starts, settings.options.step) == (6, 0.04)
    if name == "masked":
        mask, notes = mask_beside(path, record, 160, 120)
        assert notes == ()
        assert mask is not None
        assert not mask.weights[:, :70].any()
        assert mask.weights[:, 75:].mean() > 0.9


def test_a_pose_in_a_set_of_photos_opens(tmp_path: Path) -> None:
    record = load_pose(FIXTURES / "in_set.pose.json")
    data = json.loads((FIXTURES / "in_set.pose.json").read_text())
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
    data = json.loads((FIXTURES / "three.scene.json").read_text())
    assert tuple(one.id for one in scene.objects) == names
    for index, entry in enumerate(data["objects"]):
        written = json.loads(pose_bytes(tmp_path, scene.pose_record(index)))
        assert {key: written[key] for key in entry["pose"]} == entry["pose"]


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
    load_mask(own.mask, 160, 120)


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
    assert not load_symmetry(FIXTURES / "can.ply", tube).is_none
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
