"""What each format says of a pose in a set of photos: the set's frame, and every camera."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from poseviewer.cli.main import main
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.table import FORMATS
from poseviewer.files.pose import (
    ModelReference,
    PhotoReference,
    PoseRecord,
    load_pose,
    save_pose,
    set_frame,
)
from poseviewer.files.view_set import SetChoice, load_view_set, set_as_json
from poseviewer.geometry.lens import Lens, Undistortion
from poseviewer.geometry.symmetry import NO_SYMMETRY
from tests.files.formats.foreign import read_with
from tests.view_sets import CAMERA, CAMERAS_FROM_SET, MESH, NAMES, TRUTH, make_views, write_views

UNIT = 2.5
"""Lengths of the model's unit in one of the set's."""
SIZE = CAMERA.width, CAMERA.height
KINDS = {
    "colmap": ("model", NAMES),
    "nerfstudio": ("transforms.json", NAMES),
    "gltf": ("scene.glb", ("photo", *NAMES[1:])),
    "meshlab": ("project.mlp", NAMES),
    "bop": ("scene", ("7", "8", "9")),
}
"""Of each format an output, and what its photos are called in it."""
SENTENCE = "The frame of set (m): x_in_set = [["


def record_in_set(lens: Lens | None = None) -> PoseRecord:
    """The true pose in all three photos; with a lens, in the undistorted ones."""
    records = [
        PoseRecord(
            pose,
            PhotoReference(name, *SIZE),
            undistortion=None if lens is None else Undistortion(lens, CAMERA, CAMERA),
        )
        for name, pose in zip(NAMES, TRUTH, strict=True)
    ]
    views = replace(make_views(UNIT, None), unit="m")
    in_set = set_as_json(views, records, UNIT, True, NO_SYMMETRY)
    return replace(records[0], model=ModelReference("m.ply", unit="m"), in_set=in_set)


@pytest.fixture
def pose(tmp_path: Path) -> Path:
    for path in write_views(tmp_path)[::2]:
        path.unlink()
    save_pose(tmp_path / "pose.json", record_in_set())
    return tmp_path / "pose.json"


def convert(*words: object) -> int:
    return main(["convert", *map(str, words)])


def assert_frame(matrix: Any) -> None:
    """It takes points of the model to where the cameras of the set see them."""
    points = np.column_stack([MESH.vertices, np.ones(len(MESH.vertices))])
    in_set = (points @ np.array(matrix).T)[:, :3]
    for place, truth in zip(CAMERAS_FROM_SET, TRUTH, strict=True):
        seen = in_set @ place.rotation.T + place.translation / UNIT
        np.testing.assert_allclose(CAMERA.project(seen), truth.project(MESH.vertices), atol=1e-6)


def test_a_pose_file_says_the_frame(pose: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frame = set_frame(load_pose(pose, *SIZE))
    assert frame is not None
    assert (frame.name, frame.unit, frame.size) == ("set", "m", pytest.approx(1.0 / UNIT))
    assert_frame(frame.set_from_model)
    assert main(["info", str(pose)]) == 0
    assert f"one of 3 photos: {SENTENCE}" in capsys.readouterr().out


@pytest.mark.parametrize("kind", KINDS)
def test_every_photo_reads_back(pose: Path, tmp_path: Path, kind: str) -> None:
    name, images = KINDS[kind]
    numbers = ("--image", 7, "--object", 5) if kind == "bop" else ()
    assert convert(pose, "--to", kind, tmp_path / name, *numbers) == 0
    read = FORMATS[kind].read
    assert read is not None
    for image, truth in zip(images, TRUTH, strict=True):
        asked = ConvertOptions(photo_size=SIZE, unit="m", image=image)
        found = read(tmp_path / name, asked).pose
        np.testing.assert_allclose(
            found.camera_from_model.translation, truth.camera_from_model.translation, atol=1e-9
        )
        seen = found.project(MESH.vertices)
        np.testing.assert_allclose(seen, truth.project(MESH.vertices), atol=1e-6)


def test_each_format_says_the_frame(pose: Path, tmp_path: Path) -> None:
    for kind, (name, _) in KINDS.items():
        numbers = ("--image", 7, "--object", 5) if kind == "bop" else ()
        assert convert(pose, "--to", kind, tmp_path / name, *numbers) == 0
    assert f"# {SENTENCE}" in (tmp_path / "model" / "images.txt").read_text()
    assert f"<!-- {SENTENCE}" in (tmp_path / "project.mlp").read_text()
    data = json.loads((tmp_path / "transforms.json").read_text())
    assert_frame(data["set"]["set_from_model"])
    assert [set(frame) for frame in data["frames"]] == [{"file_path", "transform_matrix"}] * 3
    content = (tmp_path / "scene.glb").read_bytes()
    document = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    (node,) = (one for one in document["nodes"] if one["name"] == "set")
    assert_frame(np.linalg.inv(np.reshape(node["matrix"], (4, 4)).T))
    assert [one["name"] for one in document["cameras"]] == ["photo", *NAMES[1:]]
    # BOP's world is the set's frame, in mm.
    for number, photo in enumerate(NAMES, 7):
        (tmp_path / "scene" / "rgb").mkdir(exist_ok=True)
        shutil.copy(tmp_path / photo, tmp_path / "scene" / "rgb" / f"{number:06d}.png")
    for view, place in zip(load_view_set(tmp_path / "scene").views, CAMERAS_FROM_SET, strict=True):
        moved, wanted = view.camera_from_set, 1000.0 * place.translation
        np.testing.assert_allclose(moved.rotation, place.rotation, atol=1e-9)
        np.testing.assert_allclose(moved.translation, wanted, atol=1e-6)
    # What was written is a set again, for those who read one.
    for written in ("model", "transforms.json"):
        assert len(load_view_set(tmp_path / written).views) == 3


def test_matrices_and_opencv_say_the_frame(
    pose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert convert(pose, "--to", "matrices", tmp_path / "m.json") == 0
    data = json.loads((tmp_path / "m.json").read_text())["set"]
    assert_frame(data["set_from_model"])
    assert [one["photo"] for one in data["views"]] == list(NAMES[1:])
    matrix = np.array(data["views"][1]["opencv"]["camera_from_model"])
    np.testing.assert_allclose(matrix[:3, 3], TRUTH[2].camera_from_model.translation)
    for ending in ("yml", "json"):
        assert convert(pose, "--to", "opencv", tmp_path / f"cv.{ending}") == 0
        storage = cv2.FileStorage(str(tmp_path / f"cv.{ending}"), cv2.FILE_STORAGE_READ)
        assert_frame(storage.getNode("set_from_model").mat())
        assert storage.getNode("set_unit").string() == "m"
    assert "the other 2 of the set are left out" in capsys.readouterr().out
    assert convert(pose, tmp_path / "own.json") == 0
    assert json.loads((tmp_path / "own.json").read_text())["set"]


def test_photos_are_undistorted_for_formats_without_their_lens(
    pose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_pose(pose, record_in_set(Lens("opencv", (-0.1, 0.02, 0.0, 0.0))))
    assert convert(pose, "--to", "colmap", tmp_path / "model") == 0
    assert (tmp_path / "model" / "cameras.txt").read_text().count("OPENCV") == 1
    assert not list(tmp_path.glob("*undistorted*"))
    (tmp_path / NAMES[2]).unlink()
    assert convert(pose, "--to", "meshlab", tmp_path / "out.mlp") == 0
    assert f"note: {NAMES[2]} is not there to be undistorted: left out." in capsys.readouterr().out
    written = sorted(path.name for path in tmp_path.glob("*undistorted*"))
    assert written == ["a.undistorted.png", "b.undistorted.png"]
    text = (tmp_path / "out.mlp").read_text()
    assert [text.count(f'fileName="{name}"') for name in written] == [1, 1]


def test_a_number_of_an_image_that_is_there_is_refused(
    pose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = ("--to", "bop", tmp_path / "scene", "--object", 5)
    assert convert(pose, *scene) == 2
    assert "--image NUMBER" in capsys.readouterr().err
    assert convert(pose, *scene, "--image", 7) == 0
    before = (tmp_path / "scene" / "scene_camera.json").read_bytes()
    assert convert(pose, *scene, "--image", 6) == 2  # the cameras stand otherwise there
    assert "is there with another camera" in capsys.readouterr().err
    assert (tmp_path / "scene" / "scene_camera.json").read_bytes() == before


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["set"].pop("set_from_model"),
        lambda data: data["set"]["set_from_model"].update(size=0),
        lambda data: data["set"].update(views=3),
        lambda data: data["set"]["views"][1].pop("photo"),
        lambda data: data["set"]["views"][2].pop("camera"),
    ],
)
def test_a_damaged_set_is_one_sentence(
    pose: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Any
) -> None:
    data = json.loads(pose.read_text())
    change(data)
    pose.write_text(json.dumps(data))
    assert convert(pose, "--to", "colmap", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert len(error.strip().splitlines()) == 1
    assert "set" in error
    assert not (tmp_path / "out").exists()


def test_blender_has_the_cameras_and_the_frame(pose: Path, tmp_path: Path) -> None:
    assert convert(pose, "--to", "blender", tmp_path / "scene.py") == 0
    script = (tmp_path / "scene.py").read_text()
    compile(script, "scene.py", "exec")
    found = read_with(
        "bpy", tmp_path / "scene.py", *SIZE, 1, tmp_path / "drawn.png", out=tmp_path / "out.json"
    )
    assert_frame(np.linalg.inv(found["places"]["set"]))
    for name, truth in zip(("photo", *NAMES[1:]), TRUTH, strict=True):
        seen, place = np.array(found["places"][name]), truth.camera_from_model.inverse()
        np.testing.assert_allclose(seen[:3, 3], place.translation, atol=1e-4)
    assert found["backgrounds"] == [list(SIZE)]


def test_some_of_a_set_can_be_read_with_folders_in_names(pose: Path, tmp_path: Path) -> None:
    assert convert(pose, "--to", "colmap", tmp_path / "model") == 0
    assert len(load_view_set(tmp_path / "model", SetChoice(NAMES[:2])).views) == 2
