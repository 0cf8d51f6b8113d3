"""Frames of videos: read once, with their times, and what is no video is said."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from poseviewer.errors import PhotoFileError
from poseviewer.files import video
from poseviewer.files.image_sequence import ImageSequence, load_sequence
from poseviewer.files.photo import load_photo
from tests.videos import bar_of, set_durations, turn_video, write_video


def bars(sequence: ImageSequence) -> list[int]:
    return [bar_of(load_photo(path).pixels) for path in sequence.paths]


def test_every_nth_frame_is_kept_with_its_time(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 20)
    shares = list[float]()
    frames = load_sequence(clip, 3, progress=shares.append)
    assert bars(frames) == [0, 3, 6, 9, 12, 15, 18]
    assert frames.times_s == pytest.approx(np.arange(7) * 0.12)
    assert frames.name == "clip.mp4"
    assert {path.parent for path in frames.paths} == {tmp_path / "clip.frames"}
    assert not frames.notes
    assert shares == sorted(shares)
    assert shares[-1] == 0.9


def test_the_times_are_those_of_the_frames_whatever_the_rate(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 20)
    ticks = [512] * 5 + [1024] * 5 + [256] * 10
    set_durations(clip, ticks)
    frames = load_sequence(clip)
    assert bars(frames) == list(range(20))
    assert frames.times_s == pytest.approx(np.cumsum([0, *ticks[:-1]]) / 512 / 25.0)


def test_a_video_of_a_phone_is_upright(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 2)
    turn_video(clip)
    photo = load_photo(load_sequence(clip).paths[0])
    assert (photo.width, photo.height) == (48, 64)


def test_a_video_is_read_once_and_anew_where_it_has_changed(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 12)
    first = load_sequence(clip, 2)
    times = [path.stat().st_mtime_ns for path in first.paths]
    status = clip.stat()
    clip.write_bytes(bytes(status.st_size))  # a second reading would refuse it
    os.utime(clip, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert load_sequence(clip, 2) == first
    assert load_sequence(clip, 4).paths == first.paths[::2]
    with pytest.raises(PhotoFileError, match="not a video"):
        load_sequence(clip, 3)
    write_video(clip, 6)
    assert bars(load_sequence(clip, 2)) == [0, 2, 4]
    assert not first.paths[-1].exists()
    assert first.paths[0].stat().st_mtime_ns > times[0]
    as_folder = load_sequence(tmp_path / "clip.frames")
    assert as_folder.times_s == pytest.approx([0.0, 0.08, 0.16])


def test_a_reading_that_was_broken_off_goes_on(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 12)

    def stop(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load_sequence(clip, progress=stop)
    before = sorted((tmp_path / "clip.frames").glob("*.jpg"))
    assert len(before) == 8
    times = [path.stat().st_mtime_ns for path in before]
    frames = load_sequence(clip)
    assert bars(frames) == list(range(12))
    assert [path.stat().st_mtime_ns for path in before] == times
    frames.paths[3].unlink()
    assert bars(load_sequence(clip)) == list(range(12))


def test_a_video_that_breaks_off_gives_its_frames_and_a_note(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.avi", 40, "MJPG")
    data = clip.read_bytes()
    clip.write_bytes(data[: len(data) * 6 // 10])
    for _ in range(2):
        frames = load_sequence(clip)
        assert 3 < len(frames.paths) < 30
        assert bars(frames)[:-1] == list(range(len(frames.paths) - 1))  # the last one is torn
        said = f"clip.avi breaks off after {len(frames.paths)} of 40 frames."
        assert frames.notes == (said,)


@pytest.mark.parametrize(("data", "words"), [
    (b"no video" * 99, "clip.mp4: not a video that can be read; is it whole"),
    (b"", "clip.mp4: an empty file; wanted a video"),
    (None, "clip.mp4: no such file"),
])  # fmt: skip
def test_what_is_no_video_is_said(tmp_path: Path, data, words) -> None:
    if data is not None:
        (tmp_path / "clip.mp4").write_bytes(data)
    with pytest.raises(PhotoFileError, match=words):
        load_sequence(tmp_path / "clip.mp4")
    assert not (tmp_path / "clip.frames").exists()


def test_a_video_without_a_frame_is_said(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.avi", 3, "MJPG")
    data = clip.read_bytes()
    clip.write_bytes(data[: data.index(b"movi") + 4])
    with pytest.raises(
        PhotoFileError, match=r"clip\.avi: (no frame in it|not a video that) can be"
    ):
        load_sequence(clip)


def test_too_many_frames_are_said_before_they_fill_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "MAX_FRAMES", 5)
    clip = write_video(tmp_path / "clip.mp4", 12)
    with pytest.raises(PhotoFileError, match="more than 5 frames; take fewer of them, every=3"):
        load_sequence(clip, 2)
    assert not list((tmp_path / "clip.frames").glob("*.jpg"))
    assert len(load_sequence(clip, 3).paths) == 4


def test_frames_are_kept_elsewhere_where_the_user_says_or_the_disk_wants_it(tmp_path, monkeypatch):
    clip = write_video(tmp_path / "clip.mp4", 2)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "000000.jpg").write_bytes(b"another one")
    with pytest.raises(PhotoFileError, match="mine, which holds other files; name an empty"):
        load_sequence(clip, folder=tmp_path / "mine")
    (tmp_path / "mine" / "000000.jpg").rename(tmp_path / "mine" / "frames.json")
    with pytest.raises(PhotoFileError, match="mine, which holds other files; name an empty"):
        load_sequence(clip, folder=tmp_path / "mine")
    assert load_sequence(clip, folder=tmp_path / "own").paths[0].parent == tmp_path / "own"
    monkeypatch.setenv("POSEVIEWER_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(os, "access", lambda *_: False)
    kept = load_sequence(clip).paths[0].parent
    assert kept.parent == tmp_path / "state" / "frames"
    assert json.loads((kept / "frames.json").read_text())["video"] == "clip.mp4"
