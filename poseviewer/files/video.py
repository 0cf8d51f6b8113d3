"""Videos, read forward once: every N-th frame becomes a JPEG with its time stamp.

A record beside the JPEGs says of which video they are, so that it is read once.
"""

import hashlib
import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct, structs
from numpy.typing import NDArray

from poseviewer.errors import PhotoFileError, PoseViewerError
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, Number, is_there, quiet_libraries
from poseviewer.files.state.folder import state_folder
from poseviewer.files.video_decoding import decode_video, prepare_ffmpeg
from poseviewer.files.writing import make_folder, write_json, writing_to

VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv", ".mts", ".3gp")
RECORD = "frames.json"
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
    every: tuple[Step, ...] = ()
    times_s: dict[str, Number] = {}
    """Time stamps from the first frame, s, by the frames' files, which their numbers name."""
    notes: tuple[str, ...] = ()

    def names(self, every: int) -> list[str]:
        """Return the files of every N-th frame, in order."""
        return sorted(name for name in self.times_s if not int(Path(name).stem) % every)

    def has(self, every: int) -> bool:
        """Tell whether every N-th frame was read."""
        return any(every % step == 0 for step in self.every)


def extract_frames(
    video: Path, every: int = 1, folder: Path | None = None,
    progress: Callable[[float], object] | None = None,
) -> tuple[Path, VideoRecord]:  # fmt: skip
    """Keep every N-th frame of a video as a JPEG, unless that was done; return folder and record.

    Args:
        video: its file.
        every: number N.
        folder: where the frames are kept; None: ``VIDEO.frames`` beside it, or in the folder of
            state where that cannot be written.
        progress: is given the share that has been read, now and then.

    Raises:
        PhotoFileError: it is no video, or holds no frame, or too many, or too large ones; it is
            interlaced, and PyAV is not installed; the folder holds images of something else, or
            cannot be written.
    """
    file = InputFile(video, [], PhotoFileError, "video", MAX_VIDEO_BYTES)
    with file.naming_errors(), quiet_libraries():
        file.check_size()
        status, folder = video.stat(), folder or _folder_of(video)
        new = VideoRecord(video=video.name, bytes=status.st_size, modified_ns=status.st_mtime_ns)
        known = load_record(folder)
        if known is None and (any(folder.glob("*.jpg")) or (folder / RECORD).exists()):
            found = f"its frames belong into {folder}, which holds other files"
            raise file.error(found, "name an empty folder")
        if known is None or structs.replace(known, every=(), times_s={}, notes=()) != new:
            for name in () if known is None else known.times_s:  # of the video as it was
                (folder / name).unlink(missing_ok=True)
            known = new
        if known.has(every) and all(map(is_there, (folder / n for n in known.names(every)))):
            return folder, known
        make_folder(folder, PhotoFileError)
        write_json(folder / RECORD, structs.replace(known, every=()), PhotoFileError)
        try:
            known = _read(file, every, folder, known, progress or (lambda _: None))
        finally:
            if not any(folder.glob("*.jpg")):  # nothing to go on with
                (folder / RECORD).unlink()
                with suppress(OSError):
                    folder.rmdir()
        write_json(folder / RECORD, known, PhotoFileError, indent=0)
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
    part, writer = path.with_name(f".{path.stem}.part{path.suffix}"), None
    try:
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


def _read(
    file: InputFile,
    every: int,
    folder: Path,
    known: VideoRecord,
    progress: Callable[[float], object],
) -> VideoRecord:
    index, times = -1, dict[str, float]()
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
            times[name] = time
            if not (folder / name).exists():
                if (picture := make_picture()) is None:
                    del times[name]
                else:
                    _save_frame(folder / name, picture)
            progress(index / max(said, 1.0))
    if not times:
        raise file.error("no frame in it can be read", "is it whole? Copy it again")
    if np.any(np.diff(list(times.values())) <= 0.0) and video.rate > 0.0:  # it has no time stamps
        times = {name: int(Path(name).stem) / video.rate for name in times}
    first, notes = next(iter(times.values())), video.notes
    if index + 1 < MIN_READ * said:
        notes.append(f"{file.path.name} breaks off after {index + 1:,} of {said:,.0f} frames.")
    times = known.times_s | {name: round(time - first, 6) for name, time in times.items()}
    return structs.replace(known, every=(*known.every, every), times_s=times, notes=tuple(notes))


def _save_frame(path: Path, bgr: NDArray) -> None:
    """Write a JPEG, whole or not: a reading that was broken off goes on after it."""
    data = np.asarray(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])
    part = path.with_suffix(".part")
    with writing_to(path.parent, path.name, PhotoFileError):
        part.write_bytes(data.tobytes())
        part.replace(path)


def _folder_of(video: Path) -> Path:
    beside = video.with_name(f"{video.stem}.frames")
    if os.access(beside if beside.is_dir() else video.parent, os.W_OK):
        return beside
    digest = hashlib.sha256(os.fsencode(video.resolve())).hexdigest()[:16]
    return state_folder() / "frames" / f"{video.stem}-{digest}"
