"""Frames of videos: read once, with their times, and what is no video is said."""

import json
import os
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from poseviewer.errors import PhotoFileError
from poseviewer.files import photo, video, video_decoding, video_encoding
from poseviewer.files.checks import InputFile
from poseviewer.files.image_sequence import ImageSequence, load_sequence
from poseviewer.files.photo import load_photo
from poseviewer.files.video import extract_frames, load_record
from poseviewer.files.video_encoding import save_video
from poseviewer.files.writing import sha256_of
from poseviewer.opening.sources import files_below, sort_set
from poseviewer.opening.uploads import keep_set, keep_zip, pack
from tests.videos import (
    RATE,
    bar_of,
    move_index,
    pictures,
    set_durations,
    trim_video,
    turn_video,
    widen_pixels,
    write_interlaced,
    write_jpegs,
    write_pictures,
    write_video,
)


@pytest.fixture
def without_pyav(monkeypatch: pytest.MonkeyPatch) -> None:
    """PyAV is not installed."""
    monkeypatch.setitem(sys.modules, "av", None)  # as Python has what cannot be imported


@pytest.fixture(params=["PyAV", "OpenCV"])
def reader(request: pytest.FixtureRequest) -> None:
    """Videos are read by either library."""
    if request.param == "PyAV":
        pytest.importorskip("av")
    else:
        request.getfixturevalue("without_pyav")


def bars(sequence: ImageSequence) -> list[int]:
    return [bar_of(load_photo(path).pixels) for path in sequence.paths]


def test_every_nth_frame_is_kept_with_its_time(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 20)
    shares = list[float]()
    frames = load_sequence(clip, 3, progress=shares.append)
    assert bars(frames) == [0, 3, 6, 9, 12, 15, 18]
    assert frames.times_s == pytest.approx(np.arange(7) * 0.12)
    assert frames.name == "clip.mp4"
    assert {path.parent for path in frames.paths} == {tmp_path / "clip.mp4.frames"}
    assert not frames.notes
    assert frames.sha256s == tuple(sha256_of(path) for path in frames.paths)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(0.9)


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
    frame = load_photo(load_sequence(clip).paths[0])
    assert (frame.width, frame.height) == (48, 64)


def test_a_video_is_read_once_and_anew_where_it_has_changed(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 12)
    first = load_sequence(clip, 2)
    status = clip.stat()
    clip.write_bytes(bytes(status.st_size))  # a second reading would refuse it
    os.utime(clip, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert load_sequence(clip, 2) == first
    assert load_sequence(clip, 4).paths == first.paths[::2]
    with pytest.raises(PhotoFileError, match="not a video"):
        load_sequence(clip, 3)
    write_video(clip, 6)
    changed = load_sequence(clip, 2)
    assert bars(changed) == [0, 2, 4]
    assert {path.parent.name for path in changed.paths} == {"clip.mp4.2.frames"}
    assert bars(first) == [0, 2, 4, 6, 8, 10]  # poses may be of them
    as_folder = load_sequence(tmp_path / "clip.mp4.2.frames")
    assert as_folder.times_s == pytest.approx([0.0, 0.08, 0.16])
    assert as_folder.sha256s == changed.sha256s


def test_a_copy_of_a_video_has_its_frames_whatever_its_time(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 4)
    first = load_sequence(clip)
    for time in (0, 1):
        os.utime(clip, (time, time))
        written = first.paths[0].stat().st_mtime_ns
        assert load_sequence(clip) == first
        assert first.paths[0].stat().st_mtime_ns == written
        record = load_record(first.paths[0].parent)
        assert record is not None
        assert record.modified_ns == 1e9 * time  # the next time it is not read through


@pytest.mark.parametrize("changes", [1, 2])
def test_a_folder_of_a_video_that_was_replaced_is_opened_by_each_way(tmp_path, changes) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    for count in range(3, 4 + changes):
        clip = write_video(mine / "clip.mp4", count)
        kept = load_sequence(clip, 2)  # the page takes every frame
    assert kept.paths[0].parent.name == f"clip.mp4.{changes + 1}.frames"
    names = [path.relative_to(tmp_path).as_posix() for path in files_below(mine)]
    dropped = keep_set(tmp_path / "uploads", pack((n, (tmp_path / n).read_bytes()) for n in names))
    for folder in (dropped / "mine", mine):
        for _ in range(2):
            opened = load_sequence(sort_set(files_below(folder)).frames)
            assert bars(opened) == list(range(3 + changes))
            assert opened.paths[0].parent == folder / kept.paths[0].parent.name


def test_a_folder_of_a_video_and_a_part_of_its_frames_is_the_whole_video(tmp_path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 6)

    def stop(share: float) -> None:
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load_sequence(clip, progress=stop)
    assert list((tmp_path / "clip.mp4.frames").glob("*.jpg"))
    for _ in range(2):
        opened = sort_set(files_below(tmp_path))
        assert opened.frames == (clip,)
        assert opened.unused == ()
        assert bars(load_sequence(opened.frames)) == list(range(6))


def test_videos_of_one_name_do_not_share_frames(tmp_path: Path) -> None:
    first = load_sequence(write_video(tmp_path / "clip.mp4", 6))
    other = write_pictures(tmp_path / "clip.mov", pictures(6)[::-1])
    second = load_sequence(other)
    assert bars(second) == [5, 4, 3, 2, 1, 0]
    assert bars(first) == list(range(6))
    assert load_sequence(tmp_path / "clip.mp4") == first


def test_frames_of_an_earlier_version_stay_and_the_video_is_read_again(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 3)
    status, old = clip.stat(), tmp_path / "clip.frames"
    old.mkdir()
    (old / "000000.jpg").write_bytes(b"of its twin, maybe")
    known = {"bytes": status.st_size, "modified_ns": status.st_mtime_ns}
    record = {"video": "clip.mp4", **known, "every": [1], "times_s": {"000000.jpg": 0.0}}
    (old / "frames.json").write_text(json.dumps(record))
    assert bars(load_sequence(clip)) == [0, 1, 2]
    with pytest.raises(PhotoFileError, match=r"clip\.frames, which holds other files; name an"):
        load_sequence(clip, folder=old)
    assert (old / "000000.jpg").read_bytes() == b"of its twin, maybe"


@pytest.mark.parametrize("fits", [True, False])
def test_a_record_of_someone_else_leads_nowhere(tmp_path: Path, fits: bool) -> None:
    """Nothing is removed, written or shown by a name in it, in a folder or in a zip."""
    private = tmp_path / "private.jpg"
    private.write_bytes(b"mine")
    clip = write_video(tmp_path / "set" / "clip.mp4", 3)
    names = [str(private), "../../private.jpg", "../clip.mp4", "000000.jpg/../../../private.jpg"]
    status = clip.stat()
    known = {"bytes": status.st_size, "modified_ns": status.st_mtime_ns * fits}
    known |= {"sha256": sha256_of(clip)} if fits else {}
    record = {"video": "clip.mp4", **known, "every": [1], "times_s": dict.fromkeys(names, 0.0)}
    for folder in ("clip.frames", "clip.mp4.frames"):
        (clip.parent / folder).mkdir()
        (clip.parent / folder / "frames.json").write_text(json.dumps(record))
    packed = tmp_path / "set.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for path in files_below(clip.parent):
            archive.write(path, path.relative_to(clip.parent))
    place = keep_zip(tmp_path / "uploads", packed)
    for one in (clip, place / "set" / "clip.mp4"):
        frames = load_sequence(sort_set(files_below(one.parent)).frames)
        assert bars(frames) == [0, 1, 2]
        assert {path.parent.name for path in frames.paths} == {"clip.mp4.2.frames"}
        assert one.exists()
    assert private.read_bytes() == b"mine"


def test_frames_are_written_through_no_link(tmp_path: Path) -> None:
    clip, private = write_video(tmp_path / "clip.mp4", 3), tmp_path / "private"
    private.mkdir()
    (tmp_path / "clip.mp4.frames").symlink_to(private)
    folder = tmp_path / "clip.mp4.2.frames"
    record = {"video": "", "bytes": clip.stat().st_size, "modified_ns": 0}
    folder.mkdir()
    (folder / "frames.json").write_text(json.dumps({**record, "sha256": sha256_of(clip)}))
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(b"mine")
    (folder / "000000.jpg").symlink_to(tmp_path / "a")
    (folder / "000001.part").symlink_to(tmp_path / "b")
    frames = load_sequence(clip)
    assert {path.parent for path in frames.paths} == {folder}
    assert bars(frames) == [0, 1, 2]
    assert not any(path.is_symlink() for path in folder.iterdir())
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes() == b"mine"
    assert not list(private.iterdir())


def test_a_video_is_written_through_no_link(tmp_path: Path) -> None:
    (tmp_path / "mine").write_bytes(b"mine")
    (tmp_path / ".clip.part.mp4").symlink_to(tmp_path / "mine")
    save_video(tmp_path / "clip.mp4", pictures(3), RATE)
    (tmp_path / "link.mp4").symlink_to(tmp_path / "mine")
    with pytest.raises(PhotoFileError, match=r"link\.mp4: is a link and was not written through"):
        save_video(tmp_path / "link.mp4", pictures(3), RATE)
    assert (tmp_path / "mine").read_bytes() == b"mine"
    assert bars(load_sequence(tmp_path / "clip.mp4")) == [0, 1, 2]


@pytest.mark.parametrize("name", ["clip.mp4", "clip.webm"])
def test_a_video_is_written_so_that_browsers_play_it(tmp_path, name):
    pytest.importorskip("av")
    shown = pictures(4, 63, 47)
    assert save_video(tmp_path / name, shown, RATE) == ""
    header = video_decoding.read_header(InputFile(tmp_path / name))
    assert header.codec == ("h264" if name == "clip.mp4" else "VP80")
    assert header.rate == pytest.approx(RATE)
    assert bars(load_sequence(tmp_path / name)) == list(range(4))


@pytest.mark.usefixtures("without_pyav")
def test_of_a_video_that_browsers_do_not_play_it_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(video_encoding, "has_h264", lambda: False)
    monkeypatch.setitem(video_encoding.CODECS, ".mp4", ("mp4v",))
    said = save_video(tmp_path / "clip.mp4", pictures(3), RATE)
    assert said.startswith("Browsers do not play clip.mp4 (mp4v): name it .webm, or pip install")
    assert save_video(tmp_path / "clip.webm", pictures(3), RATE) == ""
    for name in ("clip.mp4", "clip.webm"):
        assert bars(load_sequence(tmp_path / name)) == [0, 1, 2]


def test_a_reading_that_was_broken_off_goes_on(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 12)

    def stop(share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        load_sequence(clip, progress=stop)
    before = sorted((tmp_path / "clip.mp4.frames").glob("*.jpg"))
    assert len(before) == 8
    times = [path.stat().st_mtime_ns for path in before]
    frames = load_sequence(clip)
    assert bars(frames) == list(range(12))
    assert [path.stat().st_mtime_ns for path in before] == times
    frames.paths[3].unlink()
    assert bars(load_sequence(clip)) == list(range(12))


def test_downloads_of_the_user_stay_where_frames_are_kept(tmp_path: Path) -> None:
    folder = tmp_path / "downloads"
    folder.mkdir()
    download, rest = folder / "film.mp4.part", folder / "000001.part"
    download.write_bytes(b"half of it")
    rest.write_bytes(b"of a reading that was broken off")
    extract_frames(write_video(tmp_path / "a.mp4", 3), folder=folder)
    assert download.read_bytes() == b"half of it"
    assert not rest.exists()


def test_a_second_reading_of_a_video_waits_for_the_frames_of_the_first(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 12)
    is_begun, is_awaited = Event(), Event()

    def read_first(_: float) -> None:
        is_begun.set()
        assert is_awaited.wait(60.0)

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(load_sequence, clip, progress=read_first)
        assert is_begun.wait(60.0)
        shares = list[float]()

        def wait(share: float) -> None:
            shares.append(share)
            is_awaited.set()

        second = pool.submit(load_sequence, clip, progress=wait)
        assert second.result() == first.result()
    assert set(shares) == {0.0}  # it has read nothing
    assert bars(first.result()) == list(range(12))
    kept = {path.name for path in (tmp_path / "clip.mp4.frames").iterdir()}
    assert kept == {"frames.json", *(f"{index:06d}.jpg" for index in range(12))}


def test_a_second_reading_reads_the_video_itself_where_the_first_fails(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.mp4", 6)
    is_begun, is_awaited = Event(), Event()

    def fail(_: float) -> None:
        is_begun.set()
        assert is_awaited.wait(60.0)
        raise KeyError

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(load_sequence, clip, progress=fail)
        assert is_begun.wait(60.0)
        second = pool.submit(load_sequence, clip, progress=lambda _: is_awaited.set())
        assert bars(second.result()) == list(range(6))
        with pytest.raises(PhotoFileError):
            first.result()


def test_a_video_that_breaks_off_gives_its_frames_and_a_note(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.avi", 40, "MJPG")
    data = clip.read_bytes()
    clip.write_bytes(data[: len(data) * 6 // 10])
    for _ in range(2):
        frames = load_sequence(clip)
        assert 3 < len(frames.paths) < 30
        assert bars(frames)[:-1] == list(range(len(frames.paths) - 1))  # the last one is torn
        (note,) = frames.notes
        assert note.startswith(f"clip.avi breaks off after {len(frames.paths)} frames, ")
        assert note.endswith(" s of 1.6 s.")


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
    assert not (tmp_path / "clip.mp4.frames").exists()


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
    assert not list((tmp_path / "clip.mp4.frames").glob("*.jpg"))
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
    assert kept == tmp_path / "state" / "frames" / "clip.mp4.frames"
    assert json.loads((kept / "frames.json").read_text())["video"] == "clip.mp4"


@pytest.mark.parametrize("which", [None, [0]])
def test_interlaced_frames_become_one_moment_each(tmp_path, monkeypatch, which):
    """By PyAV. OpenCV says that it reads them, and returns what is in its memory."""
    clip = write_interlaced(tmp_path / "clip.mp4", 8, which)
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "av", None)  # as Python has what cannot be imported
        with pytest.raises(PhotoFileError, match=r"clip\.mp4: its frames are interlaced") as error:
            load_sequence(clip)
    assert "pip install 'poseviewer[video]', or ffmpeg -i clip.mp4 -vf yadif" in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["clip.mp4"]
    pytest.importorskip("av")
    frames = load_sequence(clip)
    assert bars(frames) == list(range(8))
    assert frames.times_s == pytest.approx(0.04 * np.arange(8))
    (note,) = frames.notes
    assert note.startswith("clip.mp4 is interlaced: of each frame one field is kept")
    for path in frames.paths:
        bright = load_photo(path).pixels[8:-8, :, 0] > 120
        assert np.ptp(bright.sum(axis=1)) <= 1  # without the comb of two moments


@pytest.mark.usefixtures("without_pyav")
def test_of_frames_that_are_interlaced_later_it_is_said_that_they_repeat(tmp_path: Path) -> None:
    frames = load_sequence(write_interlaced(tmp_path / "clip.mp4", 8, [3]))
    found = "1 of 8 frames of clip.mp4 repeat the one before; in a video that is interlaced in part"
    assert [note.startswith(found) for note in frames.notes] == [True]


@pytest.mark.usefixtures("without_pyav")
def test_a_video_that_begins_still_is_read_by_opencv(tmp_path):
    shown = [*pictures(1) * 20, *pictures(4)[1:]]
    clip = write_pictures(tmp_path / "clip.avi", shown, "FFV1")
    assert bars(load_sequence(clip)) == [0] * 20 + [1, 2, 3]


def test_what_pyav_reads_is_turned_and_timed_as_by_opencv(tmp_path, monkeypatch):
    pytest.importorskip("av")
    clip = write_video(tmp_path / "clip.mp4", 4)
    turn_video(clip)
    set_durations(clip, [512, 1024, 256, 512])
    by_pyav = load_sequence(clip, folder=tmp_path / "pyav")
    monkeypatch.setitem(sys.modules, "av", None)
    by_opencv = load_sequence(clip, folder=tmp_path / "opencv")
    assert by_pyav.times_s == by_opencv.times_s
    for one, other in zip(by_pyav.paths, by_opencv.paths, strict=True):
        assert np.abs(load_photo(one).pixels - load_photo(other).pixels.astype(int)).max() <= 3


PLAYLISTS = {
    "ffconcat": "ffconcat version 1.0\nfile {}\n",
    "HLS": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:1,\n{}\n#EXT-X-ENDLIST\n",
    "SDP": "v=0\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\ns={}\n",
}


@pytest.mark.parametrize("text", PLAYLISTS.values(), ids=PLAYLISTS)
@pytest.mark.parametrize("name", ["clip.mp4", "clip.mts", "clip.mkv"])
def test_a_text_that_names_other_files_is_no_video(tmp_path, text, name):
    """Neither alone, nor dropped on the page in a zip."""
    private = write_video(tmp_path / "private.mp4", 4)
    packed = tmp_path / "set.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(name, text.format(private))
        archive.write(private, "private.mp4")
        archive.writestr(f"again/{name}", text.format("../private.mp4"))
    (tmp_path / name).write_text(text.format("private.mp4"))
    place = keep_zip(tmp_path / "uploads", packed)
    dropped = [path for path in files_below(place) if path.name == name]
    assert len(dropped) == 2
    for path in (tmp_path / name, *dropped):
        with pytest.raises(PhotoFileError, match="not a video that can be read"):
            load_sequence(sort_set([path]).frames)
        with pytest.raises(PhotoFileError, match="not a video that can be read"):
            extract_frames(path)
        assert not list(path.parent.glob("*.frames"))


def test_pyav_opens_no_playlist_either(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    write_video(tmp_path / "private.mp4", 4)
    clip = tmp_path / "clip.mp4"
    clip.write_text(PLAYLISTS["ffconcat"].format("private.mp4"))
    file = InputFile(clip, [], PhotoFileError, "video")
    header = video_decoding.read_header(InputFile(tmp_path / "private.mp4"))
    with pytest.raises(av.FFmpegError):
        next(video_decoding._by_pyav(file, video_decoding._Shape(file, header, [])))


def test_options_of_the_user_for_ffmpeg_are_kept(monkeypatch):
    monkeypatch.setenv(video_decoding.OPTIONS, "threads;1")
    for _ in range(2):
        video_decoding.prepare_ffmpeg()
    options = os.environ[video_decoding.OPTIONS].split("|")
    assert options[0] == "threads;1"
    assert len(options) == 3


def test_frames_that_are_too_large_are_refused_by_the_header(tmp_path, monkeypatch):
    clip = write_video(tmp_path / "clip.mp4", 4)
    monkeypatch.setattr(photo, "MAX_MEGAPIXELS", 0.003)
    with pytest.raises(PhotoFileError, match="64x48 px; poseviewer takes up to"):
        load_sequence(clip)
    assert [path.name for path in tmp_path.iterdir()] == ["clip.mp4"]


@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize(("across", "down", "turned", "size"), [
    (4, 3, False, (85, 48)), (8, 9, False, (64, 54)), (4, 3, True, (48, 85)),
    (999, 1000, False, (64, 48)), (1, 255, False, (64, 48)), (0, 1, False, (64, 48)),
])  # fmt: skip
def test_pixels_become_square_as_in_players_and_this_is_said(tmp_path, across, down, turned, size):
    clip = write_video(tmp_path / "clip.mp4", 6)
    if turned:
        turn_video(clip)
    widen_pixels(clip, across, down)
    frames = load_sequence(clip)
    whole = load_photo(frames.paths[5]).pixels
    assert whole.shape[1::-1] == size
    if turned:
        whole = np.rot90(whole)
    bright = float((whole[whole.shape[0] // 2, :, 0] > 120).mean())
    assert bright == pytest.approx(12 / 64, abs=0.02)
    stored = "48x64 px" if turned else "64x48 px"
    said = f"clip.mp4 has pixels that are not square: its frames of {stored} are resized to "
    is_resized = size != (64, 48)
    assert frames.notes == (f"{said}{size[0]}x{size[1]} px, as in players.",) * is_resized


@pytest.mark.usefixtures("reader")
def test_frames_whose_size_changes_become_one_size_and_this_is_said(tmp_path: Path) -> None:
    shown = pictures(8)
    shown[4:] = [picture[::2, ::2] for picture in shown[4:]]
    frames = load_sequence(write_jpegs(tmp_path / "clip.webm", shown))
    assert {load_photo(path).pixels.shape for path in frames.paths} == {(48, 64, 3)}
    assert bars(frames) == list(range(8))
    found = "clip.webm: its frames change from 64x48 px to 32x24 px; all are resized to 64x48 px."
    assert frames.notes == (found,)


@pytest.mark.usefixtures("reader")
def test_frames_whose_shape_changes_are_refused(tmp_path: Path) -> None:
    shown = [*pictures(4), *pictures(4, 48, 64)]
    words = r"64x48 px to 48x64 px, of another shape; cut it where that changes"
    with pytest.raises(PhotoFileError, match=words):
        load_sequence(write_jpegs(tmp_path / "clip.webm", shown))


@pytest.mark.usefixtures("reader")
def test_frames_whose_pixel_format_changes_have_the_right_colours(tmp_path: Path) -> None:
    sampling = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444
    clip = write_jpegs(tmp_path / "clip.avi", pictures(5), sampling=sampling)
    frames = load_sequence(clip)
    assert bars(frames) == list(range(5))
    assert not frames.notes
    for path in frames.paths:
        assert load_photo(path).pixels[10, 0].astype(float) == pytest.approx([200, 120, 60], abs=12)


@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize("every", [1, 3])
def test_frames_of_a_browsers_recording_are_counted_and_not_guessed(tmp_path, monkeypatch, every):
    """Of 12 frames at odd times, the length of the file and its unit of time make 3000."""
    monkeypatch.setattr(video, "MAX_FRAMES", 20)
    times = [0, 244, 496, 797, 1137, 1293, 1471, 1785, 2124, 2323, 2535, 2960]
    clip = write_jpegs(tmp_path / "clip.webm", pictures(12), times)
    shares = list[float]()
    frames = load_sequence(clip, every, progress=shares.append)
    assert bars(frames) == list(range(0, 12, every))
    assert frames.times_s == pytest.approx(np.array(times[::every]) / 1000.0)
    assert not frames.notes
    assert shares[len(shares) // 2] == pytest.approx(times[6] / 3000.0, abs=0.01)


@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize(("first", "count"), [(12, 12), (0, 12), (6, 12)])
def test_a_trimmed_video_has_the_frames_that_players_show(tmp_path, first, count) -> None:
    clip = write_video(tmp_path / "clip.mp4", 24)
    trim_video(clip, first, count)
    frames = load_sequence(clip)
    assert bars(frames)[:count] == list(range(first, first + count))
    assert len(frames.paths) <= count + 1  # players round the end
    assert not frames.notes


@pytest.mark.usefixtures("reader")
@pytest.mark.parametrize(("name", "damage"), [
    ("clip.mp4", "cut off"), ("clip.mp4", "zeros"), ("clip.webm", "cut off"),
])  # fmt: skip
def test_what_was_lost_of_a_video_is_said(tmp_path, name, damage) -> None:
    codec = "mp4v" if name == "clip.mp4" else "VP90"
    noise = np.random.default_rng(0).integers(0, 255, (40, 48, 64, 3), np.uint8)
    clip = write_pictures(tmp_path / name, [*noise], codec)
    if name == "clip.mp4":
        move_index(clip)
    data = clip.read_bytes()
    half = len(data) * 6 // 10
    clip.write_bytes(data[:half] + (bytes(len(data) - half) if damage == "zeros" else b""))
    frames = load_sequence(clip)
    count = len(frames.paths)
    assert 10 < count < 30
    note = frames.notes[0]
    assert note.startswith(f"{name} breaks off after {count} frames, {0.04 * (count - 1):.1f} s of")


def test_a_cover_is_no_frame(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    clip = tmp_path / "clip.mp4"
    with av.open(str(clip), "w") as container:
        streams = [container.add_stream(codec, rate=25) for codec in ("mjpeg", "mpeg4")]
        streams[0].disposition = av.stream.Disposition.attached_pic
        for stream, pixels in zip(streams, ("yuvj420p", "yuv420p"), strict=True):
            stream.width, stream.height, stream.pix_fmt = 64, 48, pixels
        cover = np.full((48, 64, 3), (200, 0, 0), np.uint8)
        for stream, shown in zip(streams, ([cover], pictures(5)), strict=True):
            for picture in shown:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
            container.mux(stream.encode(None))
    assert bars(load_sequence(clip)) == list(range(5))


@pytest.mark.parametrize("name", ["stack.tif", "moving.png", "moving.webp"])
def test_the_pages_of_a_picture_are_frames_where_frames_are_wanted(tmp_path, name):
    shown = [Image.fromarray(picture) for picture in pictures(5)]
    how: dict[str, Any] = {"duration": [40, 60, 100, 40, 40]} if name != "stack.tif" else {}
    shown[0].save(tmp_path / name, save_all=True, append_images=shown[1:], **how)
    for frames in (load_sequence(tmp_path / name), load_sequence([tmp_path / name])):
        assert bars(frames) == list(range(5))
        times = [None] * 5 if name == "stack.tif" else [0.0, 0.04, 0.1, 0.2, 0.24]
        assert frames.times_s == pytest.approx(times)
        assert not frames.notes
    assert bars(load_sequence(tmp_path / name, 2)) == [0, 2, 4]
    shown[0].save(tmp_path / name)
    assert len(load_sequence([tmp_path / name]).paths) == 1


def test_pages_of_16_bits_are_frames(tmp_path: Path) -> None:
    deep = [Image.fromarray(np.full((6, 8), 256 * level, np.uint16)) for level in (40, 90)]
    deep[0].save(tmp_path / "a.tif", save_all=True, append_images=deep[1:])
    frames = load_sequence(tmp_path / "a.tif")
    levels = [float(load_photo(path).pixels.mean()) for path in frames.paths]
    assert levels == pytest.approx([40.0, 90.0], abs=1.0)
