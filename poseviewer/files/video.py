"""Videos, read forward once: every N-th frame becomes a JPEG with its time stamp.

A record beside the JPEGs says of which video they are, so that it is read once, and has the
fingerprint of each, by which poses know their frames.
"""

import hashlib
import os
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache
from itertools import chain, count, pairwise
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
from poseviewer.files.video_decoding import decode_video, prepare_ffmpeg
from poseviewer.files.writing import (
    make_folder,
    require_replaceable,
    sha256_of,
    write_json,
    writing_to,
)

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".mts", ".3gp")
RECORD = "frames.json"
FRAME = re.compile(r"[0-9]{6,}\.jpg")
"""Names of frames' files, of which a record has no others."""
MAX_VIDEO_BYTES = 10**12
MAX_FRAMES = 20_000
"""Limit of the frames kept: 2 GB of 640x480 px."""
JPEG_QUALITY = 95
CODECS = {".mp4": ("avc1", "mp4v"), ".webm": ("VP90",), ".avi": ("MJPG",)}
"""Codecs of videos that are written, best first: H.264 is not on every machine."""
MIN_READ = 0.9
"""Share of the frames that the file announces, below which it breaks off: some only estimate it."""

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
    Frames of another video, or of the video as it was before, are left alone.

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
    file = InputFile(video, [], PhotoFileError, "video", MAX_VIDEO_BYTES)
    with file.naming_errors(), quiet_libraries():
        file.check_size()
        status, sha256 = video.stat(), cache(lambda: sha256_of(video))

        def record_in(place: Path) -> VideoRecord | None:
            """The record in a folder, if its frames are of the video."""
            known = load_record(place)
            if known is None or known.sha256 is None or known.bytes != status.st_size:
                return None
            is_of_video = known.modified_ns == status.st_mtime_ns or known.sha256 == sha256()
            return known if is_of_video else None

        for place in _places_of(video) if folder is None else [folder]:
            stored = record_in(place)
            if stored is not None or _is_free(place):
                break
        else:
            found = f"its frames belong into {folder}, which holds other files"
            raise file.error(found, "name an empty folder")
        folder = place
        about = {"video": video.name, "modified_ns": status.st_mtime_ns}
        if stored is None:
            known = VideoRecord(**about, bytes=status.st_size, sha256=sha256())
        else:
            known = structs.replace(stored, **about)
        if known.has(every) and all(_is_frame(folder / name) for name in known.names(every)):
            if known != stored:  # a copy of the video, with another time
                with suppress(PhotoFileError):
                    _save_record(folder, known)
            return folder, known
        make_folder(folder, PhotoFileError)
        _save_record(folder, structs.replace(known, every=()))
        try:
            known = _read(file, every, folder, known, progress or (lambda _: None))
        finally:
            if not any(folder.glob("*.jpg")):  # nothing to go on with
                (folder / RECORD).unlink()
                with suppress(OSError):
                    folder.rmdir()
        _save_record(folder, known)
        return folder, known


def save_video(path: Path, pictures: Iterable[NDArray[np.uint8]], rate: float) -> None:
    """Write a video, whole or not.

    Args:
        path: file, .mp4, .webm or .avi.
        pictures: (height, width, 3), RGB, of one size.
        rate: frames a second.

    Raises:
        PhotoFileError: it cannot be written.
    """
    file = InputFile(path, [], PhotoFileError, "video")
    if path.suffix.lower() not in CODECS:
        found = f"videos cannot be written as {path.suffix!r}"
        raise file.error(found, f"name it {' or '.join(CODECS)}")
    prepare_ffmpeg()
    require_replaceable(path, PhotoFileError)
    part, writer = path.with_name(f".{path.stem}.part{path.suffix}"), None
    try:
        part.unlink(missing_ok=True)  # it may be a link
        for picture in pictures:
            size = picture.shape[1::-1]
            if writer is None:
                with quiet_libraries():
                    for codec in CODECS[path.suffix.lower()]:
                        code = cv2.VideoWriter.fourcc(*codec)
                        writer = cv2.VideoWriter(str(part), cv2.CAP_FFMPEG, code, rate, size)
                        if writer.isOpened():
                            break
                    else:
                        raise file.error("cannot be written", "is the folder yours to write to?")
            writer.write(np.ascontiguousarray(picture[..., ::-1]))
        if writer is not None:
            writer.release()
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)


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
    index, times, sha256s = -1, dict[str, float](), dict[str, str]()
    with decode_video(file) as video:
        said = video.announced
        for index, (time, make_picture) in enumerate(video.frames):
            if index % every:
                continue
            if max(len(times) + 1, said / every) > MAX_FRAMES:
                least = int(max(said, index + 1) // MAX_FRAMES + 1)
                found = f"more than {MAX_FRAMES:,} frames"
                raise file.error(found, f"take fewer of them, every={least} or more")
            name = f"{index:06d}.jpg"
            if _is_frame(folder / name):
                sha256s[name] = known.sha256s.get(name) or sha256_of(folder / name)
            elif (picture := make_picture()) is not None:
                sha256s[name] = _save_frame(folder / name, picture)
            if name in sha256s:
                times[name] = time
            progress(index / max(said, 1.0))
    if not times:
        raise file.error("no frame in it can be read", "is it whole? Copy it again")
    if np.any(np.diff(list(times.values())) <= 0.0) and video.rate > 0.0:  # it has no time stamps
        times = {name: _number_of(name) / video.rate for name in times}
    first, notes = next(iter(times.values())), video.notes
    if index + 1 < MIN_READ * said:
        notes.append(f"{file.path.name} breaks off after {index + 1:,} of {said:,.0f} frames.")
    if repeated := sum(a == b for a, b in pairwise(sha256s.values())):
        found = f"{repeated:,} of {len(sha256s):,} frames of {file.path.name} repeat the one before"
        notes.append(f"{found}; in a video that is interlaced in part, they are not read.")
    times = known.times_s | {name: round(time - first, 6) for name, time in times.items()}
    read = {"times_s": times, "sha256s": known.sha256s | sha256s, "notes": tuple(notes)}
    return structs.replace(known, every=(*known.every, every), **read)


def _save_frame(path: Path, bgr: NDArray) -> str:
    """Write a JPEG, whole or not: a reading that was broken off goes on after it. Return its
    fingerprint.
    """
    picture = np.asarray(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])
    part, data = path.with_suffix(".part"), picture.tobytes()
    with writing_to(path.parent, path.name, PhotoFileError):
        part.unlink(missing_ok=True)
        with part.open("xb") as opened:  # through no link
            opened.write(data)
        part.replace(path)
    return hashlib.sha256(data).hexdigest()


def _number_of(name: str) -> int:
    return int(name.removesuffix(".jpg"))


def _is_frame(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _is_free(folder: Path) -> bool:
    """Tell whether frames can be kept in a folder: it has no images, or is not there."""
    if not folder.is_dir():
        return not os.path.lexists(folder)
    return not (any(folder.glob("*.jpg")) or os.path.lexists(folder / RECORD))


def _places_of(video: Path) -> Iterator[Path]:
    """Yield the folders in which a video's frames may be; none is a link to elsewhere."""
    parent = video.parent if os.access(video.parent, os.W_OK) else state_folder() / "frames"
    for more in chain([""], map(".{}".format, count(2))):
        folder = parent / f"{video.name}{more}.frames"
        if not folder.is_symlink():
            yield folder
