"""Encode videos: H.264 by PyAV where it is installed, else by OpenCV, which seldom has it."""

from collections.abc import Iterable, Iterator
from fractions import Fraction
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PhotoFileError
from poseviewer.files.checks import InputFile, quiet_libraries
from poseviewer.files.video_decoding import prepare_ffmpeg
from poseviewer.files.writing import require_replaceable

CODECS = {".mp4": ("avc1", "mp4v"), ".webm": ("VP80",), ".avi": ("MJPG",)}
"""Codecs of videos that are written, best first: H.264 is not on every machine; VP9 takes three
times as long as VP8."""
PLAYED = ("avc1", "VP80", "MJPG")
"""Codecs that browsers play, or that nobody expects them to."""
CHROMA = "yuv420p"
"""Format of pixels that all players take: colour of each two by two."""


def save_video(path: Path, pictures: Iterable[NDArray[np.uint8]], rate: float) -> str:
    """Write a video, whole or not; return a note where browsers do not play it, else "".

    Args:
        path: file, .mp4, .webm or .avi.
        pictures: (height, width, 3), RGB, of one size.
        rate: frames a second.

    Raises:
        PhotoFileError: it cannot be written.
    """
    file = InputFile(path, [], PhotoFileError, "video")
    suffix = path.suffix.lower()
    if suffix not in CODECS:
        found = f"videos cannot be written as {path.suffix!r}"
        raise file.error(found, f"name it {' or '.join(CODECS)}")
    prepare_ffmpeg()
    require_replaceable(path, PhotoFileError)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    encode = _encode_h264 if suffix == ".mp4" and has_h264() else _encode_by_opencv
    try:
        part.unlink(missing_ok=True)  # it may be a link
        with quiet_libraries():
            codec = encode(part, iter(pictures), rate)
        if codec == "":
            raise file.error("cannot be written", "is the folder yours to write to?")
        if part.exists():
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    if codec in PLAYED:
        return ""
    found = f"Browsers do not play {path.name} ({codec})"
    return f"{found}: name it .webm, or pip install 'poseviewer[video]' for H.264 in .mp4."


def has_h264() -> bool:
    """Tell whether PyAV is there to encode H.264, which OpenCV's wheels do not."""
    return find_spec("av") is not None


def _encode_h264(path: Path, pictures: Iterator[NDArray[np.uint8]], rate: float) -> str:
    """Encode by PyAV; return the codec, or "" where the file cannot be written."""
    import av

    first = next(pictures, None)
    if first is None:
        return "avc1"
    height, width = first.shape[:2]
    try:
        container = av.open(str(path), "w")
    except OSError:  # as PyAV's errors are
        return ""
    with container:
        stream: Any = container.add_stream("libx264", rate=Fraction(rate).limit_denominator(60_000))
        stream.width, stream.height, stream.pix_fmt = width + width % 2, height + height % 2, CHROMA
        for picture in chain([first], pictures):
            even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, "rgb24")))
        container.mux(stream.encode(None))
    return "avc1"


def _encode_by_opencv(path: Path, pictures: Iterator[NDArray[np.uint8]], rate: float) -> str:
    """Encode by OpenCV; return the codec, or "" where the file cannot be written."""
    first = next(pictures, None)
    if first is None:
        return CODECS[path.suffix.lower()][0]
    for codec in CODECS[path.suffix.lower()]:
        code = cv2.VideoWriter.fourcc(*codec)
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, rate, first.shape[1::-1])
        if writer.isOpened():
            for picture in chain([first], pictures):
                writer.write(np.ascontiguousarray(picture[..., ::-1]))
            writer.release()
            return codec
    return ""
