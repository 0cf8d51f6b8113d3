"""Decode videos forward: by OpenCV, or by PyAV where OpenCV makes no pictures of the frames.

Seeking is left out: frame numbers are exact in few formats.
"""

import os
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.files.checks import InputFile
from poseviewer.files.photo import refuse_size

QUIET = ("OPENCV_FFMPEG_LOGLEVEL", "-8")
"""Variable that silences FFmpeg in OpenCV."""
OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
"""Variable by which OpenCV gives options to FFmpeg."""
CONTAINERS = {
    "format_whitelist": "mov,matroska,avi,asf,mpeg,mpegts,mpegvideo",
    "protocol_whitelist": "file",
}
"""FFmpeg's options that leave out playlists, which name other files to read."""
MAX_STILL_FRAMES = 250
"""Equal frames from which OpenCV is taken to make no pictures: ten seconds of a film's black."""

MakePicture = Callable[[], NDArray[np.uint8] | None]
"""Makes a frame's picture (height, width, 3), BGR, before the next frame is asked for; None: it
cannot be made."""


@dataclass(frozen=True, slots=True, eq=False)
class DecodedVideo:
    """A video that is read forward."""

    announced: float
    """Number of frames by the header; some only estimate it."""
    rate: float
    """Frames a second by the header; 0: not known."""
    frames: Iterator[tuple[float, MakePicture]]
    """Time stamps, s, and pictures."""
    notes: list[str] = field(default_factory=list)
    """Sentences on how the frames were decoded, once all are."""


def prepare_ffmpeg() -> None:
    """Silence FFmpeg in OpenCV, and let it open containers of videos alone."""
    os.environ.setdefault(*QUIET)
    given = os.environ.get(OPTIONS, "")
    ours = "|".join(f"{key};{value}" for key, value in CONTAINERS.items())
    if not given.endswith(ours):
        os.environ[OPTIONS] = f"{given}|{ours}".lstrip("|")


@contextmanager
def decode_video(file: InputFile) -> Iterator[DecodedVideo]:
    """Open a video.

    Raises:
        PoseViewerError: the file's error, where it is no video, its frames are too large, or their
            decoder is not installed.
    """
    with _opened(file) as capture:
        keys = cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FPS
        announced, rate = (capture.get(key) for key in keys)
        notes = list[str]()
        frames = _as_stored(capture) if _makes_pictures(file) else _deinterlaced(file, notes)
        yield DecodedVideo(announced, rate, frames, notes)


@contextmanager
def _opened(file: InputFile) -> Iterator[cv2.VideoCapture]:
    prepare_ffmpeg()
    capture = cv2.VideoCapture(str(file.path.absolute()), cv2.CAP_FFMPEG)
    try:
        if not capture.isOpened():
            raise file.error("not a video that can be read", "is it whole? Save it as MP4")
        sides = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
        refuse_size(file, *(int(capture.get(side)) for side in sides))
        yield capture
    finally:
        capture.release()


def _as_stored(capture: cv2.VideoCapture) -> Iterator[tuple[float, MakePicture]]:
    def retrieve() -> Any:
        is_whole, picture = capture.retrieve()
        return picture if is_whole else None

    while capture.grab():
        yield capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0, retrieve


def _makes_pictures(file: InputFile) -> bool:
    """Tell whether OpenCV makes pictures of the first frames.

    Of interlaced ones it says that it does, and returns what its memory holds: at first anything,
    then the picture that was made last.
    """
    with _opened(file) as capture:
        pictures = (make() for _, make in islice(_as_stored(capture), MAX_STILL_FRAMES))
        first = next(pictures, None)
        if first is None:
            return True
        others = (later for later in pictures if not _are_equal(first, later))
        other = next(others, None)
        capture.set(cv2.CAP_PROP_POS_FRAMES, 0.0)
        if other is None or _are_equal(other, capture.read()[1]):
            return False
    with _opened(file) as capture:  # whose memory holds something else by now
        return _are_equal(first, capture.read()[1])


def _are_equal(one: NDArray, other: NDArray | None) -> bool:
    return other is not None and np.array_equal(one, other)


def _deinterlaced(file: InputFile, notes: list[str]) -> Iterator[tuple[float, MakePicture]]:
    """Decode by PyAV; frames that are not interlaced stay as they are."""
    try:
        import av
        from av.error import FFmpegError
        from av.filter import Graph
    except ImportError:
        name = file.path.name
        line = shlex.join(["ffmpeg", "-i", name, "-vf", "yadif", f"{Path(name).stem}.yadif.mp4"])
        found = "its frames are interlaced (or nothing moves), and OpenCV makes no pictures of them"
        raise file.error(found, f"pip install 'poseviewer[video]', or {line}") from None
    with av.open(str(file.path.absolute()), options=CONTAINERS) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        graph = Graph()
        source, sink = graph.add_buffer(template=stream), graph.add("buffersink")
        graph.link_nodes(source, graph.add("yadif", "deint=interlaced"), sink).configure()
        turns = 0

        def finish() -> Iterator[tuple[float, MakePicture]]:
            with suppress(BlockingIOError, EOFError):  # it wants the next frame, or there is none
                while True:
                    frame = graph.pull()
                    yield float(frame.time or 0.0), partial(_turned_picture, frame, turns)

        for frame in _decode_packets(container, stream, FFmpegError):
            if (frame.width, frame.height) != (stream.width, stream.height):
                found = f"frames of {frame.width}x{frame.height} px after larger or smaller ones"
                raise file.error(found, "cut it where the size changes")
            if frame.interlaced_frame and not notes:
                said = "is interlaced: of each frame one field is kept, the other is interpolated"
                notes.append(f"{file.path.name} {said}.")
            turns = frame.rotation // 90
            graph.push(frame)
            yield from finish()
        graph.push(None)
        yield from finish()


def _decode_packets(container: Any, stream: Any, error: type[Exception]) -> Iterator[Any]:
    with suppress(error):  # it breaks off
        for packet in container.demux(stream):
            with suppress(error):  # it is damaged there
                yield from packet.decode()


def _turned_picture(frame: Any, turns: int) -> NDArray[np.uint8]:
    """Return the picture of a frame as players show it, turned by right angles."""
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="bgr24"), turns))
