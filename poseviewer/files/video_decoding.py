"""Decode videos forward: by PyAV where it is installed, else by OpenCV, which makes no pictures of
interlaced frames.

Seeking is left out: frame numbers are exact in few formats. Pictures are as players show them:
upright, with square pixels, of one size.
"""

import os
import shlex
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.files.checks import InputFile
from poseviewer.files.photo import (
    PAGED_ENDINGS,
    count_pages,
    iterate_pages,
    refuse_frames,
    refuse_size,
)

QUIET = ("OPENCV_FFMPEG_LOGLEVEL", "-8")
"""Variable that silences FFmpeg in OpenCV."""
OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
"""Variable by which OpenCV gives options to FFmpeg."""
CONTAINERS = {
    "format_whitelist": "mov,matroska,avi,asf,mpeg,mpegts,mpegvideo,ivf",
    "protocol_whitelist": "file",
}
"""FFmpeg's options that leave out playlists, which name other files to read."""
WITH_ALL_FRAMES = {"ignore_editlist": "1"}
"""FFmpeg's option that also gives the frames that an MP4's trimming leaves out."""
AS_STORED = [cv2.CAP_PROP_FORMAT, -1]
"""OpenCV's option that gives the packets of a video without decoding them."""
MAX_STILL_FRAMES = 250
"""Equal frames from which OpenCV is taken to make no pictures: ten seconds of a film's black."""
MIN_READ = 0.9
"""Share of the frames of the header, and of those in the file, below which it may break off: some
packets hold no frame.
"""
MIN_WIDENING = 0.005
"""Relative difference of a pixel's sides from which a picture is resized: headers round it."""
MAX_WIDENING = 4.0
"""Ratio of a pixel's sides beyond which it is no camera's."""
SAME_SHAPE = 0.02
"""Relative difference of two pictures' sides up to which they show the same: sides are rounded."""
MAX_PARTS = 1000
"""Outer parts of a file of which the ends are looked at."""
BOXES = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
"""Boxes that an MP4 begins with (ISO/IEC 14496-12)."""
ELEMENTS = (b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67")
"""Outer elements of Matroska (RFC 9559): the header and the segment."""

MakePicture = Callable[[], NDArray[np.uint8] | None]
"""Makes a frame's picture (height, width, 3), BGR, before the next frame is asked for; None: it
cannot be made."""
Frames = Iterator[tuple[float, MakePicture]]


@dataclass(frozen=True, slots=True, eq=False)
class VideoHeader:
    """Header of a video, and the way in which players show it."""

    frames: float
    """Number of frames; some only guess it from length and rate."""
    rate: float
    """Frames a second; 0: not known."""
    codec: str
    """Four letters of the codec."""
    width: int
    height: int
    """Upright, px."""
    turned_deg: int
    """Angle by which players turn what is stored, clockwise."""
    widening: float
    """Width of a stored pixel in its heights."""

    @property
    def length_s(self) -> float:
        """Duration, s; 0: not known."""
        return max(self.frames, 0.0) / self.rate if self.rate > 0.0 else 0.0

    def shown_size(self, width: int, height: int) -> tuple[int, int]:
        """Return the sides, px, at which an upright picture has square pixels."""
        widening = self.widening if self.turned_deg % 180 == 0 else 1.0 / self.widening
        if abs(widening - 1.0) < MIN_WIDENING:
            return width, height
        if widening > 1.0:  # one side grows: nothing is lost
            return round(width * widening), height
        return width, round(height / widening)


@dataclass(frozen=True, slots=True, eq=False)
class DecodedVideo:
    """A video that is read forward."""

    header: VideoHeader
    frames: Frames
    """Time stamps, s, and pictures."""
    notes: list[str] = field(default_factory=list)
    """Sentences on how the frames were decoded, once all are."""


def prepare_ffmpeg(more: dict[str, str] | None = None) -> None:
    """Silence FFmpeg in OpenCV, and let it open containers of videos alone."""
    os.environ.setdefault(*QUIET)
    ours = "|".join(f"{key};{value}" for key, value in CONTAINERS.items())
    given = os.environ.get(OPTIONS, "").split(ours)[0].rstrip("|")
    own = "|".join(f"{key};{value}" for key, value in (more or {}).items())
    os.environ[OPTIONS] = "|".join(filter(None, (given, ours, own)))


@contextmanager
def decode_video(file: InputFile) -> Iterator[DecodedVideo]:
    """Open a video, or a picture of several pages.

    Raises:
        PoseViewerError: the file's error, where it is no video, its frames are too large or of
            several shapes, or their decoder is not installed.
    """
    if file.path.suffix.lower() in PAGED_ENDINGS:
        header = VideoHeader(float(count_pages(file.path)), 0.0, "", 0, 0, 0, 1.0)
        yield DecodedVideo(header, _by_pillow(file))
        return
    with _opened(file) as capture:
        header, notes = _header_of(capture), list[str]()
        shape = _Shape(file, header, notes)
        try:
            import av  # noqa: F401
        except ImportError:
            if not _makes_pictures(file):
                raise _needs_pyav(file) from None
            shape.take_all(_sizes_stored(file, header))
            frames = _by_opencv(capture, shape)
        else:
            frames = _by_pyav(file, shape)
        yield DecodedVideo(header, frames, notes)


def read_header(file: InputFile) -> VideoHeader:
    """Read what a video's header says.

    Raises:
        PoseViewerError: the file's error, where it is no video, or its frames are too large.
    """
    with _opened(file) as capture:
        return _header_of(capture)


def has_more_frames(file: InputFile, header: VideoHeader, most: int) -> bool:
    """Tell whether a video has more frames than ``most``; where the header says so, they are
    decoded and counted, as many guess.
    """
    return header.frames > most and _count_decoded(file, most + 1) > most


def stored_times(file: InputFile) -> list[float]:
    """Return the time stamps, s, of the packets of a video, which mostly are a frame each."""
    with _opened(file, packets=True) as capture:
        key = cv2.CAP_PROP_POS_MSEC
        return sorted(capture.get(key) / 1000.0 for _ in iter(capture.grab, False))


def breaks_off(file: InputFile, header: VideoHeader, decoded: int) -> bool:
    """Tell whether a video of which some frames were decoded has lost others: its file is cut off,
    or holds more than can be decoded. Frames of a guessed number, or before a cut, are not lost.
    """
    if decoded >= MIN_READ * header.frames:
        return False
    stored = min(header.frames, len(stored_times(file)))
    return _is_cut_off(file.path) or _count_decoded(file, None) < MIN_READ * stored


@contextmanager
def _opened(
    file: InputFile, *, packets: bool = False, more: dict[str, str] | None = None
) -> Iterator[cv2.VideoCapture]:
    prepare_ffmpeg(more)
    name = str(file.path.absolute())
    capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG, AS_STORED if packets else [])
    try:
        if not capture.isOpened():
            raise file.error("not a video that can be read", "is it whole? Save it as MP4")
        sides = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
        refuse_size(file, *(int(capture.get(side)) for side in sides))
        yield capture
    finally:
        capture.release()
        prepare_ffmpeg()


def _header_of(capture: cv2.VideoCapture) -> VideoHeader:
    sides = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    widening = sides[0] / sides[1] if min(sides) > 0.0 else 1.0
    is_sane = 1.0 / MAX_WIDENING <= widening <= MAX_WIDENING
    return VideoHeader(
        frames=capture.get(cv2.CAP_PROP_FRAME_COUNT),
        rate=capture.get(cv2.CAP_PROP_FPS),
        codec=_letters_of(capture).decode("latin1").strip("\0 "),
        width=int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
        height=int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        turned_deg=round(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360,
        widening=widening if is_sane else 1.0,
    )


def _letters_of(capture: cv2.VideoCapture) -> bytes:
    return int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=False)


def _count_decoded(file: InputFile, most: int | None) -> int:
    """Count the frames that can be decoded, trimmed ones too, up to ``most``."""
    trimmed = WITH_ALL_FRAMES if most is None else None
    with _opened(file, more=trimmed) as capture:
        return sum(1 for _ in islice(iter(capture.grab, False), most))


def _is_cut_off(path: Path) -> bool:
    """Tell whether a file ends before its outer parts do."""
    size, at = path.stat().st_size, 0
    with path.open("rb") as opened:
        for _ in range(MAX_PARTS):
            opened.seek(at)
            head = opened.read(16)
            length = _length_of(head, is_first=not at)
            if length is None:
                return False
            at += length
            if at > size:
                return True
    return False


def _length_of(head: bytes, is_first: bool) -> int | None:
    """Length of the part of a file that begins with ``head``; None: none is said."""
    if len(head) < 16:
        return None
    if head[:4] == b"RIFF":
        return 8 + int.from_bytes(head[4:8], "little")
    if head[:4] in ELEMENTS:
        width = 9 - head[4].bit_length()
        unknown = (1 << 7 * width) - 1
        length = int.from_bytes(head[4 : 4 + width]) & unknown
        return None if width > 8 or length == unknown else 4 + width + length
    if is_first and head[4:8] not in BOXES:
        return None
    length = int.from_bytes(head[:4])
    length = int.from_bytes(head[8:16]) if length == 1 else length
    return length if length >= 8 else None


class _Shape:
    """Size at which all frames of a video are shown, that of the first one with square pixels."""

    def __init__(self, file: InputFile, header: VideoHeader, notes: list[str]) -> None:
        self._file, self._header, self._notes = file, header, notes
        self._first: tuple[int, int] | None = None
        self.size: tuple[int, int] = (0, 0)
        self._is_changed = False

    def take(self, width: int, height: int) -> None:
        """Take the sides of an upright picture as stored, of the first frame or a later one."""
        if (width, height) == self._first:
            return
        shown, name = self._header.shown_size(width, height), self._file.path.name
        if self._first is None:
            self._first, self.size = (width, height), shown
            refuse_frames(self._file, *shown)
            if shown != self._first:
                said = f"has pixels that are not square: its frames of {width}x{height} px"
                self._notes.append(f"{name} {said} are resized to {_sides(shown)}, as in players.")
        elif not self._is_changed:
            wide, high = (own / first for own, first in zip(shown, self.size, strict=True))
            found = f"its frames change from {_sides(self._first)} to {width}x{height} px"
            if abs(wide / high - 1.0) > SAME_SHAPE:
                raise self._file.error(f"{found}, of another shape", "cut it where that changes")
            self._is_changed = True
            self._notes.append(f"{name}: {found}; all are resized to {_sides(self.size)}.")

    def take_all(self, sizes: Iterator[tuple[int, int]]) -> None:
        """Take the sizes of all frames."""
        for size in sizes:
            self.take(*size)

    def note(self, said: str) -> None:
        """Add a sentence on the video, once."""
        sentence = f"{self._file.path.name} {said}."
        if sentence not in self._notes:
            self._notes.append(sentence)

    def resize(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return an upright picture at the size of all."""
        if picture.shape[1::-1] == self.size:
            return picture
        is_larger = picture.shape[1] * picture.shape[0] > self.size[0] * self.size[1]
        how = cv2.INTER_AREA if is_larger else cv2.INTER_CUBIC
        return np.asarray(cv2.resize(picture, self.size, interpolation=how), np.uint8)


def _sides(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]} px"


def _sizes_stored(file: InputFile, header: VideoHeader) -> Iterator[tuple[int, int]]:
    """Yield the sides of the header, and of the frames from which decoding can begin, upright:
    OpenCV makes pictures of one size, without a word.
    """
    yield header.width, header.height
    turned = header.turned_deg % 180 != 0
    with _opened(file, packets=True) as capture, TemporaryDirectory() as folder:
        codec, one = _letters_of(capture).upper(), Path(folder, "frame.ivf")
        while capture.grab():
            if not capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME):
                continue
            is_whole, packet = capture.retrieve()
            if is_whole and (size := _size_of_packet(packet.tobytes(), codec, one)):
                yield (size[1], size[0]) if turned else size


def _size_of_packet(packet: bytes, codec: bytes, path: Path) -> tuple[int, int] | None:
    """Sides of the frame in a packet, as a video of its own (IVF, whose header may say 0 px)."""
    header = b"DKIF" + struct.pack("<HH4sHHIIII", 0, 32, codec, 0, 0, 1, 1, 1, 0)
    path.write_bytes(header + struct.pack("<IQ", len(packet), 0) + packet)
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        sides = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
        width, height = (int(capture.get(side)) for side in sides)
        return (width, height) if capture.isOpened() and min(width, height) > 0 else None
    finally:
        capture.release()


def _by_pillow(file: InputFile) -> Frames:
    for time, picture in iterate_pages(file):
        yield time, partial(np.ascontiguousarray, picture[..., ::-1])


def _by_opencv(capture: cv2.VideoCapture, shape: _Shape) -> Frames:
    for time, retrieve in _as_stored(capture):

        def make(retrieve: MakePicture = retrieve) -> NDArray[np.uint8] | None:
            picture = retrieve()
            return None if picture is None else shape.resize(picture)

        yield time, make


def _as_stored(capture: cv2.VideoCapture) -> Frames:
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


def _needs_pyav(file: InputFile) -> Exception:
    name = file.path.name
    line = shlex.join(["ffmpeg", "-i", name, "-vf", "yadif", f"{Path(name).stem}.yadif.mp4"])
    found = "its frames are interlaced (or nothing moves), and OpenCV makes no pictures of them"
    return file.error(found, f"pip install 'poseviewer[video]', or {line}")


def _by_pyav(file: InputFile, shape: _Shape) -> Frames:
    """Decode by PyAV; from the first interlaced frame on, one moment of each is kept."""
    import av
    from av.error import FFmpegError

    with av.open(str(file.path.absolute()), options=CONTAINERS) as container:
        stream: Any = container.streams.best("video")  # which is no cover
        stream.thread_type = "AUTO"
        graph, known, turns = None, None, 0
        for frame in _decode_packets(container, stream, FFmpegError):
            turns, sides = frame.rotation // 90, (frame.width, frame.height)
            kind = *sides, frame.format.name
            if graph is not None and kind != known:
                graph.push(None)
                yield from _pull(graph, turns, shape)
                graph = None
            if frame.interlaced_frame and graph is None:
                graph = _make_deinterlacer(stream, frame)
                shape.note(
                    "is interlaced: of each frame one field is kept, the other is interpolated"
                )
            known = kind
            shape.take(*(sides[::-1] if turns % 2 else sides))
            if graph is None:
                yield _made_of(frame, turns, shape)
            else:
                graph.push(frame)
                yield from _pull(graph, turns, shape)
        if graph is not None:
            graph.push(None)
            yield from _pull(graph, turns, shape)


def _make_deinterlacer(stream: Any, frame: Any) -> Any:
    """Filter that makes frames of one moment of those that are interlaced, and leaves others."""
    from av.filter import Graph

    graph = Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=stream.time_base
    )
    sink = graph.add("buffersink")
    graph.link_nodes(source, graph.add("yadif", "deint=interlaced"), sink).configure()
    return graph


def _pull(graph: Any, turns: int, shape: _Shape) -> Frames:
    with suppress(BlockingIOError, EOFError):  # it wants the next frame, or there is none
        while True:
            yield _made_of(graph.pull(), turns, shape)


def _decode_packets(container: Any, stream: Any, error: type[Exception]) -> Iterator[Any]:
    with suppress(error):  # it breaks off
        for packet in container.demux(stream):
            with suppress(error):  # it is damaged there
                yield from packet.decode()


def _made_of(frame: Any, turns: int, shape: _Shape) -> tuple[float, MakePicture]:
    """Time of a frame, and its picture as players show it."""

    def make() -> NDArray[np.uint8]:
        picture = np.rot90(frame.to_ndarray(format="bgr24"), turns)
        return shape.resize(np.ascontiguousarray(picture))

    return float(frame.time or 0.0), make
