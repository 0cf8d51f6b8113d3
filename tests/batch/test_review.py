"""A BOP scene in, fitted, reviewed, and out again."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.batch import review
from poseviewer.batch.result_folder import ACCEPTED, worst_first
from poseviewer.batch.run import open_batch, save_summaries
from poseviewer.errors import PoseViewerError
from poseviewer.files.formats.bop import BopObject, read_bop
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.pose import load_pose
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.settings import FitSettings, Limits
from tests.batches import fit_all
from tests.commands import read_rows
from tests.scene import Scene
from tests.several import write_bop_scene

QUICK = FitSettings(limits=Limits(40, 600.0))
IMAGES: tuple[int, ...] = (0, 3, 12)


def make_bop(scene: Scene, folder: Path) -> tuple[Path, Path]:
    """A scene of one object in three images, and its models."""
    models, start = folder / "models", load_pose(scene.start, 160, 120).pose
    assert isinstance(start.camera, Perspective)
    models.mkdir()
    shutil.copy(scene.model, models / "obj_000005.ply")
    objects = [BopObject(5, start.camera_from_model)]
    photos, poses = dict.fromkeys(IMAGES, scene.photo), dict.fromkeys(IMAGES, objects)
    return write_bop_scene(folder / "000001", start.camera, photos, poses), models


@pytest.fixture(scope="module")
def fitted(scene, tmp_path_factory) -> tuple[Path, Path]:
    """A scene, and the folder of results of a batch on it."""
    folder = tmp_path_factory.mktemp("bop")
    bop, models = make_bop(scene, folder)
    fit_all(open_batch(bop, folder / "out", QUICK, models=models))
    return bop, folder / "out"


@pytest.fixture
def out(fitted, tmp_path) -> Path:
    return Path(shutil.copytree(fitted[1], tmp_path / "out"))


def test_a_bop_scene_comes_out_as_one(fitted):
    bop, out = fitted
    given = json.loads((bop / "scene_camera.json").read_text())
    assert json.loads((out / "scene_camera.json").read_text()) == given
    poses = json.loads((out / "scene_gt.json").read_text())
    assert list(poses) == [str(number) for number in IMAGES]
    rows = read_rows(out / "results.csv")
    for number, row in zip(IMAGES, rows, strict=True):
        assert row["photo"] == f"rgb/{number:06d}.png"
        (entry,) = poses[str(number)]  # the published layout: row-major, mm
        assert set(entry) == {"cam_R_m2c", "cam_t_m2c", "obj_id"}
        assert entry["obj_id"] == 5
        own = load_pose(out / row["pose"], 160, 120).pose
        request = ConvertOptions(image=str(number), photo_size=(160, 120))
        read = read_bop(out, request).pose(0)
        for place in (own.camera_from_model, read.camera_from_model):
            np.testing.assert_allclose(place.rotation.ravel(), entry["cam_R_m2c"], atol=1e-9)
            np.testing.assert_allclose(place.translation, entry["cam_t_m2c"], rtol=1e-9)
        assert np.allclose([own.camera.cx, own.camera.cy], [read.camera.cx, read.camera.cy])


def test_accept_mend_and_note_are_kept_and_read_again(out):
    queue = review.load_queue(out)
    first, second, third = queue.rows
    assert [r.job.row for r in queue.rows] == [r.job.row for r in worst_first(queue.rows)]
    review.decide(queue, 0, ACCEPTED)
    review.annotate(queue, 1, " blurred,\n half <b>hidden ")
    record = load_pose(out / third.result.pose, 160, 120)
    place = record.pose.camera_from_model
    moved = RigidTransform(place.rotation, place.translation + np.array([0.25, 0.0, 0.5]))
    mended = record.with_pose(replace(record.pose, camera_from_model=moved), loss=None)
    before = (out / third.result.pose).read_bytes()
    queue = review.save_corrected(queue, 2, mended, np.zeros((12, 16, 3), np.uint8))
    save_summaries(review.load_queue(out).batch)
    again = review.load_queue(out)
    assert again.rows[0].job == second.job  # those reviewed are last
    rows = {row["row"]: row for row in read_rows(out / "results.csv")}
    decided = [rows[str(r.job.row)]["review"] for r in (first, second, third)]
    assert decided == ["accepted", "", "mended"]
    assert rows[str(second.job.row)]["note"] == "blurred, half <b>hidden"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "2 accepted and 0 rejected by a person" in page
    assert "<q>blurred, half &lt;b&gt;hidden</q>" in page
    kept = out / third.result.pose.replace(".json", ".fitted.json")
    assert kept.read_bytes() == before
    image = str(int(Path(third.job.photo).stem))
    read = read_bop(out, ConvertOptions(image=image, photo_size=(160, 120)))
    np.testing.assert_allclose(read.pose(0).camera_from_model.translation, moved.translation)
    assert review.decide(queue, 2, ACCEPTED).rows[2].result.review == "mended"


def test_results_of_someone_else_are_written_inside_their_folder_alone(out, tmp_path):
    data = json.loads((out / "batch.json").read_text())
    first = next((out / "rows").iterdir())
    (tmp_path / "mine.json").write_bytes(first.read_bytes())
    for key in ("../../mine", str(tmp_path / "mine")):
        for job in data["jobs"]:
            job["key"] = key
        (out / "batch.json").write_text(json.dumps(data))
        with pytest.raises(PoseViewerError, match=r"batch\.json: cannot be used"):
            review.annotate(review.load_queue(out), 0, "a note")
    data["jobs"][0]["key"] = "link"
    (out / "batch.json").write_text(json.dumps(data | {"jobs": data["jobs"][:1]}))
    (out / "rows" / "link.json").symlink_to(tmp_path / "mine.json")
    with pytest.raises(PoseViewerError, match="is a link and was not written through"):
        review.annotate(review.load_queue(out), 0, "a note")
    assert (tmp_path / "mine.json").read_bytes() == first.read_bytes()
    (out / "poses").rename(tmp_path / "private")
    (out / "poses").symlink_to(tmp_path / "private")
    with pytest.raises(PoseViewerError, match=r"poses: is a link, through which nothing is"):
        review.load_queue(out)


def test_a_batch_run_again_keeps_what_was_reviewed(out, fitted):
    queue, bop = review.load_queue(out), fitted[0]
    batch = open_batch(bop, out, QUICK, models=bop.parent / "models")
    review.decide(queue, 0, ACCEPTED)  # while the batch is open
    save_summaries(replace(batch, jobs=queue.batch.jobs))
    assert sum(row["review"] == "accepted" for row in read_rows(out / "results.csv")) == 1


def test_a_pose_by_another_camera_is_refused_for_a_scene(out):
    queue = review.load_queue(out)
    row = queue.rows[0]
    record = load_pose(out / row.result.pose, 160, 120)
    other = replace(record.pose, camera=Perspective(400.0, 300.0, 83.0, 58.0, 160, 120))
    with pytest.raises(PoseViewerError, match="not the BOP scene's"):
        review.save_corrected(queue, 0, record.with_pose(other), np.zeros((2, 2, 3), np.uint8))
    assert not any(row.result.review for row in review.load_queue(out).rows)


def test_a_scene_that_lacks_something_is_said(scene, tmp_path):
    bop, models = make_bop(scene, tmp_path)
    for folder, words in {None: "of its models", bop / "o": "no such folder"}.items():
        with pytest.raises(PoseViewerError, match=words):
            open_batch(bop, tmp_path / "out", QUICK, models=folder)
    (bop / "scene_gt.json").unlink()
    with pytest.raises(PoseViewerError, match=r"no scene_gt\.json in it"):
        open_batch(bop, tmp_path / "out", QUICK, models=models)
