"""A scene's files as the BOP toolkit publishes them; appended to, never replaced."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from poseviewer.batch.bop_rows import load_scene_jobs
from poseviewer.errors import PoseFileError
from poseviewer.files.formats.bop import BOP, load_bop_entries, load_bop_images, read_bop
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import scene_of_pose
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.settings import FitSettings
from tests.files.formats.cases import HEIGHT, WIDTH, perspective_record
from tests.writing import write as write_file


def write(record: PoseRecord, folder: Path, **options: Any) -> None:
    BOP.convert(scene_of_pose(folder, record), folder, ConvertOptions(**options))


def load_scene(folder: Path) -> tuple[dict, ...]:
    files = (folder / f"scene_{name}.json" for name in ("camera", "gt"))
    return tuple(json.loads(file.read_text()) for file in files)


@pytest.mark.parametrize(("unit", "millimetres"), [("m", 1000.0), ("mm", 1.0), ("in", 25.4)])
def test_the_scene_projects_the_model_the_same(tmp_path, unit, millimetres):
    """Check it by docs/bop_datasets_format.md: images by whole number, arrays row by row."""
    record = perspective_record(unit)
    write(record, tmp_path)
    cameras, poses = load_scene(tmp_path)
    camera, (pose,) = np.reshape(cameras["3"]["cam_K"], (3, 3)), poses["3"]
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    in_camera = np.reshape(pose["cam_R_m2c"], (3, 3)) @ (points * millimetres).T
    in_camera += np.reshape(pose["cam_t_m2c"], (3, 1))
    seen = (camera @ in_camera / in_camera[2])[:2].T
    # BOP's pixels are OpenCV's: (0, 0) is the centre of the first one.
    np.testing.assert_allclose(seen + 0.5, record.pose.project(points), rtol=0.0, atol=1e-9)
    assert pose["obj_id"] == 5
    assert cameras["3"]["depth_scale"] == 1.0


def test_what_is_there_stays(tmp_path):
    old_camera = {"0": {"cam_K": [1, 0, 2, 0, 1, 2, 0, 0, 1], "depth_scale": 0.1, "view_level": 4}}
    old_pose = {"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [1, 2, 3], "obj_id": 9}
    (tmp_path / "scene_camera.json").write_text(json.dumps(old_camera))
    (tmp_path / "scene_gt.json").write_text(json.dumps({"0": [old_pose]}))
    record = perspective_record()
    for number in (None, 6, None):
        write(record, tmp_path, object_id=number)
    cameras, poses = load_scene(tmp_path)
    assert cameras["0"] == old_camera["0"]
    assert poses["0"] == [old_pose]
    assert [pose["obj_id"] for pose in poses["3"]] == [5, 6]
    camera = Perspective(999.0, 270.0, 112.0, 66.0, WIDTH, HEIGHT)
    other = record.with_pose(replace(record.pose, camera=camera))
    with pytest.raises(PoseFileError, match="another camera"):
        write(other, tmp_path)
    assert load_scene(tmp_path) == (cameras, poses)


@pytest.mark.parametrize(("cameras", "poses", "said"), [
    (None, '{"0": [', r"scene_gt\.json: not JSON"),
    (None, '{"3": {}}', "image 3"),
    ('{"3": []}', None, "image 3"),
    ('{"3": {"cam_K": [[], 0, 0, 0, 0, 0, 0, 0, 0]}}', None, r"3\.cam_K"),
])  # fmt: skip
def test_damaged_files_are_said_and_not_written_over(tmp_path, cameras, poses, said):
    contents = {"scene_camera.json": cameras, "scene_gt.json": poses}
    for name, text in contents.items():
        if text is not None:
            (tmp_path / name).write_text(text)
    with pytest.raises(PoseFileError, match=said):
        write(perspective_record(), tmp_path)
    there = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert there == {name: text for name, text in contents.items() if text is not None}


def test_what_is_not_known_is_asked_for(tmp_path):
    record = perspective_record()
    for nameless, unit, wanted in (
        (perspective_record(unit=None), None, "`unit`"),
        (structs.replace(record, photo=None), "m", "with `image`"),
        (structs.replace(record, model=None), "m", 'with `object_id="1=NUMBER"`'),
    ):
        with pytest.raises(PoseFileError, match=wanted):
            write(nameless, tmp_path, unit=unit)
    assert list(tmp_path.iterdir()) == []


def test_one_of_many_poses_is_chosen(tmp_path):
    record = perspective_record("mm")
    for image in ("3", "12"):
        for number in (5, 6):
            place = RigidTransform(np.eye(3), np.array([int(image), number, 700.0]))
            moved = record.with_pose(replace(record.pose, camera_from_model=place))
            write(moved, tmp_path, image=image, object_id=number)
    size: Any = {"photo_size": (WIDTH, HEIGHT)}
    found = read_bop(tmp_path, ConvertOptions(image="000012", object_id=6, **size))
    assert found.pose(0).camera_from_model.translation.tolist() == [12.0, 6.0, 700.0]
    found = read_bop(tmp_path, ConvertOptions(image="3", **size))
    assert [one.id for one in found.objects] == ["5", "6"]
    for image, number in ((None, None), ("3", 7), ("4", 5), (None, 5)):
        with pytest.raises(PoseFileError, match=r"`(image|object_id)`"):
            read_bop(tmp_path, ConvertOptions(image=image, object_id=number, **size))


def test_numbers_with_zeros_before_and_objects_from_0_are_read(tmp_path):
    record = perspective_record("mm")
    for image in ("3", "12"):
        write(record, tmp_path, image=image, object_id=5)
    poses = json.loads((tmp_path / "scene_gt.json").read_text())
    poses = {f"{int(name):06d}": [{**own[0], "obj_id": 0}] for name, own in poses.items()}
    (tmp_path / "scene_gt.json").write_text(json.dumps(poses))
    images = load_bop_images(tmp_path, posed=True)
    assert [(one.number, one.objects[0].object_id) for one in images] == [(3, 0), (12, 0)]
    (tmp_path / "scene_gt.json").write_text(json.dumps(poses | {"12": []}))
    with pytest.raises(PoseFileError, match="two images of one number"):
        load_bop_images(tmp_path, posed=True)


CAMERA = {"cam_K": [400, 0, 160, 0, 400, 120, 0, 0, 1]}
POSE = [{"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [1, 2, 700], "obj_id": 1}]


def test_images_with_poses_and_without_a_camera_are_named_and_counted(tmp_path):
    write_file(tmp_path / "scene_camera.json", {"0": CAMERA})
    write_file(tmp_path / "scene_gt.json", {f"{i:06d}": POSE for i in range(4)})
    missing = r"no camera for 3 of the 4 images of scene_gt\.json \(1, 2, 3\)"
    with pytest.raises(PoseFileError, match=missing):
        load_bop_images(tmp_path)
    sizes = ConvertOptions(photo_size=(320, 240))
    (note,) = read_bop(tmp_path, replace(sizes, image="0")).notes
    assert "no camera for 3 of the 4 images" in note
    with pytest.raises(PoseFileError, match=missing):
        read_bop(tmp_path, replace(sizes, image="2"))
    said = [entry.problem for entry in load_bop_entries(tmp_path)]
    assert said[0] == ""
    assert all(f"image {i} has no camera" in problem for i, problem in enumerate(said[1:], 1))


def test_an_image_whose_number_has_zeros_before_is_appended_to(tmp_path):
    record = perspective_record()
    write(record, tmp_path)
    for name in ("scene_camera.json", "scene_gt.json"):
        path = tmp_path / name
        path.write_text(path.read_text().replace('"3"', '"000003"'))
    write(record, tmp_path, object_id=6)
    (image,) = load_bop_images(tmp_path)
    assert [item.object_id for item in image.objects] == [5, 6]


def test_a_model_in_another_format_is_said(tmp_path):
    write_file(tmp_path / "scene_camera.json", {"0": CAMERA})
    write_file(tmp_path / "scene_gt.json", {"0": POSE})
    models = tmp_path / "models"
    models.mkdir()
    write_file(models / "obj_000001.glb", b"glTF")
    options = ConvertOptions(photo_size=(320, 240), model=models)
    with pytest.raises(
        PoseFileError, match=r"obj_000001\.glb: .*export it as obj_000001\.ply, in mm"
    ):
        read_bop(tmp_path, options)
    (job,) = load_scene_jobs(tmp_path, tmp_path / "out", FitSettings(), models, ())
    assert "export it as obj_000001.ply, in mm" in job.problem
    write_file(models / "obj_000001.ply", b"ply")
    assert read_bop(tmp_path, options).objects[0].model.unit == "mm"


def test_poses_of_a_scene_are_read_each_by_itself(tmp_path):
    write(perspective_record("mm"), tmp_path)
    poses, cameras = tmp_path / "scene_gt.json", tmp_path / "scene_camera.json"
    (good,) = json.loads(poses.read_text())["3"]
    good["obj_id"] = 0
    bad = [{**good, "obj_id": value} for value in ("x", -1, None, 2.5)]
    bad += [{**good, "cam_t_m2c": [math.nan, 0, 9]}, {**good, "cam_R_m2c": [0] * 9}, 7]
    write_file(poses, {"3": [*bad, good], "004": None, "5": [good], "12": [good]})
    (camera,) = json.loads(cameras.read_text()).values()
    write_file(cameras, {"3": camera, "04": camera, "5": {"cam_K": [0] * 9}})
    info = {"3": [{}] * len(bad) + [{"visib_fract": 0.0}]}
    write_file(tmp_path / "scene_gt_info.json", info)
    entries = load_bop_entries(tmp_path)
    assert [entry.image for entry in entries] == [3] * 8 + [4, 5, 12]
    assert [i for i, entry in enumerate(entries) if not entry.problem] == [7]
    assert all((entry.pose is None) == bool(entry.problem) for entry in entries)
    assert (entries[7].object_id, entries[7].visible) == (0, 0.0)
    words = "pose 0 of image 3.obj_id", "image 4", "cam_K of 5", "image 12 has no camera"
    for i, word in zip((0, 8, 9, 10), words, strict=True):
        assert word in entries[i].problem


@pytest.mark.parametrize("name", ["left", "-1", "9" * 5001])
def test_an_image_whose_name_is_no_number_is_said(tmp_path, name):
    camera = {"cam_K": [100, 0, 50, 0, 100, 40, 0, 0, 1], "depth_scale": 1.0}
    (tmp_path / "scene_camera.json").write_text(json.dumps({name: camera}))
    with pytest.raises(PoseFileError, match="wanted images' numbers") as told:
        load_bop_images(tmp_path)
    assert len(str(told.value)) < 200 + len(str(tmp_path))
