"""COLMAP's files as COLMAP and the scripts of others write them."""

import struct

import pytest

from poseviewer.errors import PoseFileError
from poseviewer.files.checks import InputFile
from poseviewer.files.colmap_model import colmap_cameras, colmap_images
from tests.writing import write

POSE = "1 0 0 0 0.5 0.25 2"
NAMES = ["a.jpg", "b 2.jpg", "000003", "4.5"]
POINTS = ("", "10.5 20.5 -1 30 40 7 50 60 -1 70 80 -1\n", "# none\n", "\n")


@pytest.mark.parametrize("points", POINTS)
def test_no_image_is_lost_where_lines_of_points_are_left_out(tmp_path, points):
    lines = "".join(f"{i} {POSE} 1 {name}\n{points}" for i, name in enumerate(NAMES, 1))
    path = write(tmp_path / "images.txt", f"# Image list\n{lines}")
    assert colmap_images(InputFile(path)) == [(name, "1", POSE) for name in NAMES]


def image(name: bytes, points: int) -> bytes:
    head = struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0.5, 0.25, 2, 1)
    return head + name + struct.pack("<Q", points)


@pytest.mark.parametrize(("content", "words"), [
    (image(struct.pack("<Q", 5) + b"a.jpg", 0), "names that end in a zero"),
    (image(b"\x05a.jpg", 0), "names that end in a zero"),
    (image(b"a.jpg\0", 1), "has the name 'a.jpg' and 1 points"),
    (image(b"a.jpg\0", 2**63), "names that end in a zero"),
    (image(b"\xff\xfe.jpg", 0), "names that end in a zero"),
    (image(b"a.jpg\0", 0)[:30], "ends too early"),
    (image(b"a.jpg\0", 0)[:-3], "ends too early"),
])  # fmt: skip
def test_a_binary_of_other_images_is_said(tmp_path, content, words):
    with pytest.raises(PoseFileError, match=words):
        colmap_images(InputFile(write(tmp_path / "images.bin", content)))
    whole = write(tmp_path / "images.bin", image(b"a.jpg\0", 1) + bytes(24))
    assert colmap_images(InputFile(whole)) == [("a.jpg", "1", "1.0 0.0 0.0 0.0 0.5 0.25 2.0")]


@pytest.mark.parametrize(("content", "words"), [
    (struct.pack("<QIIQQ4d", 1, 1, 99, 640, 480, 5, 5, 320, 240), "of model 99"),
    (struct.pack("<QIIQQ3d", 1, 1, 1, 640, 480, 5, 5, 320), "ends too early"),
])  # fmt: skip
def test_a_binary_of_other_cameras_is_said(tmp_path, content, words):
    with pytest.raises(PoseFileError, match=words):
        colmap_cameras(InputFile(write(tmp_path / "cameras.bin", content)))
