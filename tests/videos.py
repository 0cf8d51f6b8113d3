"""Small videos, as OpenCV writes them, and changed in their bytes as cameras have them."""

import re
import struct
from collections.abc import Collection, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

RATE = 25.0


def pictures(count: int, width: int = 64, height: int = 48) -> list[NDArray[np.uint8]]:
    """RGB pictures, in which a bright bar grows with the frame."""
    frames = []
    for index in range(count):
        frames.append(np.full((height, width, 3), 40, np.uint8))
        frames[-1][:, : 2 * index + 2] = (200, 120, 60)
    return frames


def write_video(path: Path, count: int, codec: str = "mp4v") -> Path:
    """Write a video of ``pictures``."""
    return write_pictures(path, pictures(count), codec)


def write_pictures(path: Path, shown: Sequence[NDArray[np.uint8]], codec: str = "mp4v") -> Path:
    """Write a video of RGB pictures."""
    path.parent.mkdir(exist_ok=True)
    size = shown[0].shape[1::-1]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), RATE, size)
    for picture in shown:
        writer.write(picture[..., ::-1])
    writer.release()
    return path


def write_interlaced(path: Path, count: int, which: Collection[int] | None = None) -> Path:
    """Write a video (.mp4) whose frames, or those at ``which`` places in the file, are interlaced.

    The lower lines of each pair show the next frame's moment.
    """
    moments = pictures(count + 1, 64, 64)
    frames = [moment.copy() for moment in moments[:-1]]
    for frame, later in zip(frames, moments[1:], strict=True):
        if which is None:
            frame[1::2] = later[1::2]
    data = bytearray(write_pictures(path, frames, "mpg2").read_bytes())
    number = 0
    for match in re.finditer(rb"\x00\x00\x01\xb5", bytes(data)):  # ISO/IEC 13818-2, 6.2.2, 6.2.3
        at = match.end()
        if data[at] >> 4 == 1:  # extension of the sequence
            data[at + 1] &= ~0x08  # not progressive
        elif data[at] >> 4 == 8:  # extension of a picture
            if which is None or number in which:
                data[at + 3] |= 0x80  # top field first
                data[at + 4] &= ~0x80  # not progressive
            number += 1
    path.write_bytes(data)
    return path


def write_jpegs(
    path: Path, shown: Sequence[NDArray[np.uint8]], times_ms: Sequence[int] = (), sampling: int = 0
) -> Path:
    """Write a video (IVF, whatever its name) of RGB pictures of any sizes, as JPEGs.

    Like a browser's recording it says its length in ms alone. ``sampling``: of the colours of the
    first frame, as of ``cv2.IMWRITE_JPEG_SAMPLING_FACTOR``.
    """
    times = times_ms or [40 * index for index in range(len(shown))]
    length = times[-1] + 40
    data = b"DKIF" + struct.pack("<HH4sHHIIII", 0, 32, b"MJPG", 0, 0, 1000, 1, length, 0)
    for picture, time in zip(shown, times, strict=True):
        how = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling] if sampling and not time else []
        jpeg = np.asarray(cv2.imencode(".jpg", picture[..., ::-1], how)[1]).tobytes()
        data += struct.pack("<IQ", len(jpeg), time) + jpeg
    path.write_bytes(data)
    return path


def bar_of(rgb: NDArray) -> int:
    """Index of the frame that a picture shows, by its bar."""
    return round(float((rgb[10, :, 0] > 120).sum()) / 2.0) - 1


def set_durations(path: Path, durations: list[int]) -> None:
    """Give each frame of an MP4 a duration of its own, in the track's ticks (of 512 a frame)."""
    data = bytearray(path.read_bytes())
    *parents, at = _boxes(data, b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts")
    entries = b"".join(struct.pack(">II", 1, ticks) for ticks in durations)
    box = struct.pack(">I4sII", 16 + len(entries), b"stts", 0, len(durations)) + entries
    (size,) = struct.unpack_from(">I", data, at)
    for parent in parents:
        struct.pack_into(">I", data, parent, len(box) - size + _size(data, parent))
    data[at : at + size] = box
    path.write_bytes(data)


def turn_video(path: Path) -> None:
    """Say in an MP4 that players have to turn it by 90 degrees, as phones do."""
    data = bytearray(path.read_bytes())
    at = _boxes(data, b"moov", b"trak", b"tkhd")[-1] + 48
    struct.pack_into(">9i", data, at, 0, 0x10000, 0, -0x10000, 0, 0, 0, 0, 0x40000000)
    path.write_bytes(data)


def widen_pixels(path: Path, across: int, down: int) -> None:
    """Say in an MP4 how wide and how high its pixels are."""
    data = bytearray(path.read_bytes())
    parents = _boxes(data, b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd")
    entry = parents[-1] + 16
    end = entry + _size(data, entry)
    box = struct.pack(">I4sII", 16, b"pasp", across, down)
    for parent in (*parents, entry):
        struct.pack_into(">I", data, parent, len(box) + _size(data, parent))
    data[end:end] = box
    path.write_bytes(data)


def trim_video(path: Path, first: int, count: int) -> None:
    """Say in an MP4 that players show some of its frames alone, as editors trim it."""
    data = bytearray(path.read_bytes())
    (per_second,) = struct.unpack_from(">I", data, _boxes(data, b"moov", b"mvhd")[-1] + 20)
    at = _boxes(data, b"moov", b"trak", b"edts", b"elst")[-1]
    struct.pack_into(">II", data, at + 16, round(count * per_second / RATE), first * 512)
    path.write_bytes(data)


def move_index(path: Path) -> None:
    """Move an MP4's index, which is after the frames, before them, as streams have it."""
    data = bytearray(path.read_bytes())
    at = _boxes(data, b"mdat")[-1]
    index = _boxes(data, b"moov")[-1]
    size = _size(data, index)
    places = _boxes(data, b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stco")[-1]
    for entry in range(struct.unpack_from(">I", data, places + 12)[0]):
        (place,) = struct.unpack_from(">I", data, places + 16 + 4 * entry)
        struct.pack_into(">I", data, places + 16 + 4 * entry, place + size)
    path.write_bytes(data[:at] + data[index : index + size] + data[at:index])


def _boxes(data: bytearray, *names: bytes) -> list[int]:
    """Places of boxes (ISO/IEC 14496-12), each in the one before."""
    places, at = [], 0
    for name in names:
        while data[at + 4 : at + 8] != name:
            at += _size(data, at)
        places.append(at)
        at += 8
    return places


def _size(data: bytearray, at: int) -> int:
    return struct.unpack_from(">I", data, at)[0]
