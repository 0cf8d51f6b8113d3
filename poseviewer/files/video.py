"""Videos, read forward once: every N-th frame becomes a JPEG with its time stamp.

A record beside the JPEGs says of which video they are, so that it is read once, and has the
fingerprint of each, by which poses know their frames.
"""

import hashlib
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import chain, count, islice, pairwise
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct, structs
from numpy.typing import NDArray

from poseviewer.errors import PhotoFileError, PoseViewerError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, Number, quiet_libraries
from poseviewer.files.state.folder import state_folder
from poseviewer.files.structs import Sha256
from poseviewer.files.video_decoding import (
    breaks_off,
    decode_video,
    has_more_frames,
    read_header,
    stored_times,
)
from poseviewer.files.writing import (
    lock_file,
    make_folder,
    sha256_of,
    write_json,
    writing_to,
)

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".mts", ".3gp")
RECORD = "frames.json"
LOCK = ".at-work"
"""File that is locked while a video is read; others wait for its frames."""
WAIT_S = 0.2
"""Time between two looks at the lock, s."""
FRAME = re.compile(r"[0-9]{6,}\.jpg")
"""Names of frames' files, of which a record has no others."""
KEPT = re.compile(r"(\.[0-9]+)?\.frames")
"""Ends of the names of folders that frames are kept in, after the video's."""
MAX_VIDEO_BYTES = 10**12
MAX_FRAMES = 20_000
"""Limit of the frames kept: 2 GB of 640x480 px."""
JPEG_QUALITY = 95
SURVEYED = 10
"""Frames by which it is told how long reading takes."""

Step = Annotated[int, Meta(ge=1)]


class VideoRecord(Struct, frozen=True, kw_only=True):
    """The frames of a video that are kept in a folder, and the steps in which it was read."""

    video: str
    bytes: int
    modified_ns: int
    sha256: Sha256 | None = None
    """Fingerprint of the video; None in records of versions that did not keep frames apart."""
    every: tuple[Step, ...] = ()
    times_s: dict[str, Number] = {}
    """Time stamps from the first frame, s, by the frames' files, which their numbers name."""
    sha256s: dict[str, Sha256] = {}
    """Fingerprints of the frames' files."""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.times_s:
            if not FRAME.fullmatch(name):
                raise ValueError(f".times_s has {name[:40]!r}; wanted names such as 000120.jpg")

    def names(self, every: int) -> list[str]:
        """Return the files of every N-th frame, in order."""
        chosen = (name for name in self.times_s if not _number_of(name) % every)
        return sorted(chosen, key=_number_of)

    def has(self, every: int) -> bool:
        """Tell whether every N-th frame was read."""
        return any(every % step == 0 for step in self.every)


def extract_frames(
    video: Path, every: int = 1, folder: Path | None = None,
    progress: Callable[[float], object] | None = None,
) -> tuple[Path, VideoRecord]:  # fmt: skip
    """Keep every N-th frame of a video as a JPEG, unless that was done; return folder and record.
    Frames of another video, or of the video as it was before, are left alone. While another process
    reads the video, its frames are waited for.

    Args:
        video: its file.
        every: number N.
        folder: where the frames are kept; None: ``VIDEO.frames`` beside it, or in the folder of
            state where that cannot be written; ``VIDEO.2.frames`` where that is of another video.
        progress: is given the share that has been read, now and then.

    Raises:
        PhotoFileError: it is no video, or holds no frame, or too many, or too large ones; it is
            interlaced, and PyAV is not installed; the folder holds images of something else, or
            cannot be written.
    """
    with _video_input(video) as file:
        status, sha256 = video.stat(), cache(lambda: sha256_of(video))

        def record_in(place: Path) -> VideoRecord | None:
            """The record in a folder, if its frames are of the video."""
            known = load_record(place)
            if known is None or known.sha256 is None or known.bytes != status.st_size:
                return None
            is_of_video = known.modified_ns == status.st_mtime_ns or known.sha256 == sha256()
            return known if is_of_video else None

        def find() -> tuple[Path, VideoRecord, bool]:
            """The folder of the frames, its record, and whether all frames are there."""
            for place in _places_of(video) if folder is None else [folder]:
                stored = record_in(place)
                if stored is not None or _is_free(place):
                    break
            else:
                found = f"its frames belong into {folder}, which holds other files"
                raise file.error(found, "name an empty folder")
            about = {"video": video.name, "modified_ns": status.st_mtime_ns}
            if stored is None:
                return place, VideoRecord(**about, bytes=status.st_size, sha256=sha256()), False
            known = structs.replace(stored, **about)
            is_read = known.has(every) and all(_is_frame(place / n) for n in known.names(every))
            if is_read and known != stored:  # a copy of the video, with another time
                with suppress(PhotoFileError):
                    _save_record(place, known)
            return place, known, is_read

        tell = progress or (lambda _: None)
        while True:
            place, known, is_read = find()
            if is_read:
                return place, known
            with _locked(place, tell):
                again, known, is_read = find()
                if again == place and not is_read:
                    return place, _keep_frames(file, every, place, known, tell)


@contextmanager
def _video_input(video: Path) -> Iterator[InputFile]:
    """Open a video whose size is checked; libraries are quiet, and their errors name the file."""
    file = InputFile(video, [], PhotoFileError, "video", MAX_VIDEO_BYTES)
    with file.naming_errors(), quiet_libraries():
        file.check_size()
        yield file


@contextmanager
def _locked(folder: Path, progress: Callable[[float], object]) -> Iterator[None]:
    """Make a folder and hold it, once nobody else writes frames to it."""
    lock = None
    while lock is None:
        make_folder(folder, PhotoFileError)
        with writing_to(folder, RECORD, PhotoFileError), suppress(FileNotFoundError):
            lock = lock_file(folder / LOCK)
        if lock is None:
            progress(0.0)
            time.sleep(WAIT_S)
    try:
        yield
    finally:
        with suppress(OSError):  # before it is let go: whoever waits sees that it is gone
            (folder / LOCK).unlink()
        lock.close()
        if not _has_frames(folder):
            with suppress(OSError):
                folder.rmdir()


def _keep_frames(
    file: InputFile,
    every: int,
    folder: Path,
    known: VideoRecord,
    progress: Callable[[float], object],
) -> VideoRecord:
    """Read the frames into a folder that is held; return its new record."""
    for part in folder.glob("*.part"):
        if FRAME.fullmatch(f"{part.stem}.jpg"):  # others are the user's
            part.unlink()
    _save_record(folder, structs.replace(known, every=()))
    try:
        known = _read(file, every, folder, known, progress)
    finally:
        if not _has_frames(folder):  # nothing to go on with
            (folder / RECORD).unlink()
    _save_record(folder, known)
    return known


def _has_frames(folder: Path) -> bool:
    return any(folder.glob("*.jpg"))


def describe_video(video: Path) -> dict[str, str]:
    """Describe what a video is, in words: its frames, size, rate, length, codec.

    Raises:
        PhotoFileError: it is no video, or its frames are too large.
    """
    with _video_input(video) as file:
        header, times = read_header(file), stored_times(file)
    count = len(times)
    if count > 1 and times[-1] > times[0]:
        length = (times[-1] - times[0]) * count / (count - 1)
    else:
        length = header.length_s
    sides, shown = (header.width, header.height), header.shown_size(header.width, header.height)
    said = {"size": "{} x {} px".format(*shown), "frames": f"{count:,} in the file"}
    if shown != sides:
        said["size"] += ", of {} x {} px that are not square".format(*sides)
    if length:
        said["frames"] += f", {count / length:.4g} a second"
        said["length"] = f"{length:.4g} s"
    if header.turned_deg:
        way = "counterclockwise" if header.turned_deg > 180 else "clockwise"
        angle = min(header.turned_deg, 360 - header.turned_deg)
        said["turned"] = f"by {angle} degrees {way}, which the size says already"
    return said | {"codec": header.codec or "not said"}


def survey_video(video: Path) -> tuple[int, float]:
    """Return the number of frames in a video's file, and about how long reading one takes, s.

    Raises:
        PhotoFileError: it is no video, or its frames cannot be read.
    """
    with _video_input(video) as file:
        count = len(stored_times(file))
        with decode_video(file) as decoded:
            began, read = time.monotonic(), 0
            for _, make_picture in islice(decoded.frames, SURVEYED):
                picture = make_picture()
                if picture is not None:
                    _encode(picture)
                read += 1
        return count, (time.monotonic() - began) / max(read, 1)


def load_record(folder: Path) -> VideoRecord | None:
    """Load what a folder of a video's frames says of them; None: it is not one."""
    file = InputFile(folder / RECORD, kind="list of frames", largest=MAX_DATA_BYTES)
    with suppress(PoseViewerError):
        return file.decode(file.load_object(), VideoRecord)
    return None


def _save_record(folder: Path, record: VideoRecord) -> None:
    """Write the record of a folder; it is our own, even where it came in with the user's files."""
    write_json(folder / RECORD, record, PhotoFileError, indent=0, is_own=True)


def _read(
    file: InputFile,
    every: int,
    folder: Path,
    known: VideoRecord,
    progress: Callable[[float], object],
) -> VideoRecord:
    begun: float | None = None
    index, times, sha256s = -1, dict[str, float](), dict[str, str]()
    with decode_video(file) as video:
        header = video.header
        if has_more_frames(file, header, every * MAX_FRAMES):
            raise _too_many(file, len(stored_times(file)))
        said = max(header.frames, 1.0)
        for index, (time, make_picture) in enumerate(video.frames):
            if index % every:
                continue
            if len(times) == MAX_FRAMES:
                raise _too_many(file, max(len(stored_times(file)), index + 1))
            name = f"{index:06d}.jpg"
            if _is_frame(folder / name):
                sha256s[name] = known.sha256s.get(name) or sha256_of(folder / name)
            elif (picture := make_picture()) is not None:
                sha256s[name] = _save_frame(folder / name, picture)
            if name in sha256s:
                times[name] = time
            begun = time if begun is None else begun
            # By time, as the number of frames may be guessed; some videos have no times.
            progress(min(max(index, (time - begun) * header.rate) / said, 1.0))
    if not times:
        raise file.error("no frame in it can be read", "is it whole? Copy it again")
    if np.any(np.diff(list(times.values())) <= 0.0) and header.rate > 0.0:  # it has no time stamps
        times = {name: _number_of(name) / header.rate for name in times}
    first, notes = next(iter(times.values())), video.notes
    if breaks_off(file, header, index + 1):
        spans = f"{list(times.values())[-1] - first:.1f} s of {header.length_s:.1f} s"
        notes.append(f"{file.path.name} breaks off after {index + 1:,} frames, {spans}.")
    if repeated := sum(a == b for a, b in pairwise(sha256s.values())):
        found = f"{repeated:,} of {len(sha256s):,} frames of {file.path.name} repeat the one before"
        notes.append(f"{found}; in a video that is interlaced in part, they are not read.")
    times = known.times_s | {name: round(time - first, 6) for name, time in times.items()}
    read = {"times_s": times, "sha256s": known.sha256s | sha256s, "notes": tuple(notes)}
    return structs.replace(known, every=(*known.every, every), **read)


def _too_many(file: InputFile, count: int) -> PoseViewerError:
    found = f"more than {MAX_FRAMES:,} frames"
    return file.error(found, f"take fewer of them, every={-(-count // MAX_FRAMES)} or more")


def _save_frame(path: Path, bgr: NDArray) -> str:
    """Write a JPEG, whole or not: a reading that was broken off goes on after it. Return its
    fingerprint.
    """
    part, data = path.with_suffix(".part"), _encode(bgr)
    with writing_to(path.parent, path.name, PhotoFileError):
        part.unlink(missing_ok=True)
        with part.open("xb") as opened:  # through no link
            opened.write(data)
        part.replace(path)
    return hashlib.sha256(data).hexdigest()


def _encode(bgr: NDArray) -> bytes:
    picture = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    return np.asarray(picture).tobytes()


def _number_of(name: str) -> int:
    return int(name.removesuffix(".jpg"))


def _is_frame(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _is_free(folder: Path) -> bool:
    """Tell whether frames can be kept in a folder: it has no images, or is not there."""
    if not folder.is_dir():
        return not os.path.lexists(folder)
    return not (any(folder.glob("*.jpg")) or os.path.lexists(folder / RECORD))


def is_kept_of(video: Path, path: Path) -> bool:
    """Tell whether a file lies where the frames of a video are kept beside it."""
    folder, beside = path.parent, path.parent.parent == video.parent
    return beside and bool(KEPT.fullmatch(folder.name.removeprefix(video.name)))


def _places_of(video: Path) -> Iterator[Path]:
    """Yield the folders in which a video's frames may be; none is a link to elsewhere."""
    parent = video.parent if os.access(video.parent, os.W_OK) else state_folder() / "frames"
    for more in chain([""], map(".{}".format, count(2))):
        folder = parent / f"{video.name}{more}.frames"
        if not folder.is_symlink():
            yield folder
