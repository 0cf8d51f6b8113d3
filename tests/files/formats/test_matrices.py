"""Bare matrices and DOPE's poses: numbers are those of cv2, SciPy and the formats' descriptions."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from poseviewer.cli.main import main
from poseviewer.errors import PoseViewerError
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.formats.known_formats import FORMATS
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import scene_of_pose
from tests.files.formats.cases import perspective_record

K = np.array([[300.0, 0.0, 111.5], [0.0, 270.0, 65.5], [0.0, 0.0, 1.0]])
TURN, SHIFT = np.array([0.4, -2.3, 0.7]), np.array([0.15, -0.1, 6.0])
MATRIX = np.eye(4)
MATRIX[:3, :3], MATRIX[:3, 3] = cv2.Rodrigues(TURN)[0], SHIFT
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0]) @ MATRIX
POINTS = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
SEEN = cv2.projectPoints(POINTS, TURN, SHIFT, K, None)[0][:, 0]


def write(path: Path, matrix: np.ndarray) -> Path:
    if path.suffix == ".npy":
        np.save(path, matrix)
    elif path.suffix == ".json":
        path.write_text(json.dumps(matrix.tolist()))
    else:
        np.savetxt(path, matrix)
    return path


def load(path: Path) -> np.ndarray:
    if path.suffix == ".npy":
        return np.load(path)
    return np.array(json.loads(path.read_text())) if path.suffix == ".json" else np.loadtxt(path)


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("opengl", [False, True])
@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("ending", [".txt", ".npy", ".json"])
def test_a_matrix_shows_points_where_opencv_projects_them(tmp_path, ending, rows, opengl, inverse):
    """There and back; it may be that of the model from the camera, as NeRF has it."""
    matrix = (
        np.linalg.inv(OPENGL if opengl else MATRIX) if inverse else OPENGL if opengl else MATRIX
    )
    path, out = write(tmp_path / f"pose{ending}", matrix[:rows]), tmp_path / "pose.out.json"
    more = [*["--inverse"] * inverse, *["--opengl"] * opengl]
    camera = ["--calibration", str(write(tmp_path / "cam_K.txt", K)), "--photo-size", "200x150"]
    assert main(["convert", str(path), "--from", "matrix", str(out), *camera, *more]) == 0
    np.testing.assert_allclose(load_pose(out).pose.project(POINTS) - 0.5, SEEN, atol=1e-6)
    assert main(["convert", str(out), "--to", "matrix", f"{tmp_path}/again{ending}", *more]) == 0
    np.testing.assert_allclose(load(tmp_path / f"again{ending}"), matrix, atol=1e-12)
    if inverse:
        assert main(["convert", str(out), "--to", "opencv", f"{tmp_path}/a.yml", *more]) == 2


@pytest.mark.parametrize("ending", [".rot", ".tra"])
@pytest.mark.parametrize(("unit", "size"), [("cm", 100.0), ("mm", 1000.0)])
def test_linemods_poses_are_in_centimetres(tmp_path, ending, unit, size):
    rows = ["3 3", *(" ".join(map(str, row)) for row in MATRIX[:3, :3])]
    (tmp_path / "rot7.rot").write_text("\n".join(rows) + "\n")
    (tmp_path / "tra7.tra").write_text("3 1\n" + "\n".join(map(str, 100.0 * SHIFT)) + "\n")
    options = ConvertOptions(
        calibration=write(tmp_path / "K.txt", K), photo_size=(200, 150), unit=unit
    )
    path = tmp_path / f"{ending[1:]}7{ending}"
    scene = FORMATS["linemod"].read(path, options)
    np.testing.assert_allclose(scene.pose(0).project(size * POINTS) - 0.5, SEEN, atol=1e-6)
    files, _ = FORMATS["linemod"].convert(scene, tmp_path / f"out{ending}", options)
    assert sorted(path.name for path in files) == ["out.rot", "out.tra"]
    np.testing.assert_allclose(np.loadtxt(tmp_path / "out.tra", skiprows=1), 100.0 * SHIFT)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "out.rot", skiprows=1), MATRIX[:3, :3])


def test_the_text_of_occlusion_linemod_has_metres_and_opengls_axes(tmp_path):
    def numbers(values: np.ndarray) -> str:
        return "\n".join(" ".join(map(str, row)) for row in np.atleast_2d(values))

    path = tmp_path / "info_00000.txt"
    pose = f"rotation:\n{numbers(OPENGL[:3, :3])}\ncenter:\n{numbers(OPENGL[:3, 3])}\n"
    path.write_text(f"image size\n640 480\nApe\n{pose}extent:\n0.08 0.08 0.09\n")
    options = ConvertOptions(calibration=write(tmp_path / "K.txt", K), photo_size=(200, 150))
    found = FORMATS["linemod"].read(path, options).pose(0).project(POINTS) - 0.5
    np.testing.assert_allclose(found, SEEN, atol=1e-6)
    path.write_text("image size\n640 480\nApe\n")  # of a photo that does not show it
    with pytest.raises(PoseViewerError, match=r"rotation: and center:"):
        FORMATS["linemod"].read(path, options)


@pytest.mark.parametrize(("text", "words"), [
    ("1 2 3", "3 numbers"),
    ("a b", "wanted a number"),
    ("2 0 0 0 0 2 0 0 0 0 2 0", "not a rotation"),
    (" ".join(["1 0 0 0 0 1 0 0 0 0 1 0", "1 2 3 1"]), "last row"),
    ("1 0 0 0 0 1 0 0 0 0 1 0", "`calibration`"),
])  # fmt: skip
def test_a_matrix_that_is_none_is_refused(tmp_path, text, words):
    (tmp_path / "pose.txt").write_text(text)
    with pytest.raises(PoseViewerError, match=words):
        FORMATS["matrix"].read(tmp_path / "pose.txt", ConvertOptions(photo_size=(200, 150)))


DOPE = {
    "camera_data": {
        "width": 200, "height": 150,
        "intrinsics": {"fx": 300.0, "fy": 270.0, "cx": 111.5, "cy": 65.5},
    },
    "objects": [
        {"class": "soup", "visibility": 1, "location": (100.0 * SHIFT).tolist(),
         # sin(a/2) of the axis, cos(a/2)
         "quaternion_xyzw": [*(TURN / np.linalg.norm(TURN) * np.sin(np.linalg.norm(TURN) / 2)),
                             np.cos(np.linalg.norm(TURN) / 2)]},
        {"class": "mustard", "location": [0, 0, 50.0], "quaternion_xyzw": [0, 0, 0, 1]},
    ],
}  # fmt: skip


@pytest.mark.parametrize(("unit", "size"), [("cm", 100.0), ("m", 1.0), ("mm", 1000.0)])
def test_dopes_poses_are_in_centimetres(tmp_path, unit, size):
    (tmp_path / "d.json").write_text(json.dumps(DOPE))
    scene = FORMATS["dope"].read(tmp_path / "d.json", ConvertOptions(unit=unit))
    assert [item.name for item in scene.objects] == ["soup", "mustard"]
    np.testing.assert_allclose(scene.pose(0).project(size * POINTS) - 0.5, SEEN, atol=1e-6)
    assert scene.pose(1).camera_from_model.translation[2] == pytest.approx(0.5 * size)
    one = FORMATS["dope"].read(tmp_path / "d.json", ConvertOptions(unit=unit, image="mustard"))
    assert len(one.objects) == 1


def test_a_file_of_dope_without_its_camera_takes_that_of_a_calibration(tmp_path):
    (tmp_path / "d.json").write_text(json.dumps({"objects": DOPE["objects"]}))
    size: Any = {"photo_size": (200, 150)}
    with pytest.raises(PoseViewerError, match="does not say the camera; add `calibration`"):
        FORMATS["dope"].read(tmp_path / "d.json", ConvertOptions(**size))
    options = ConvertOptions(calibration=write(tmp_path / "cam_K.txt", K), unit="m", **size)
    seen = FORMATS["dope"].read(tmp_path / "d.json", options).pose(0).project(POINTS)
    np.testing.assert_allclose(seen - 0.5, SEEN, atol=1e-6)


def test_a_pose_for_dope_is_as_its_description_says(tmp_path):
    scene, out = scene_of_pose(tmp_path, perspective_record(unit="m")), tmp_path / "d.json"
    FORMATS["dope"].convert(scene, out, ConvertOptions())
    data = json.loads(out.read_text())
    assert data["camera_data"] == DOPE["camera_data"]
    found, wanted = data["objects"][0], DOPE["objects"][0]
    np.testing.assert_allclose(found["location"], wanted["location"])
    sign = np.sign(np.dot(found["quaternion_xyzw"], wanted["quaternion_xyzw"]))
    np.testing.assert_allclose(sign * np.array(found["quaternion_xyzw"]), wanted["quaternion_xyzw"])
    unitless = scene_of_pose(tmp_path, perspective_record(unit=None))
    with pytest.raises(PoseViewerError, match="`unit`"):
        FORMATS["dope"].convert(unitless, out, ConvertOptions(overwrite=True))
