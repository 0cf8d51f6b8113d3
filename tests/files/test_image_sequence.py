"""Folders of images as sequences: order, what is left out, and what is refused."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import Base as Tag

from poseviewer.errors import PhotoFileError
from poseviewer.files.image_sequence import load_sequence


def write_image(path: Path, size: tuple[int, int] = (8, 6), orientation: int = 1) -> Path:
    exif = Image.Exif()
    exif[Tag.Orientation] = orientation
    Image.new("RGB", size).save(path, exif=exif)
    return path


def test_frames_are_in_natural_order_and_times_are_not_known(tmp_path: Path) -> None:
    for name in ("f10.png", "f2.png", "F1.PNG", ".hidden.png"):
        write_image(tmp_path / name)
    (tmp_path / "frames.json").write_text('{"frames": "of another tool"}')
    frames = load_sequence(tmp_path)
    assert [path.name for path in frames.paths] == ["F1.PNG", "f2.png", "f10.png"]
    assert frames.times_s == (None, None, None)
    assert load_sequence(frames.paths[::-1], 2).paths == (frames.paths[0], frames.paths[2])


def test_a_frame_that_cannot_be_read_is_left_out_and_said(tmp_path: Path) -> None:
    for index in range(4):
        write_image(tmp_path / f"f{index}.jpg")
    (tmp_path / "f1.jpg").write_bytes(b"torn")
    frames = load_sequence(tmp_path)
    assert [path.name for path in frames.paths] == ["f0.jpg", "f2.jpg", "f3.jpg"]
    (note,) = frames.notes
    assert note.startswith("1 of 4 frames are left out: f1.jpg: not a picture that can be read")
    for path in tmp_path.iterdir():
        path.write_bytes(b"torn")
    with pytest.raises(PhotoFileError, match=r"f0\.jpg: not a picture"):
        load_sequence(tmp_path)


def test_a_frame_that_is_missing_is_said(tmp_path: Path) -> None:
    for number in (1, 2, 4, 5, 6):
        write_image(tmp_path / f"f{number}.png")
    assert load_sequence(tmp_path).notes == (
        "A frame is missing between f2.png and f4.png; the others go on after it.",
    )
    for number in (10, 20, 30, 40):
        write_image(tmp_path / f"f{number}.png")
        (tmp_path / f"f{number // 10}.png").unlink(missing_ok=True)
    assert [path.name for path in load_sequence(tmp_path).paths][:2] == ["f5.png", "f6.png"]
    for number in (5, 6):
        (tmp_path / f"f{number}.png").unlink()
    assert not load_sequence(tmp_path).notes


@pytest.mark.parametrize(("size", "orientation", "words"), [
    ((6, 8), 1, r"f2\.jpg: 6x8 px, and f1\.jpg has 8x6 px; give frames of one size"),
    ((8, 6), 6, r"f2\.jpg: 6x8 px, and f1\.jpg has 8x6 px"),
    ((8, 6), 3, r"f2\.jpg: its EXIF turns it otherwise than f1\.jpg; give"),
])  # fmt: skip
def test_frames_are_of_one_camera_held_one_way(tmp_path, size, orientation, words):
    write_image(tmp_path / "f1.jpg")
    write_image(tmp_path / "f2.jpg", size, orientation)
    with pytest.raises(PhotoFileError, match=words):
        load_sequence(tmp_path)
    (tmp_path / "f1.jpg").unlink()
    assert len(load_sequence(tmp_path).paths) == 1


def test_what_holds_no_frame_is_said(tmp_path: Path) -> None:
    with pytest.raises(PhotoFileError, match="no image in it; wanted a folder of images"):
        load_sequence(tmp_path)
    with pytest.raises(PhotoFileError, match="no such folder, and no video; wanted"):
        load_sequence(tmp_path / "gone")


def test_ten_thousand_frames_are_listed_by_their_headers(tmp_path: Path) -> None:
    path = tmp_path / "f0.png"
    Image.fromarray(np.zeros((40, 60, 3), np.uint8)).save(path)
    path.write_bytes(path.read_bytes()[:60])  # a header that no reader of pixels takes
    for index in range(1, 10_000):
        os.link(path, tmp_path / f"f{index}.png")
    assert len(load_sequence(tmp_path).paths) == 10_000
