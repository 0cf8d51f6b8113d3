import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from msgspec import structs

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import PoseFileError
from poseviewer.files.pose import PoseRecord, check_against, load_pose, save_pose
from poseviewer.files.structs import ChartJson, ModelReference, PhotoReference, Uncertainty
from poseviewer.files.symmetry import SymmetryTurns
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.symmetry_group import Symmetry, SymmetryAxis
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from tests.schemas import json_schema, load_valid
from tests.writing import write

WIDTH, HEIGHT = 640, 480
SHA = "0123456789abcdef" * 4
PERSPECTIVE = Perspective(812.3456789012345, 811.1, 320.125, 241.7, WIDTH, HEIGHT)
PARALLEL = Parallel(123.45678901234567, 300.1, 200.2, WIDTH, HEIGHT)
TRANSFORM = RigidTransform.from_rotation_vector([0.3, -1.1, 2.0], [0.1, -2.5, 1.0 / 3.0])


HALF_TURN = Symmetry.from_axes([0.0, 0.0, 0.1], [SymmetryAxis(np.array([0.0, 0.0, 1.0]), 2)])


def full_record(camera: Perspective | Parallel = PERSPECTIVE) -> PoseRecord:
    return PoseRecord.of(
        pose=Pose(camera, TRANSFORM),
        photo=PhotoReference("Straße 道.jpg", WIDTH, HEIGHT, SHA),
        model=ModelReference("car.glb", SHA[::-1], "m"),
        chart=ChartJson("vehicle", ("x", "y"), (1.0 / 7.0, -2e-17)),
        loss=np.float64(0.1 + 0.2),  # as the losses of some renderers are
        settings={"restarts": 8, "clipped": True},
        software={"name": "poseviewer", "version": "0.1.0"},
        notes=("The focal length is assumed.",),
        turns=SymmetryTurns.of(HALF_TURN),
    )


def plain() -> dict[str, Any]:
    place = {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "translation": [0, 0, 5]}
    camera = {"fx": 500, "fy": 510, "cx": 319.5, "cy": 239.5}
    return {"projection": "perspective", "camera": camera, "camera_from_model": place}


@pytest.mark.parametrize("camera", [PERSPECTIVE, PARALLEL])
def test_what_is_written_is_read_to_the_last_digit(tmp_path: Path, camera) -> None:
    record = full_record(camera)
    factor, size = np.random.default_rng(0).normal(size=(7, 7)), 6 if camera is PARALLEL else 7
    matrix, pose = (factor @ factor.T)[:size, :size], record.pose
    sure = PoseCovariance(pose, np.array([0.1, 0.2, 5.3]), matrix, 0.7, "log_size")
    record = structs.replace(record, uncertainty=Uncertainty.of(sure))
    save_pose(tmp_path / "pose.json", record)
    load_valid(tmp_path / "pose.json", "pose")
    read = load_pose(tmp_path / "pose.json", WIDTH, HEIGHT)
    assert read.pose.camera == camera
    np.testing.assert_array_equal(read.pose.camera_from_model.rotation, TRANSFORM.rotation)
    np.testing.assert_array_equal(read.pose.camera_from_model.translation, TRANSFORM.translation)
    assert read == record
    assert (read.turns.symmetry.words, read.warnings) == (HALF_TURN.words, ())
    assert (read.covariance.words("mm"), read.covariance.names) == (sure.words("mm"), sure.names)
    save_pose(tmp_path / "again.json", read)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "pose.json").read_bytes()


@pytest.mark.parametrize(("wrong", "words"), [
    ({"covariance": np.eye(5).tolist()}, "wanted 6 rows"),
    ({"covariance": (-np.eye(6)).tolist()}, "variance below 0"),
    ({"covariance": np.eye(6).tolist(), "centre": None}, "uncertainty.centre"),
])  # fmt: skip
def test_a_covariance_that_is_none_is_refused(tmp_path: Path, wrong: Any, words: str) -> None:
    data = {**plain(), "uncertainty": {"centre": [0, 0, 0], **wrong}}
    with pytest.raises(PoseFileError, match=words):
        load_pose(write(tmp_path / "pose.json", data), WIDTH, HEIGHT)


def test_pixel_centres_are_at_integers_in_files(tmp_path: Path) -> None:
    save_pose(tmp_path / "pose.json", full_record())
    camera = json.loads((tmp_path / "pose.json").read_text())["camera"]
    assert (camera["cx"], camera["cy"]) == (319.625, 241.2)
    read = load_pose(write(tmp_path / "plain.json", plain()), WIDTH, HEIGHT)
    assert read.pose.camera == Perspective(500.0, 510.0, 320.0, 240.0, WIDTH, HEIGHT)


def test_three_fields_are_enough_and_unknown_ones_are_ignored(tmp_path: Path) -> None:
    data = plain() | {"comment": "by hand", "photo": {"camera": "old"}, "model": {}, "loss": None}
    path = write(tmp_path / "pose.json", "\ufeff" + json.dumps(data))  # a byte order mark
    read = load_pose(path, WIDTH, HEIGHT)
    assert (read.warnings, read.loss, read.chart) == ((), None, None)
    np.testing.assert_array_equal(read.pose.camera_from_model.translation, [0.0, 0.0, 5.0])


@pytest.mark.parametrize(("digits", "off_deg", "warnings"), [(7, 1e-4, 0), (2, 1.0, 1)])
def test_a_rounded_rotation_is_repaired(tmp_path: Path, digits, off_deg, warnings) -> None:
    data = plain()
    data["camera_from_model"]["rotation"] = np.round(TRANSFORM.rotation, digits).tolist()
    read = load_pose(write(tmp_path / "pose.json", data), WIDTH, HEIGHT)
    rotation = read.pose.camera_from_model.rotation
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert rotation_angle(rotation, TRANSFORM.rotation) < math.radians(off_deg)
    said = [text for text in read.warnings if "was not quite orthonormal" in text]
    assert len(said) == len(read.warnings) == warnings


def test_another_size_of_the_photo_is_a_warning(tmp_path: Path) -> None:
    save_pose(tmp_path / "pose.json", full_record())
    read = load_pose(tmp_path / "pose.json", 320, 240)
    assert read.warnings == (
        "pose.json: the pose was made for a photo of 640x480 px, this one has 320x240 px.",
    )
    assert (read.pose.camera.width, read.pose.camera.height) == (320, 240)


def test_fingerprints_are_compared() -> None:
    record = full_record()
    assert check_against(record.photo, SHA) == check_against(None, SHA) == ()
    assert "another photo (Straße 道.jpg)" in check_against(record.photo, SHA[::-1])[0]
    assert "another model (car.glb)" in check_against(record.model, SHA)[0]


def test_saving_replaces_a_file_whole(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "pose ü.json"
    save_pose(path, full_record())
    before = path.read_bytes()

    def full_disk(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("poseviewer.files.writing.os.fsync", full_disk)
    with pytest.raises(PoseFileError, match=r"^pose ü\.json: cannot be written .*No space left"):
        save_pose(path, full_record(PARALLEL))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("wrong", [
    structs.replace(full_record(), loss=math.nan),
    structs.replace(full_record(), settings={"array": np.zeros(3)}),
    PoseRecord.of(Pose(replace(PERSPECTIVE, fx=math.inf), TRANSFORM)),
])  # fmt: skip
def test_what_json_cannot_hold_is_not_written(tmp_path: Path, wrong: PoseRecord) -> None:
    with pytest.raises(PoseFileError, match=r"^pose\.json: .*nothing was written"):
        save_pose(tmp_path / "pose.json", wrong)
    assert not list(tmp_path.iterdir())


OPENCV = {"model": "opencv", "coefficients": [0.1] * 5, "camera_as_taken": plain()["camera"]}
MEI = OPENCV | {"model": "mei", "camera_undistorted": plain()["camera"]}


@pytest.mark.parametrize("change", [
    lambda data: data.pop("camera"),
    lambda data: data.update(format="other"),
    lambda data: data.update(version=2),
    lambda data: data.update(projection="parallel"),
    lambda data: data["camera"].update(fx=0),
    lambda data: data["camera"].pop("cy"),
    lambda data: data["camera_from_model"].update(translation=[0, 0]),
    lambda data: data["camera_from_model"].update(rotation=[1, 0, 0, 0, 1, 0, 0, 0, 1]),
    lambda data: data.update(photo={"width": 0}),
    lambda data: data.update(distortion=OPENCV),
    lambda data: data.update(distortion=MEI),
    lambda data: data.update(symmetry={"centre": [0, 0, 0], "turns": "z"}),
    lambda data: data.update(chart={"name": "free", "names": [1], "numbers": [1]}),
])  # fmt: skip
def test_schema_and_reader_refuse_the_same(tmp_path: Path, change) -> None:
    data, validator = plain(), jsonschema.Draft202012Validator(json_schema("pose"))
    validator.validate(data)
    change(data)
    assert not validator.is_valid(data)
    with pytest.raises(PoseFileError, match=r"^pose\.json: "):
        load_pose(write(tmp_path / "pose.json", data), WIDTH, HEIGHT)
