"""A scene's files as the BOP toolkit publishes them; appended to, never replaced."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.bop import load_bop_images, read_bop, write_bop
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.scene_file import scene_of_pose
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform
from tests.files.formats.cases import HEIGHT, WIDTH, perspective_record

SIZE = (WIDTH, HEIGHT)


def load_scene(folder: Path) -> tuple[dict, dict]:
    """A reader after docs/bop_datasets_format.md: images by whole number, arrays row by row."""

    def by_image(name: str) -> dict:
        return {int(key): value for key, value in json.loads((folder / name).read_text()).items()}

    cameras, poses = by_image("scene_camera.json"), by_image("scene_gt.json")
    for camera in cameras.values():
        camera["cam_K"] = np.array(camera["cam_K"], float).reshape(3, 3)
    for pose in (pose for of_image in poses.values() for pose in of_image):
        pose["cam_R_m2c"] = np.array(pose["cam_R_m2c"], float).reshape(3, 3)
        pose["cam_t_m2c"] = np.array(pose["cam_t_m2c"], float).reshape(3, 1)
    return cameras, poses


@pytest.mark.parametrize(("unit", "millimetres"), [("m", 1000.0), ("mm", 1.0), ("in", 25.4)])
def test_the_scene_projects_the_model_the_same(tmp_path, unit, millimetres):
    record = perspective_record(unit)
    write_bop(scene_of_pose(tmp_path, record), tmp_path / "scene", ConvertOptions())
    cameras, poses = load_scene(tmp_path / "scene")
    camera, (pose,) = cameras[3]["cam_K"], poses[3]
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    in_camera = pose["cam_R_m2c"] @ (points * millimetres).T + pose["cam_t_m2c"]
    seen = (camera @ in_camera / in_camera[2])[:2].T
    # BOP's pixels are OpenCV's: (0, 0) is the centre of the first one.
    np.testing.assert_allclose(seen + 0.5, record.pose.project(points), rtol=0.0, atol=1e-9)
    assert pose["obj_id"] == 5
    assert cameras[3]["depth_scale"] == 1.0


def test_what_is_there_stays(tmp_path):
    old_camera = {"0": {"cam_K": [1, 0, 2, 0, 1, 2, 0, 0, 1], "depth_scale": 0.1, "view_level": 4}}
    old_pose = {"cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": [1, 2, 3], "obj_id": 9}
    (tmp_path / "scene_camera.json").write_text(json.dumps(old_camera))
    (tmp_path / "scene_gt.json").write_text(json.dumps({"0": [old_pose]}))
    record = perspective_record()
    write_bop(scene_of_pose(tmp_path, record), tmp_path, ConvertOptions())
    write_bop(scene_of_pose(tmp_path, record), tmp_path, ConvertOptions(object_id=6))
    write_bop(scene_of_pose(tmp_path, record), tmp_path, ConvertOptions())
    cameras, poses = (
        json.loads((tmp_path / name).read_text()) for name in ("scene_camera.json", "scene_gt.json")
    )
    assert cameras["0"] == old_camera["0"]
    assert poses["0"] == [old_pose]
    assert [pose["obj_id"] for pose in poses["3"]] == [5, 6]


def test_an_image_keeps_its_camera(tmp_path):
    record = perspective_record()
    write_bop(scene_of_pose(tmp_path, record), tmp_path, ConvertOptions())
    before = (tmp_path / "scene_gt.json").read_bytes()
    camera = record.pose.camera
    assert isinstance(camera, Perspective)
    other = record.with_pose(replace(record.pose, camera=replace(camera, fx=999.0)))
    with pytest.raises(PoseFileError, match="another camera"):
        write_bop(scene_of_pose(tmp_path, other), tmp_path, ConvertOptions())
    assert (tmp_path / "scene_gt.json").read_bytes() == before


def test_damaged_files_are_not_written_over(tmp_path):
    (tmp_path / "scene_gt.json").write_text('{"0": [')
    with pytest.raises(PoseFileError, match=r"scene_gt\.json: not JSON"):
        write_bop(scene_of_pose(tmp_path, perspective_record()), tmp_path, ConvertOptions())
    assert (tmp_path / "scene_gt.json").read_text() == '{"0": ['
    assert not (tmp_path / "scene_camera.json").exists()


@pytest.mark.parametrize(
    "entry", ["[]", '{"cam_K": 3}', "7", '{"cam_K": [[], 0, 0, 0, 0, 0, 0, 0, 0]}']
)
def test_an_image_that_is_no_image_is_said(tmp_path, entry):
    (tmp_path / "scene_camera.json").write_text(f'{{"3": {entry}}}')
    with pytest.raises(PoseFileError, match=r"image 3|3\.cam_K"):
        write_bop(scene_of_pose(tmp_path, perspective_record()), tmp_path, ConvertOptions())
    (tmp_path / "scene_camera.json").unlink()
    (tmp_path / "scene_gt.json").write_text('{"3": {}}')
    with pytest.raises(PoseFileError, match="image 3"):
        write_bop(scene_of_pose(tmp_path, perspective_record()), tmp_path, ConvertOptions())


def test_what_is_not_known_is_asked_for(tmp_path):
    record = perspective_record(unit=None)
    with pytest.raises(PoseFileError, match="--unit mm"):
        write_bop(scene_of_pose(tmp_path, record), tmp_path, ConvertOptions())
    nameless = structs.replace(perspective_record(), photo=None)
    with pytest.raises(PoseFileError, match="--image NUMBER"):
        write_bop(scene_of_pose(tmp_path, nameless), tmp_path, ConvertOptions())
    nameless = structs.replace(perspective_record(), model=None)
    with pytest.raises(PoseFileError, match="--object NUMBER"):
        write_bop(scene_of_pose(tmp_path, nameless), tmp_path, ConvertOptions(unit="m"))
    assert list(tmp_path.iterdir()) == []


def test_one_of_many_poses_is_chosen(tmp_path):
    record = perspective_record("mm")
    for image in ("3", "12"):
        for number in (5, 6):
            place = RigidTransform(np.eye(3), np.array([int(image), number, 700.0]))
            moved = record.with_pose(replace(record.pose, camera_from_model=place))
            write_bop(
                scene_of_pose(tmp_path, moved),
                tmp_path,
                ConvertOptions(image=image, object_id=number),
            )
    found = read_bop(tmp_path, ConvertOptions(image="000012", object_id=6, photo_size=SIZE))
    assert found.pose(0).camera_from_model.translation.tolist() == [12.0, 6.0, 700.0]
    unclear = (
        ConvertOptions(),
        ConvertOptions(image="3", object_id=7),
        ConvertOptions(image="4", object_id=5),
        ConvertOptions(object_id=5),
    )
    for asked in unclear:
        with pytest.raises(PoseFileError, match=r"--image|--object"):
            read_bop(tmp_path, replace(asked, photo_size=SIZE))


@pytest.mark.parametrize("name", ["left", "-1", "9" * 5001])
def test_an_image_whose_name_is_no_number_is_said(tmp_path, name):
    camera = {"cam_K": [100, 0, 50, 0, 100, 40, 0, 0, 1], "depth_scale": 1.0}
    (tmp_path / "scene_camera.json").write_text(json.dumps({name: camera}))
    with pytest.raises(PoseFileError, match="wanted images' numbers") as told:
        load_bop_images(tmp_path)
    assert len(str(told.value)) < 200 + len(str(tmp_path))
