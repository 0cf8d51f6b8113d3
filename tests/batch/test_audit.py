"""An audit of given poses: one that is shifted by hand is listed first, exact ones are not."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from poseviewer.api import load
from poseviewer.app.page.rows import row_text, rows_list
from poseviewer.app.reviewing import Reviewer
from poseviewer.batch import review
from poseviewer.batch.audit import (
    BEHIND,
    HIDDEN,
    MIN_MOVED_DEVIATIONS,
    audit_numbers,
    find_finding,
    name_doubted,
)
from poseviewer.batch.job_table import Job
from poseviewer.batch.result_folder import (
    ACCEPTED,
    MOVED,
    REJECTED,
    Batch,
    JobResult,
    Row,
    save_result,
    worst_first,
)
from poseviewer.batch.run import open_batch, run_batch, save_summaries
from poseviewer.errors import EXIT_MENDABLE, BatchError, PoseViewerError
from poseviewer.files.formats.bop import BopObject
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_assets import model_file
from poseviewer.files.scene_json import as_saved, load_scene, save_scene
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import SceneObject
from tests.batches import fit_all, write_table
from tests.commands import read_rows, refusal, run
from tests.files.test_scene_frames import sequence
from tests.scene import Scene
from tests.several import make_three, write_bop_scene
from tests.view_sets import BOX_TRUTH, NAMES, TRUTH, write_two
from tests.writing import write

SHIFT = np.array([0.12, 0.08, 0.0])
"""Of a given pose, in the model's unit: 6 px of an object of 85 px."""
QUICK = FitSettings(limits=Limits(40, 600.0))
SURE = 2.0 * MIN_MOVED_DEVIATIONS


@pytest.fixture(scope="module")
def audited(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a BOP scene, whose one image has a shifted pose beside the true one, its
    models, and the folder ``audit`` of the results.
    """
    folder = tmp_path_factory.mktemp("audit")
    (folder / "models").mkdir()
    shutil.copy(scene.model, folder / "models/obj_000005.ply")
    pose = load_pose(scene.truth, 160, 120).pose
    true, camera = pose.camera_from_model, pose.camera
    assert isinstance(camera, Perspective)
    off = replace(true, translation=true.translation + SHIFT)
    poses = {0: [true], 3: [true, off]}
    objects = {image: [BopObject(5, place) for place in of] for image, of in poses.items()}
    bop = write_bop_scene(folder / "000001", camera, dict.fromkeys(poses, scene.photo), objects)
    fit_all(
        open_batch(bop, folder / "audit", FitSettings(), models=folder / "models", is_audit=True)
    )
    return folder


@pytest.fixture
def out(audited: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(audited / "audit", tmp_path / "audit"))


def scene_gt(folder: Path) -> dict[str, list[dict]]:
    return json.loads((folder / "scene_gt.json").read_text())


@pytest.mark.slow
@pytest.mark.long
def test_a_shifted_pose_alone_is_listed_first(audited: Path) -> None:
    rows = review.load_queue(audited / "audit").rows
    assert [row.result.finding for row in rows] == ["moved", "", ""]
    first, *others = (row.result for row in rows)
    assert rows[0].job.row == 3
    assert first.verdict == "found"
    assert first.moved_px == pytest.approx(6.0, abs=1.0)
    assert (first.moved_deviations or 0.0) > MIN_MOVED_DEVIATIONS
    assert [one.given_verdict for one in others] == ["found", "found"]
    assert max(one.moved_px or 0.0 for one in others) < 0.5
    (row,) = (row for row in read_rows(audited / "audit/results.csv") if row["finding"])
    assert float(row["moved_percent"]) == (first.moved_percent or 0.0) > 5.0
    page = (audited / "audit/report.html").read_text(encoding="utf-8")
    assert "given poses: 1 moved, 0 unexplained" in page
    assert page.index('<td class="number">3</td>') < page.index('<td class="number">1</td>')


@pytest.mark.slow
def test_the_picture_has_photo_given_and_found_outline(audited: Path) -> None:
    result = review.load_queue(audited / "audit").rows[0].result
    photo, given, found = np.split(
        np.asarray(cv2.imread(str(audited / "audit" / result.picture))), 3, axis=1
    )
    cyan = [np.argwhere(one[..., 0].astype(int) - one[..., 2] > 120) for one in (given, found)]
    assert not (photo[..., 0].astype(int) - photo[..., 2] > 120).any()
    magnified = 6.0 * photo.shape[1] / 120.0  # at least: the picture shows a part of the photo
    apart = cyan[0].mean(axis=0) - cyan[1].mean(axis=0)
    assert np.hypot(*apart) > 0.8 * magnified


@pytest.mark.slow
def test_accepted_poses_alone_change_the_scene(audited: Path, out: Path) -> None:
    given = scene_gt(audited / "000001")
    assert scene_gt(out) == given
    queue = review.decide(review.load_queue(out), 0, ACCEPTED)
    queue = review.decide(queue, 1, REJECTED)
    save_summaries(queue.batch)
    assert [row.result.review for row in queue.rows[:2]] == ["accepted", "kept"]
    corrected = scene_gt(out)
    true, new = corrected["3"]
    assert true == given["3"][0]
    np.testing.assert_allclose(new["cam_t_m2c"][:2], true["cam_t_m2c"][:2], atol=0.02)
    assert {**corrected, "3": given["3"]} == given
    assert "1 accepted and 1 kept by a person" in (out / "report.html").read_text("utf-8")
    review.decide(queue, 0, REJECTED)
    save_summaries(queue.batch)
    assert scene_gt(out) == given


@pytest.mark.slow
def test_review_keeps_or_accepts_and_shows_the_given_pose(out: Path) -> None:
    reviewer = Reviewer(out)
    document, row = reviewer.open_first(), reviewer.queue.rows[0]
    given = load_pose(row.job.path(row.job.start), 160, 120).pose.camera_from_model
    np.testing.assert_allclose(
        document.at_start.pose.camera_from_model.translation, given.translation
    )
    away = document.pose.camera_from_model.translation - given.translation
    np.testing.assert_allclose(away[:2], -SHIFT[:2], atol=0.02)
    assert "from the given pose, whose verdict is" in row_text(row, False)
    reviewer.queue = review.decide(reviewer.queue, 0, REJECTED)
    assert "3 rows, 0 accepted, 1 kept" in rows_list(reviewer.queue, 0)
    reviewer.close()
    assert {row["review"] for row in read_rows(out / "results.csv")} == {"", "kept"}


@pytest.mark.slow
@pytest.mark.long
def test_an_audit_goes_on_where_it_was(audited: Path, capsys) -> None:
    out = audited / "audit"
    first, *others = sorted((out / "rows").glob("audit-*.json"))
    before, done = first.read_bytes(), [path.stat().st_mtime_ns for path in others]
    first.unlink()
    line = ("audit", audited / "000001", "--models", audited / "models", "--out", out)
    assert run(*line, "--processes", 1) == 0
    printed = capsys.readouterr()
    assert "2 of 3 rows were done before" in printed.err
    assert "given poses: 1 moved, 0 unexplained" in printed.out
    assert [path.stat().st_mtime_ns for path in others] == done
    again, old = json.loads(first.read_bytes()), json.loads(before)
    for name in ("status", "verdict", "finding", "pose"):
        assert again[name] == old[name]
    assert again["moved_px"] == pytest.approx(old["moved_px"], abs=0.01)


@pytest.fixture
def blurs(tmp_path: Path) -> Path:
    """A photo of blurs, in which no model is to be seen."""
    noise = np.random.default_rng(3).normal(120.0, 120.0, (120, 160, 3))
    cv2.imwrite(str(tmp_path / "blurs.png"), cv2.GaussianBlur(noise, (0, 0), 3.0))
    return tmp_path / "blurs.png"


@pytest.fixture
def mixed(scene: Scene, blurs: Path, tmp_path: Path) -> Path:
    """A folder with models and a BOP scene of images 0 to 4: the true pose; one with a part of the
    model behind the camera; one that is no rotation; one of an image without a camera; and one of
    an object that is hidden.
    """
    (tmp_path / "models").mkdir()
    shutil.copy(scene.model, tmp_path / "models/obj_000005.ply")
    pose = load_pose(scene.truth, 160, 120).pose
    true, camera = pose.camera_from_model, pose.camera
    assert isinstance(camera, Perspective)
    near = replace(true, translation=true.translation * [0.0, 0.0, 0.02])
    places = (true, near, replace(true, rotation=2.0 * true.rotation), true, true)
    photos = dict(enumerate((*[scene.photo] * 4, blurs)))
    objects = {number: [BopObject(5, place)] for number, place in enumerate(places)}
    bop = write_bop_scene(tmp_path / "000001", camera, photos, objects)
    cameras = json.loads((bop / "scene_camera.json").read_text())
    info = {"0": [{"visib_fract": 1.0}], "4": [{"visib_fract": 0.0}]}
    del cameras["3"]
    write(bop / "scene_camera.json", cameras)
    write(bop / "scene_gt_info.json", info)
    return tmp_path


@pytest.mark.slow
@pytest.mark.long
def test_an_audit_goes_on_whatever_one_row_holds(mixed: Path) -> None:
    given, out = scene_gt(mixed / "000001"), mixed / "audit"
    batch = open_batch(mixed / "000001", out, QUICK, models=mixed / "models", is_audit=True)
    fit_all(batch)
    true, behind, bent, blind, hidden = (row.result for row in batch.rows())
    assert true.moved_px == pytest.approx(0.0, abs=0.5)
    assert (behind.moved_px, behind.moved_percent, behind.given_verdict) == (None, None, "lost")
    assert BEHIND in behind.reasons
    assert "scene_gt.json: the rotation is not a rotation matrix" in bent.reason
    assert "scene_camera.json: image 3 has no camera" in blind.reason
    assert (hidden.finding, HIDDEN in hidden.reasons) == ("", True)
    assert not {BEHIND, HIDDEN} & {*true.reasons.split("\n")}
    assert scene_gt(out) == given
    moved = [row["moved_px"] != "" for row in read_rows(out / "results.csv")]
    assert moved == [True, False, False, False, True]
    words = "at an unknown distance from the given pose"
    assert words in (out / "report.html").read_text(encoding="utf-8")
    queue = review.load_queue(out)
    assert any(words in row_text(row, False) for row in queue.rows)
    index = next(i for i, row in enumerate(queue.rows) if row.job.row == 1)
    record = load_pose(out / true.pose, 160, 120)
    review.save_corrected(queue, index, record, np.zeros((12, 16, 3), np.uint8))
    save_summaries(batch)
    (found,), *others = scene_gt(out).values()
    np.testing.assert_allclose(found["cam_t_m2c"], record.pose.camera_from_model.translation)
    assert others == list(given.values())[1:]


@pytest.mark.slow
@pytest.mark.long
def test_nothing_is_found_about_an_object_that_is_hidden(scene: Scene, blurs: Path) -> None:
    fit = load(blurs, scene.model, scene.truth, QUICK).fit()
    assert audit_numbers(fit)["finding"] == "unexplained"
    assert audit_numbers(fit, is_hidden=True)["finding"] == ""
    assert audit_numbers(fit, question="In one unit?")["finding"] == ""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("kind", "factor"), [("audit", 0.001), ("batch", 0.001), ("batch", 1e3)])
def test_another_unit_is_asked_about_once_for_all_rows(mixed: Path, capsys, kind, factor) -> None:
    bop = mixed / "000001"
    ((entry,), *_) = scene_gt(bop).values()
    entry["cam_t_m2c"] = [factor * length for length in entry["cam_t_m2c"]]
    write(bop / "scene_gt.json", {"0": [entry], "1": [entry]})
    line = kind, bop, "--models", mixed / "models", "--out", mixed / kind, "--evaluations", 40
    code = EXIT_MENDABLE if factor > 1.0 else 0  # too small to be fitted
    assert run(*line, "--processes", 1) == code
    printed, question = capsys.readouterr(), "middle at a distance of"
    assert printed.err.count(question) == printed.out.count(question) == 1
    assert "2 of 2 rows, as row 1: The pose has" in printed.out
    assert kind == "batch" or "given poses: 0 moved, 0 unexplained" in printed.out
    assert "are the pose and the model in one unit?" in printed.out
    assert (mixed / kind / "report.html").read_text("utf-8").count(question) == 1
    assert run(*line) == code
    assert capsys.readouterr().out.count(question) == 1


def test_a_number_that_is_not_finite_is_left_empty_and_named(tmp_path: Path) -> None:
    (tmp_path / "rows").mkdir()
    job, result = Job(1, "p", "m", "s", "/", "key"), JobResult("", loss=math.nan, start_loss=2.0)
    saved = save_result(tmp_path, job, replace(result, moved_px=math.inf, reasons="One."))
    assert saved == replace(result, loss=None, reasons="One.\nNot finite: loss, moved_px.")
    assert json.loads((tmp_path / "rows/key.json").read_text())["loss"] is None


@pytest.mark.slow
@pytest.mark.long
def test_poses_of_a_batch_are_audited_but_rejected_ones(scene: Scene, tmp_path: Path) -> None:
    table = write_table(scene, tmp_path, 2, f"gone.png,{scene.model},{scene.start}\n")
    results = tmp_path / "results"
    fit_all(open_batch(table, results, QUICK))
    queue = review.load_queue(results)
    index = next(i for i, row in enumerate(queue.rows) if row.job.row == 1)
    review.decide(queue, index, REJECTED)
    batch = open_batch(results, tmp_path / "audit", QUICK, is_audit=True)
    (job,) = batch.jobs
    assert job.row == 2
    assert job.path(job.start).parent == results / "poses"
    fit_all(batch)
    (row,) = batch.rows()
    assert row.result.given_verdict
    assert not (tmp_path / "audit/scene_gt.json").exists()
    chosen = {REJECTED: job.path(job.start), ACCEPTED: batch.folder / row.result.pose}
    queue = review.load_queue(tmp_path / "audit")
    for decision, pose in chosen.items():
        save_summaries(review.decide(queue, 0, decision).batch)
        (line,) = read_rows(tmp_path / "audit/audited.csv")
        assert (line["photo"], line["start"]) == (str(job.path(job.photo)), str(pose))


@pytest.mark.slow
@pytest.mark.long
def test_poses_of_a_sequence_are_audited(tmp_path: Path) -> None:
    path, out = tmp_path / "sequence.json", tmp_path / "audit"
    save_scene(path, as_saved(sequence(make_three(tmp_path))))
    batch = open_batch(path, out, QUICK, is_audit=True)
    assert [Path(job.photo).name for job in batch.jobs] == ["f0.png", "f1.png", "f2.png"]
    assert open_batch(path, out, QUICK, is_audit=True).jobs == batch.jobs  # it would go on
    fit_all(batch)
    queue = review.load_queue(out)
    index = next(i for i, row in enumerate(queue.rows) if row.job.row == 2)
    save_summaries(review.decide(queue, index, ACCEPTED).batch)
    given, audited = load_scene(path), load_scene(out / path.name)
    name = given.objects[0].id
    sources = [frame.poses[name].source for frame in audited.frames]
    assert sources == ["key", "key", "propagated"]
    found = load_pose(out / queue.rows[index].result.pose, 320, 240).pose.camera_from_model
    for number, pose in ((0, None), (1, found), (2, None)):
        before, after = (s.frames[number].poses[name].world_from_model for s in (given, audited))
        wanted = before.rigid if pose is None else pose
        np.testing.assert_allclose(after.rigid.translation, wanted.translation)
    assert audited.frame_index == given.frame_index


def test_photos_without_objects_and_other_json_are_refused(tmp_path: Path) -> None:
    cameras, *_ = write_two(tmp_path)
    with pytest.raises(BatchError, match="no pose in a photo of it"):
        open_batch(cameras, tmp_path / "audit", QUICK, is_audit=True)
    assert not (tmp_path / "audit").exists()
    other = tmp_path / "other.json"
    other.write_text('{"a": 1}')
    with pytest.raises(PoseViewerError, match=r"other\.json"):
        open_batch(other, tmp_path / "audit", QUICK, is_audit=True)


def audit_of_two(folder: Path, aside: float = 0.0) -> Batch:
    """Open an audit of two objects in three photos, of which the last has its camera aside."""
    cameras, *models = write_two(folder)
    scene, objects = load_scene(cameras), []
    for name, pose, model in zip(("ball", "box"), (TRUTH[0], BOX_TRUTH[0]), models, strict=True):
        place = scene.views[0].world_from_model(pose)
        objects.append(SceneObject(id=name, model=model_file(model), world_from_model=place))
    *views, last = scene.views
    moved = RigidTransform(np.eye(3), np.array([aside, 0.0, 0.0])) @ last.camera_from_world
    views = (*views, replace(last, camera_from_world=moved))
    path = folder / "two.scene.json"
    save_scene(path, replace(scene, views=views, objects=tuple(objects)))
    return open_batch(path, folder / "audit", FitSettings(), is_audit=True)


@pytest.mark.slow
@pytest.mark.long
def test_a_camera_of_several_photos_that_is_off_is_named(tmp_path: Path) -> None:
    batch = audit_of_two(tmp_path, 0.15)
    fit_all(batch)
    wanted = "c.png: a finding in 2 of 2 objects; its camera seems wrong."
    assert name_doubted(batch, batch.rows()) == [wanted]
    queue = review.load_queue(batch.folder)
    save_summaries(review.decide(queue, 0, ACCEPTED).batch)
    assert (batch.folder / "audited.csv").exists()
    assert not (batch.folder / "two.scene.json").exists()


@pytest.mark.parametrize(
    ("found", "wanted"),
    [
        ("010100", ["box: a finding in 2 of 3 photos; its pose or model seems wrong."]),
        ("110001", ["box: a finding in 2 of 3 photos; its pose or model seems wrong."]),
        ("110000", ["a.png: a finding in 2 of 2 objects; its camera seems wrong."]),
        ("100001", []),
    ],
)
def test_what_most_rows_of_several_photos_speak_against_is_named(tmp_path, found, wanted):
    batch = audit_of_two(tmp_path)
    assert [Path(job.photo).name for job in batch.jobs] == [name for name in NAMES for _ in "12"]
    rows = [
        Row(job, JobResult("ok", finding=MOVED if is_found == "1" else ""))
        for job, is_found in zip(batch.jobs, found, strict=True)
    ]
    assert name_doubted(batch, rows) == wanted


def test_a_batch_and_an_audit_of_the_same_rows_do_not_mix(scene: Scene, tmp_path: Path) -> None:
    table, out = write_table(scene, tmp_path, 1), tmp_path / "out"
    fit_all(open_batch(table, out, QUICK))
    assert "finding" not in read_rows(out / "results.csv")[0]
    audit = open_batch(table, out, QUICK, is_audit=True)
    assert len(audit.to_do()) == 1


@pytest.mark.slow
def test_what_cannot_be_audited_is_said(scene: Scene, audited: Path, tmp_path: Path, capsys):
    bop = audited / "000001"
    line = "audit", bop, "--out", tmp_path / "out"
    assert "name the folder of its models" in refusal(capsys, *line)
    said = refusal(capsys, "audit", tmp_path, "--out", tmp_path / "out")
    assert "no scene_gt.json in it" in said
    results = write_table(scene, tmp_path, 0, f"p.png,{scene.model},auto\n").parent / "results"
    batch = open_batch(tmp_path / "jobs.csv", results, QUICK)
    with pytest.raises(BatchError, match="no row of the batch has a pose"):
        open_batch(results, tmp_path / "out", QUICK, is_audit=True)
    said = refusal(capsys, "audit", audited / "audit", "--objects", "5", "--out", tmp_path / "out")
    assert "which is no BOP scene" in said
    said = refusal(capsys, "audit", audited / "audit", "--out", audited / "audit")
    assert "is what is read" in said
    (result,) = run_batch(replace(batch, is_audit=True), batch.jobs, processes=1)
    assert "the start auto in an audit" in result.reason


@pytest.mark.parametrize(
    ("labels", "deviations", "unexplained", "finding"),
    [
        (("found", "found"), SURE, 0.2, "moved"),
        (("lost", "found"), SURE, 0.9, "moved"),
        (("found", "found"), 0.25 * SURE, 0.2, ""),
        (("lost", "doubtful"), SURE, 0.9, ""),
        (("found", "lost"), math.nan, 0.9, ""),
        (("lost", "lost"), math.nan, 0.9, "unexplained"),
        (("lost", "lost"), math.nan, 0.5, ""),
    ],
)
def test_findings(labels, deviations: float, unexplained: float, finding: str) -> None:
    assert find_finding(labels, deviations, unexplained) == finding


def test_findings_come_before_what_is_likely_wrong() -> None:
    def row(number: int, **more) -> Row:
        return Row(Job(number, "p", "m", "s", "/"), JobResult("", **more))

    rows = [
        row(1, probability=0.6),
        row(2, probability=0.9, finding="moved", moved_percent=2.0),
        row(3, probability=0.2, finding="unexplained"),
        row(4, reason="no such file"),
        row(5, probability=0.9, finding="moved", moved_percent=3.0),
        row(6, probability=0.9, finding="moved", moved_percent=9.0, review="kept"),
        row(7, verdict="found", probability=0.85),
        row(8, verdict="doubtful", probability=0.97),
    ]
    assert [own.job.row for own in worst_first(rows)] == [4, 5, 2, 3, 1, 8, 7, 6]
