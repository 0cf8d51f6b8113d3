import struct

import cv2
import numpy as np
import pytest

from poseviewer.errors import CalibrationFileError
from poseviewer.files.cameras import Calibration, load_calibration, load_cameras
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens
from tests.lenses import write_camera
from tests.writing import write

MATRIX = np.array([[1234.5678901234567, 0.0, 640.25], [0.0, 1236.1, 355.0625], [0.0, 0.0, 1.0]])
INSIDE = Perspective(1234.5678901234567, 1236.1, 640.75, 355.5625, 1280, 720)
"""Camera of MATRIX with pixel centres at i + 0.5."""
COEFFICIENTS = {
    5: (-0.25, 0.08, 0.002, -0.0015, -0.01),
    8: (0.3, -0.1, 0.001, 0.002, 0.02, 0.45, 0.05, -0.01),
    12: (-0.2, 0.05, 1e-3, 1e-3, 0.0, 0.01, 0.0, 0.0, 4e-3, -1e-3, -3e-3, 1e-3),
}
FISHEYE = (0.05, -0.02, 0.006, -0.001)


@pytest.mark.parametrize("count", COEFFICIENTS)
@pytest.mark.parametrize("ending", [".yml", ".yaml", ".json", ".xml"])
def test_what_opencv_writes_reads_back_to_the_last_digit(tmp_path, ending, count):
    lens = Lens("opencv", COEFFICIENTS[count])
    (found,) = load_cameras(write_camera(tmp_path / f"camera{ending}", INSIDE, lens))
    assert (found.camera, found.lens) == (INSIDE, lens)


def test_opencvs_fisheye_is_known_by_its_mark_or_by_the_users_word(tmp_path):
    marked = Lens("fisheye", FISHEYE)
    assert load_cameras(write_camera(tmp_path / "a.yml", INSIDE, marked))[0].lens == marked
    plain = {"K": MATRIX.tolist(), "D": [[k] for k in FISHEYE], "image_size": [1280, 720]}
    path = write(tmp_path / "b.json", plain)
    for model in ("opencv", "fisheye"):
        assert load_cameras(path, model)[0].lens == Lens(model, FISHEYE)
    with pytest.raises(CalibrationFileError, match=r"four .*with `Calibration.lens_model`"):
        load_cameras(path)
    with pytest.raises(CalibrationFileError, match="said to be of the model 'fisheye'"):
        load_cameras(tmp_path / "a.yml", "opencv")


def test_a_stereo_pair_has_two_cameras(tmp_path):
    path = tmp_path / "intrinsics.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("M1", MATRIX)
    storage.write("D1", np.array([COEFFICIENTS[5]]))
    storage.write("M2", MATRIX / [[2], [2], [1]])
    storage.write("D2", np.zeros((1, 5)))
    storage.release()
    first, second = load_cameras(path)
    assert (first.name, first.lens) == ("1", Lens("opencv", COEFFICIENTS[5]))
    assert (second.name, second.lens) == ("2", None)
    chosen, _ = load_calibration(Calibration(path, camera="2"), "p.png", 640, 360)
    assert chosen.camera.fx == INSIDE.fx / 2
    with pytest.raises(CalibrationFileError, match=r"2 cameras, '1', '2'.*`Calibration.camera`"):
        load_calibration(Calibration(path), "p.png", 640, 360)
    with pytest.raises(CalibrationFileError, match="no camera '3'"):
        load_calibration(Calibration(path, camera="3"), "p.png", 640, 360)


PINHOLE = Perspective(1010, 1010, 640.5, 360, 1280, 720)
COLMAP = {
    "SIMPLE_PINHOLE 1280 720 1010 640.5 360": (PINHOLE, None),
    "PINHOLE 1280 720 1010 1010 640.5 360": (PINHOLE, None),
    "SIMPLE_RADIAL 1280 720 1000 640.5 360 -0.1": ("opencv", (-0.1, 0, 0, 0, 0)),
    "RADIAL 1280 720 1000 640.5 360 -0.1 0.02": ("opencv", (-0.1, 0.02, 0, 0, 0)),
    "OPENCV 1280 720 1000 1010 640.5 360 -0.1 0.02 3e-3 4e-3": (
        "opencv", (-0.1, 0.02, 3e-3, 4e-3, 0)),
    "FULL_OPENCV 1280 720 1000 1010 640.5 360 1 2 3 4 5 6 7 8": (
        "opencv", (1, 2, 3, 4, 5, 6, 7, 8)),
    "OPENCV_FISHEYE 1280 720 1000 1010 640.5 360 1 2 3 4": ("fisheye", (1, 2, 3, 4)),
    "SIMPLE_RADIAL_FISHEYE 1280 720 1000 640.5 360 0.1": ("fisheye", (0.1, 0, 0, 0)),
    "RADIAL_FISHEYE 1280 720 1000 640.5 360 0.1 0.2": ("fisheye", (0.1, 0.2, 0, 0)),
    "SIMPLE_FISHEYE 1280 720 1000 640.5 360": ("fisheye", (0, 0, 0, 0)),
    "FISHEYE 1280 720 1000 1010 640.5 360": ("fisheye", (0, 0, 0, 0)),
}  # fmt: skip
"""Pixel centres at i + 0.5 in COLMAP's file as well: no shift."""


@pytest.mark.parametrize("line", COLMAP)
def test_colmaps_models_become_opencvs(tmp_path, line):
    path = write(tmp_path / "cameras.txt", f"# Camera list\n#\n1 {line}\n")
    (found,) = load_cameras(path)
    first, second = COLMAP[line]
    if isinstance(first, Perspective):
        assert (found.camera, found.lens) == (first, None)
    else:
        assert found.lens == Lens(first, tuple(float(k) for k in second))
        assert (found.camera.cx, found.camera.cy, found.camera.fx) == (640.5, 360.0, 1000.0)


@pytest.mark.parametrize("is_binary", [False, True])
def test_colmaps_images_say_which_camera_took_a_photo(tmp_path, is_binary):
    if is_binary:
        pose, camera = (1.0, 0, 0, 0, 0, 0, 5.0), (1010.0, 640.0, 360.0)
        texts = {
            "cameras": [struct.pack("<IIQQ4d", k, 1, 1280, 720, k * 1e3, *camera) for k in (1, 2)],
            "images": [
                *(struct.pack("<I7dI", 3, *pose, 1), b"a/left one.jpg\0" + struct.pack("<Q", 2)),
                *(bytes(48), struct.pack("<I7dI", 4, *pose, 2), b"b/right.jpg\0", bytes(8)),
            ],
        }
        for name, records in texts.items():
            (tmp_path / f"{name}.bin").write_bytes(struct.pack("<Q", 2) + b"".join(records))
        path = tmp_path / "cameras.bin"
    else:
        lines = [f"{key} PINHOLE 1280 720 {1000 * key} 1010 640 360" for key in (1, 2)]
        path = write(tmp_path / "cameras.txt", "\n".join(lines))
        write(tmp_path / "images.txt", "# head\n1 1 0 0 0 0 0 0 1 a/left one.jpg\n5 6 -1\n"
              "2 1 0 0 0 0 0 0 2 b/right.jpg\n\n")  # fmt: skip
    for name, focal in (("left one.jpg", 1000), ("right.jpg", 2000)):
        assert load_calibration(Calibration(path), name, 1280, 720)[0].camera.fx == focal
    with pytest.raises(CalibrationFileError, match="2 cameras"):
        load_calibration(Calibration(path), "other.jpg", 1280, 720)
    path.write_bytes(path.read_bytes()[:-1] if is_binary else b"\xff")
    with pytest.raises(
        CalibrationFileError, match=r"^cameras\....: (not a (readable file|text)|it ends too early)"
    ):
        load_cameras(path)


def test_bops_cameras_are_read(tmp_path):
    one = {"cx": 640.25, "cy": 355.0625, "fx": MATRIX[0, 0], "fy": 1236.1, "depth_scale": 0.1}
    path = write(tmp_path / "camera.json", {**one, "width": 1280, "height": 720})
    assert load_calibration(Calibration(path), "p.png", 1280, 720)[0].camera == INSIDE
    scene = {
        str(i): {"cam_K": (MATRIX * [[i, 1, 1], [1, i, 1], [1, 1, 1]]).ravel().tolist()}
        for i in (3, 17)
    }
    path = write(tmp_path / "scene_camera.json", scene)
    found, _ = load_calibration(Calibration(path), "000017.png", 1280, 720)
    assert found.camera.fx == pytest.approx(17 * INSIDE.fx)
    found, _ = load_calibration(Calibration(path, camera="3"), "000017.png", 1280, 720)
    assert found.camera.fx == pytest.approx(3 * INSIDE.fx)
    assert (found.camera.width, found.camera.height) == (1280, 720)


def test_a_calibration_is_scaled_in_the_same_ratio_alone(tmp_path):
    path = write_camera(tmp_path / "c.yml", INSIDE, Lens("opencv", COEFFICIENTS[5]))
    half, notes = load_calibration(Calibration(path), "p.png", 640, 360)
    assert half.camera == INSIDE.resize(640, 360)
    assert half.lens == Lens("opencv", COEFFICIENTS[5])  # it acts on rays: no px in it
    assert "1280x720" in notes[0]
    for width in (426, 427):  # a third: programs round 426.67 up or down
        load_calibration(Calibration(path), "p.png", width, 240)
    for size in ((720, 1280), (1000, 700), (640, 365)):
        with pytest.raises(CalibrationFileError, match=f"1280x720 px.*{size[0]}.*orientation"):
            load_calibration(Calibration(path), "p.png", *size)


MATRIX_TEXT = """%YAML:1.0
---
camera_matrix:
   rows: 3
   cols: 3
   dt: d
   data: [ 9., 0., 4., 0., 9., 3., 0., 0., 1. ]
"""
BROKEN = {
    "notes.yml": ("just some words", "as OpenCV writes"),
    "cut.yml": ("%YAML:1.0\n---\ncamera_matrix: [1, 2", "as OpenCV writes"),
    "deep.xml": ('<?xml version="1.0"?>\n<opencv_storage>' + "<a>" * 20_000, "as OpenCV writes"),
    "dashes.yml": ("- " * 40_000, "as OpenCV writes"),
    "other.json": ('{"a": 1}', "no camera in it"),
    "zero.json": ({"K": [[0, 0, 1], [0, 1, 1], [0, 0, 1]]}, "above 0"),
    "columns.json": ({"K": [[9, 0, 0], [0, 9, 0], [4, 3, 1]]}, "rows fx 0 cx"),
    "skew.json": ({"K": [[9, 1, 4], [0, 9, 3], [0, 0, 1]]}, "skew of 1"),
    "three.json": ({"K": [[9, 0, 4], [0, 9, 3], [0, 0, 1]], "D": [1, 2, 3]}, "3 distortion"),
    "model.json": ({"K": [[9, 0, 4], [0, 9, 3], [0, 0, 1]], "model": "mei"}, "'mei'"),
    "size.json": ({"K": [[9, 0, 4], [0, 9, 3], [0, 0, 1]], "width": 3.5, "height": 2}, "whole"),
    "bop.json": ({"fx": 1, "fy": "x", "cx": 0, "cy": 0}, "fy is 'x'"),
    "cameras.txt": ("# only a head\n", "no camera"),
    "words.txt": ("hello there\n", "no camera in it (its keys: hello there); read are those"),
    "fov.txt": ("1 FOV 640 480 1 1 1 1 1\n", "model FOV"),
    "negative.txt": ("1 PINHOLE 640 480 -1 1 1 1\n", "above 0"),
    "surplus.txt": ("1 PINHOLE 640 480 1 1 1 1 7\n", "5 parameters"),
    "far.txt": ("1 PINHOLE 640 480 1e9 1 1 1\n", "fx is 1000000000; wanted a number <= 10000000"),
    "far.json": ({"K": [[1e308, 0, 4], [0, 9, 3], [0, 0, 1]]}, "at most 1e+30"),
    "second.yml": ("%YAML:1.0\n---\na: 1\n---\n1\n-x", "no camera in it"),
    "cameras.bin": (b"\x01\x00", ".bin"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_files_are_refused_with_one_sentence(tmp_path, name, capfd):
    content, words = BROKEN[name]
    path = write(tmp_path / name, content)
    with pytest.raises(CalibrationFileError) as caught:
        load_cameras(path)
    message = str(caught.value)
    assert message.startswith(f"{name}: ")
    assert words in message
    assert message.endswith(".")
    assert "\n" not in message
    assert capfd.readouterr().err == ""


BOMB = "a: &a0 [0, 0]\n" + "".join(f"b{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 99))
ROWS = [[9, 0, 4], [0, 9, 3], [0, 0, 1]]
HOSTILE = {
    "blanks.txt": ("a" + " " * 900_000 + "!\n1\n", "matrix.0. is 'a'"),
    "dots.yml": ("a." * 400_000, "as OpenCV writes"),
    "aliases.yml": (MATRIX_TEXT + BOMB + "distx: *a98\n", "more than 1,000,000 letters"),
    "long.yml": (f"a: &a {'b' * 400_000}\nc: [*a, *a, *a]\n", "aliases stand for more"),
    "endless.yml": ("a: &a [*a]\n", "as OpenCV writes"),
    "large.yml": (MATRIX_TEXT + "#" * 1_000_000, "takes a file of cameras of up to 1,000,000"),
    "large.txt": ("a: 1\n" * 200_001, "takes a file of cameras of up to 1,000,000"),
    "large.csv": ("a,b\n" * 250_001, "takes a file of cameras of up to 1,000,000"),
    "frames.json": ({"frames": [{"fl_x": 1}] * 9000, **{f"a{i}": 1 for i in range(9000)}},
                    "9,000 values that hold for each of 9,000 cameras"),
    "matrices.json": ({f"{name}{i}": ROWS for name in "Ka" for i in range(900)},
                      "900 values that hold for each of 901 cameras"),
    "types.json": ({f"{i}type": "x" for i in range(9000)}
                   | {f"c{i}": {"a": 1} for i in range(9000)},
                   "9,000 values that hold for each of 9,000 cameras"),
    "sizes.json": ({f"resolution{'_' * i}": [[640, 480]] for i in range(500)}
                   | {f"c{i}": [{"K": ROWS}] for i in range(500)},
                   "500 values that hold for each of 500 cameras"),
}  # fmt: skip
"""Small files that took minutes, or for ever."""


@pytest.mark.parametrize("name", HOSTILE)
def test_no_small_file_takes_for_ever(tmp_path, name):
    content, words = HOSTILE[name]
    with pytest.raises(CalibrationFileError, match=words):
        load_cameras(write(tmp_path / name, content))


@pytest.mark.parametrize("key", ["image" * 20_000 + "!", "1" * 400_000 + "!"])
def test_a_key_of_very_many_letters_is_passed_over(tmp_path, key):
    (found,) = load_cameras(write(tmp_path / "a.json", {"K": ROWS, key: 1}))
    assert found.camera.fx == 9.0


MUCH = 'image_points:\n   rows: 1\n   cols: 9000\n   dt: "2f"\n   data: [ '
MUCH += ", ".join(["1."] * 18_000) + " ]\n" + "".join(f"n{i}: {i}\n" for i in range(3000))
ONE_LINE = "keys: {" + ", ".join(f"n{i}: {i}" for i in range(50_000)) + "}\n"


@pytest.mark.parametrize("more", [
    "", "---\n- other\n- document\n", "...\n- more\n", MUCH, "a: &a [1, 2]\nb: [*a, *a]\n",
    pytest.param(ONE_LINE, marks=pytest.mark.slow), "\n" * 900_000,
], ids=range(7))  # fmt: skip
def test_a_matrix_of_plain_yaml_is_read_and_what_is_besides_passed_over(tmp_path, more):
    (found,) = load_cameras(write(tmp_path / "c.yml", MATRIX_TEXT + more))
    assert (found.camera.fx, found.camera.cx) == (9.0, 4.5)
