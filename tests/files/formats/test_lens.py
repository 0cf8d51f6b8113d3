"""Poses found through a lens: every number that is written says which photo it belongs to."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.files.scene_json import scene_of_pose
from poseviewer.files.structs import Distortion
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens, Undistortion, undistort
from tests.commands import run
from tests.files.formats.cases import HEIGHT, WIDTH, perspective_record, write_files
from tests.files.formats.foreign import read_with
from tests.files.formats.test_round_trip import ENDINGS, assert_same, contents
from tests.lenses import to_taken

K4 = (-0.2, 0.05, 0.001, -0.002)
LENSES = {
    "four": Lens("opencv", K4),
    "five": Lens("opencv", (*K4, 0.01)),
    "eight": Lens("opencv", (*K4, 0.01, 0.02, -0.03, 0.004)),
    "prism": Lens("opencv", (*K4, 0.01, 0.02, -0.03, 0.004, 0.001, 0.0, 0.002, 0.0)),
    "fisheye": Lens("fisheye", (0.05, -0.01, 0.002, -0.0003)),
}
TAKEN = Perspective(300.0, 270.0, 112.0, 66.0, WIDTH, HEIGHT)


def record_through(lens: Lens | None, zoom: float = 0.9) -> PoseRecord:
    record = perspective_record()
    if lens is None:
        return record
    undistortion = Undistortion(lens, TAKEN, replace(TAKEN, fx=zoom * TAKEN.fx, fy=zoom * TAKEN.fy))
    pose = replace(record.pose, camera=undistortion.camera)
    return record.with_pose(pose, distortion=Distortion.of(undistortion))


def seen_as_taken(record: PoseRecord, points: np.ndarray) -> np.ndarray:
    """Points of the model in the photo as taken, as poseviewer knows it."""
    seen, lens = record.pose.project(points), record.undistortion
    return seen if lens is None else to_taken(lens, seen)


def written(name: str, record: PoseRecord, folder: Path, more: str = "") -> int:
    save_pose(folder / "pose.json", record)
    out = folder / f"out.{ENDINGS.get(name, 'yml')}"
    return run(f"convert {more} --to {name}", folder / "pose.json", out)


@pytest.mark.parametrize("ending", [".yml", ".json"])
@pytest.mark.parametrize("lens", [None, *LENSES.values()], ids=["none", *LENSES])
def test_opencv_sees_the_model_in_the_photo_as_taken(tmp_path, lens, ending):
    mesh, request = write_files(tmp_path)
    record, path = record_through(lens), tmp_path / f"pose{ending}"
    FORMATS["opencv"].convert(scene_of_pose(tmp_path, record), path, request)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    fields = ("rvec", "tvec", "camera_matrix", "distortion_coefficients")
    rvec, tvec, camera, distortion = (storage.getNode(field).mat() for field in fields)
    is_fisheye = storage.getNode("fisheye_model").isInt()
    assert is_fisheye == (lens is LENSES["fisheye"])
    assert int(storage.getNode("image_width").real()) == WIDTH
    points = mesh.vertices[:, None]
    project = cv2.fisheye.projectPoints if is_fisheye else cv2.projectPoints
    seen, _ = project(points, rvec, tvec, camera, distortion)
    np.testing.assert_allclose(seen[:, 0] + 0.5, seen_as_taken(record, mesh.vertices), atol=1e-8)


@pytest.mark.parametrize("lens", [None, "four", "eight", "fisheye"])
def test_colmap_sees_the_model_in_the_photo_as_taken(tmp_path, lens):
    mesh, request = write_files(tmp_path)
    record = record_through(LENSES[lens] if lens else None)
    FORMATS["colmap"].convert(scene_of_pose(tmp_path, record), tmp_path / "model", request)
    points, spots = tmp_path / "points.json", tmp_path / "spots.png"
    points.write_text(json.dumps(mesh.vertices[:50].tolist()))
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    spot = 200.0 * np.exp(-((rows - 60) ** 2 + (columns - 90) ** 2) / 32.0)
    cv2.imwrite(str(spots), spot.astype(np.uint8))
    answer = read_with("pycolmap", tmp_path / "model", points, spots, out=tmp_path / "out.json")
    expected = seen_as_taken(record, mesh.vertices[:50])
    np.testing.assert_allclose(answer["points"], expected, rtol=0.0, atol=1e-8)
    # A spot in the middle of pixel (90, 60) is for COLMAP where it is inside poseviewer.
    np.testing.assert_allclose(answer["features"][0], [90.5, 60.5], atol=0.01)
    assert answer["size"] == [WIDTH, HEIGHT]
    assert answer["name"] == "000003.png"


@pytest.mark.parametrize("name", [None, "four", "five", "fisheye"])
def test_nerfstudio_looks_through_the_same_pixels_of_the_photo_as_taken(tmp_path, name):
    """By what it does, as there is no small reader of it: its dataloader hands ``k1 k2 p1 p2 k3``
    to OpenCV, the centre half a pixel less, and its cameras look along -z (Cameras.generate_rays).
    """
    _, request = write_files(tmp_path)
    record = record_through(LENSES[name] if name else None)
    scene = scene_of_pose(tmp_path, record)
    FORMATS["nerfstudio"].convert(scene, tmp_path / "transforms.json", request)
    data = json.loads((tmp_path / "transforms.json").read_text())
    k = {key: data.get(key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2")}
    camera = np.array([[data["fl_x"], 0, data["cx"] - 0.5], [0, data["fl_y"], data["cy"] - 0.5],
                       [0, 0, 1.0]])  # fmt: skip
    pixels = np.array([[[20.0, 15.0]], [[150.0, 110.0]], [[100.0, 70.0]]])
    if data["camera_model"] == "OPENCV_FISHEYE":
        coefficients = np.array([k["k1"], k["k2"], k["k3"], k["k4"]])
        rays = cv2.fisheye.undistortPoints(pixels, camera, coefficients)
    else:
        assert k["k4"] == 0.0
        coefficients = np.array([k["k1"], k["k2"], k["p1"], k["p2"], k["k3"]])
        enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        rays = cv2.undistortPoints(pixels, camera, coefficients, criteria=enough)
    directions = np.column_stack([rays[:, 0] * (1.0, -1.0), np.full(len(rays), -1.0)])
    (frame,) = data["frames"]
    world_from_camera = np.array(frame["transform_matrix"])
    points = world_from_camera[:3, 3] + 5.0 * directions @ world_from_camera[:3, :3].T
    np.testing.assert_allclose(seen_as_taken(record, points), pixels[:, 0] + 0.5, atol=1e-4)
    assert (data["w"], data["h"]) == (WIDTH, HEIGHT)
    assert (tmp_path / frame["file_path"]).is_file()


@pytest.mark.parametrize("name", ["poseviewer", "opencv", "colmap", "nerfstudio", "scene"])
@pytest.mark.parametrize("lens", ["five", "fisheye"])
def test_the_lens_reads_back_where_it_is_held(tmp_path, name, lens):
    _, request = write_files(tmp_path)
    record = record_through(LENSES[lens], zoom=1.0)
    out = tmp_path / f"out.{ENDINGS.get(name, 'yml')}"
    FORMATS[name].convert(scene_of_pose(tmp_path, record), out, request)
    found = FORMATS[name].read(out, request)
    assert_same(found, record)
    own, k = found.views[0].file.undistortion.lens, LENSES[lens].coefficients
    assert own.model == LENSES[lens].model
    np.testing.assert_allclose(own.coefficients[: len(k)], k, atol=1e-12)
    assert not any(own.coefficients[len(k) :])


@pytest.mark.parametrize("name", ["bop", "gltf", "meshlab", "colmap"])
def test_without_a_lens_the_undistorted_photo_is_written_and_named(tmp_path, capsys, name):
    _, request = write_files(tmp_path)
    record = record_through(LENSES["prism"])
    assert written(name, record, tmp_path) == 0
    said = capsys.readouterr().out
    photo = tmp_path / ("out.scene/rgb/000003.png" if name == "bop" else "000003.undistorted.png")
    assert f"All numbers of 000003.png belong to {photo.name}, the undistorted photo" in said
    assert f"{name}: {photo}" in said
    assert request.photo is not None
    assert record.undistortion is not None
    expected, _ = undistort(load_photo(request.photo).pixels, record.undistortion)
    np.testing.assert_array_equal(load_photo(photo).pixels, expected)
    if name in ("colmap", "meshlab"):
        found = FORMATS[name].read(tmp_path / f"out.{ENDINGS[name]}", ConvertOptions())
        assert found.views[0].file.undistortion is None
        assert found.views[0].name == photo.name
        assert_same(found, record)
    # The same photo is used again, and the photo as taken is not touched.
    assert written(name, record, tmp_path, "--overwrite" if name != "bop" else "") == 0


def test_a_focal_length_that_was_found_is_no_lens_of_the_photo_as_taken(tmp_path, capsys):
    write_files(tmp_path)
    record = record_through(LENSES["five"])
    camera = Perspective(333.0, 299.7, 112.0, 66.0, WIDTH, HEIGHT)
    assert written("opencv", record.with_pose(replace(record.pose, camera=camera)), tmp_path) == 0
    assert "000003.undistorted.png" in capsys.readouterr().out
    text = (tmp_path / "out.yml").read_text()
    assert "333." in text
    assert "[ 0., 0., 0., 0., 0. ]" in text


def test_a_photo_that_is_in_the_way_or_not_the_one_is_said(tmp_path, capsys):
    record = record_through(LENSES["five"])
    assert written("bop", record, tmp_path) == 2
    assert "add --photo PHOTO." in capsys.readouterr().err
    _, request = write_files(tmp_path)
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.zeros((10, 10, 3), np.uint8))
    assert written("meshlab", record, tmp_path, f"--photo {other}") == 2
    assert "it is for a photo of 200x150 px" in capsys.readouterr().err
    taken = tmp_path / "out.scene" / "rgb" / "000003.png"
    taken.parent.mkdir(parents=True, exist_ok=True)
    request.photo.rename(taken)
    before = contents(tmp_path / "out.scene")
    assert written("bop", record, tmp_path, f"--overwrite --photo {taken}") == 2
    assert "is there already and was not touched" in capsys.readouterr().err
    assert contents(tmp_path / "out.scene") == before
