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


def test_frames_that_the_memory_does_not_hold_are_refused_by_their_header(tmp_path, monkeypatch):
    for name in ("f1.png", "f2.png"):
        write_image(tmp_path / name, (80, 60))
    monkeypatch.setattr("poseviewer.files.photo.memory_bytes", lambda: 480_000)
    assert len(load_sequence(tmp_path).paths) == 2
    monkeypatch.setattr("poseviewer.files.photo.memory_bytes", lambda: 479_999)
    said = r"^f1\.png: 80x60 px, which take 0\.0 GB of memory to track; this machine has 0\.0, make"
    with pytest.raises(PhotoFileError, match=said):
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


def write_depth(path: Path, size: tuple[int, int] = (8, 6)) -> Path:
    Image.fromarray(np.full(size[::-1], 9000, np.uint16)).save(path)
    return path


@pytest.mark.parametrize(("colour", "others"), [
    ("{:06}-color.png", ["{:06}-depth.png", "{:06}-label.png"]),  # YCB-Video
    ("frame-{:06}.color.jpg", ["frame-{:06}.depth.png"]),  # 7-Scenes
    ("{:04}.jpg", ["{:04}.png"]),
    ("rgb{}.png", ["d{}.png"]),
])  # fmt: skip
def test_colour_is_told_from_depth_and_labels_beside_it(tmp_path, colour, others):
    for number in range(1, 5):
        write_image(tmp_path / colour.format(number))
        write_depth(tmp_path / others[0].format(number), (4, 3))
        for name in others[1:]:
            Image.new("L", (8, 6)).save(tmp_path / name.format(number))
    for frames in (load_sequence(tmp_path), load_sequence(list(tmp_path.iterdir()))):
        assert [path.name for path in frames.paths] == [colour.format(n) for n in range(1, 5)]
        (note,) = frames.notes
        found = f"{4 * len(others)} of {4 + 4 * len(others)} images are left out, as their names"
        assert note.startswith(f"{found} are of another kind than {colour.format(1)}, the first")


@pytest.mark.parametrize(("names", "taken"), [
    (["left1.png", "left2.png", "left3.png", "right1.png", "right2.png", "right3.png"],
     ["left1.png", "left2.png", "left3.png"]),
    (["cam1_7.png", "cam1_8.png", "cam2_7.png", "cam2_8.png"], ["cam1_7.png", "cam1_8.png"]),
    (["7_cam1.png", "7_cam2.png", "8_cam1.png", "8_cam2.png", "9_cam1.png", "9_cam2.png"],
     ["7_cam1.png", "8_cam1.png", "9_cam1.png"]),
    (["s7.PNG", "s8.png", "s9.png", "s8 (1).png", "s9 - Copy.png"], ["s7.PNG", "s8.png", "s9.png"]),
])  # fmt: skip
def test_one_of_several_kinds_of_names_is_taken_and_said(tmp_path, names, taken):
    for name in names:
        write_image(tmp_path / name)
    frames = load_sequence(tmp_path)
    assert [path.name for path in frames.paths] == taken
    (note,) = frames.notes
    assert all(name in note for name in names if name not in taken)


@pytest.mark.parametrize("names", [
    ["a.png", "b.png", "c.png"], ["0a1f.png", "7bb2.png", "9c.png", "e55d3.png"],
    ["20210312_235959.png", "20210313_000001.png", "20210313_000002.png", "20210313_000003.png"],
    ["v1.png", "v2.jpg", "v3.PNG"], ["1.8.png", "1.9.png", "1.10.png", "1.11.png"],
])  # fmt: skip
def test_names_that_tell_no_kinds_apart_are_all_taken(tmp_path, names):
    for name in names:
        write_image(tmp_path / name)
    frames = load_sequence(tmp_path)
    assert [path.name for path in frames.paths] == names
    assert frames.times_s == (None,) * len(names)


def test_depth_among_frames_of_like_names_is_left_out_and_said(tmp_path: Path) -> None:
    for number in (1, 3, 5):
        write_image(tmp_path / f"{number}.png")
        write_depth(tmp_path / f"{number + 1}.png", (4, 3))
    frames = load_sequence(tmp_path)
    assert [path.name for path in frames.paths] == ["1.png", "3.png", "5.png"]
    found = "3 images of 16 bits among others are left out: 2.png, 4.png, 6.png."
    assert frames.notes == (found,)
    for number in (1, 3, 5):
        (tmp_path / f"{number}.png").unlink()
    assert len(load_sequence(tmp_path).paths) == 3


def test_seconds_in_names_are_ordered_and_are_the_times(tmp_path: Path) -> None:
    names = ("9.95", "10.0", "12.4", "12.45", "12.5", "12.55", "12.6", "13")
    for name in names:
        write_image(tmp_path / f"{name}.png")
    frames = load_sequence(tmp_path)
    assert [path.stem for path in frames.paths] == [*names]
    assert frames.times_s == pytest.approx([float(name) - 9.95 for name in names])
    assert not frames.notes


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
