"""The cameras and images of a COLMAP model, text or binary, as the words of its text files
(https://colmap.github.io/format.html).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from poseviewer.errors import PoseViewerError
from poseviewer.files.checks import Reading
from poseviewer.geometry.lens import LensModel

SUFFIXES = (".bin", ".txt")
"""Where a model is there as both, the binary one is read, as COLMAP does."""
MODELS: dict[str, tuple[int, int, LensModel | None]] = {
    "SIMPLE_PINHOLE": (1, 0, "opencv"),
    "PINHOLE": (2, 0, "opencv"),
    "SIMPLE_RADIAL": (1, 1, "opencv"),
    "RADIAL": (1, 2, "opencv"),
    "OPENCV": (2, 4, "opencv"),
    "OPENCV_FISHEYE": (2, 4, "fisheye"),
    "FULL_OPENCV": (2, 8, "opencv"),
    "FOV": (2, 1, None),
    "SIMPLE_RADIAL_FISHEYE": (1, 1, "fisheye"),
    "RADIAL_FISHEYE": (1, 2, "fisheye"),
    "THIN_PRISM_FISHEYE": (2, 8, None),
}
"""Camera models by number: how many focal lengths and distortion parameters, the principal point
between them; and OpenCV's model, whose first coefficients the parameters are.
https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h
"""
POINT_BYTES = 24
"""Of an image's point: x, y, and the number of its point in space."""
LARGEST_FILE = 100_000_000_000
"""Bytes: the points of all images are in it; they are skipped, a record or a line at a time."""
LONGEST_LINE = 100_000_000
"""Bytes: those of a million points."""
WANTED = "wanted a file of a COLMAP model"
LONGEST_NAME = 4096
"""Of an image, in bytes: paths are no longer."""


def model_file(folder: Path, stem: str) -> Path:
    """``cameras`` or ``images`` of the model in ``folder``; the text file where there is none."""
    binary, text = (folder / (stem + suffix) for suffix in SUFFIXES)
    return binary if binary.is_file() else text


def camera_rows(reading: Reading) -> Iterator[list[str]]:
    """CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] of each camera in a ``cameras`` file."""
    if reading.path.suffix == ".bin":
        for file in _records(reading):
            number, model, width, height = _unpack(reading, file, "<IiQQ")
            if not 0 <= model < len(MODELS):
                raise reading.error(f"camera {number} is of model {model}", "wanted one of COLMAP")
            name, (focals, more, _) = list(MODELS.items())[model]
            numbers = _unpack(reading, file, f"<{focals + 2 + more}d")
            yield [str(number), name, str(width), str(height), *map(repr, numbers)]
        return
    yield from (line.split() for line in _lines(reading) if line)


def image_rows(reading: Reading) -> Iterator[list[str]]:
    """IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME of each image in an ``images`` file."""
    if reading.path.suffix == ".bin":
        for file in _records(reading):
            number, *place, camera = _unpack(reading, file, "<I7dI")
            name = _name(reading, file)
            (points,) = _unpack(reading, file, "<Q")
            file.seek(points * POINT_BYTES, 1)
            yield [str(number), *map(repr, place), str(camera), name]
        return
    lines = _lines(reading)
    for line in lines:
        if line:
            yield line.split(maxsplit=9)
            next(lines, None)  # its points


def _records(reading: Reading) -> Iterator[IO[bytes]]:
    """The open file, once for each record that a binary file says it has."""
    with replace(reading, largest=LARGEST_FILE).open() as file:
        (count,) = _unpack(reading, file, "<Q")
        for _ in range(count):  # a file that has fewer is cut short: the next read says so
            yield file
        if file.tell() > os.fstat(file.fileno()).st_size:  # points were skipped
            raise _cut_short(reading)


def _unpack(reading: Reading, file: IO[bytes], form: str) -> tuple[Any, ...]:
    size = struct.calcsize(form)
    data = file.read(size)
    if len(data) < size:
        raise _cut_short(reading)
    return struct.unpack(form, data)


def _name(reading: Reading, file: IO[bytes]) -> str:
    """Up to the next zero byte."""
    start = file.tell()
    data, zero, _ = file.read(LONGEST_NAME).partition(b"\0")
    if not zero:
        raise _cut_short(reading)
    file.seek(start + len(data) + 1)
    return data.decode("utf-8", "replace")


def _lines(reading: Reading) -> Iterator[str]:
    """The lines that are no comments, empty ones included: they stand for images without points."""
    with replace(reading, largest=LARGEST_FILE).open() as file:
        while line := file.readline(LONGEST_LINE):
            if len(line) == LONGEST_LINE or b"\0" in line:
                raise reading.error("not a text", WANTED)
            if not line.startswith(b"#"):
                try:
                    yield line.decode().strip()
                except UnicodeDecodeError:
                    raise reading.error("not a text in UTF-8", WANTED) from None


def _cut_short(reading: Reading) -> PoseViewerError:
    return reading.error("is cut short", f"{WANTED}, a whole one")
