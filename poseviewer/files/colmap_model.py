"""Cameras and images of a COLMAP model (https://colmap.github.io/format.html), text or binary."""

import struct
from dataclasses import replace
from os import SEEK_CUR
from pathlib import Path
from typing import IO, Any

import numpy as np

from poseviewer.errors import printable
from poseviewer.files.checks import InputFile, rotation_of
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel
from poseviewer.geometry.transform import RigidTransform

MODELS: dict[str, tuple[int, int, LensModel | None]] = {
    "SIMPLE_PINHOLE": (1, 0, "opencv"), "PINHOLE": (2, 0, "opencv"),
    "SIMPLE_RADIAL": (1, 1, "opencv"), "RADIAL": (1, 2, "opencv"), "OPENCV": (2, 4, "opencv"),
    "OPENCV_FISHEYE": (2, 4, "fisheye"), "FULL_OPENCV": (2, 8, "opencv"), "FOV": (2, 1, None),
    "SIMPLE_RADIAL_FISHEYE": (1, 1, "fisheye"), "RADIAL_FISHEYE": (1, 2, "fisheye"),
    "THIN_PRISM_FISHEYE": (2, 8, None), "RAD_TAN_THIN_PRISM_FISHEYE": (2, 12, None),
    "SIMPLE_DIVISION": (1, 1, None), "DIVISION": (2, 1, None),
    "SIMPLE_FISHEYE": (1, 0, "fisheye"), "FISHEYE": (2, 0, "fisheye"), "EUCM": (2, 2, None),
    "EQUIRECTANGULAR": (0, 0, None),
}  # fmt: skip
"""Counts of focal lengths and of OpenCV's first coefficients, by number (sensor/models.h)."""
POINT_BYTES = 24
"""Size of an image's point: x, y, and the number of its point in space."""
MAX_NAME_LETTERS = 4096
"""Bytes of an image's path, which ends in a zero."""
MAX_FILE_BYTES = 100_000_000_000
"""Bytes: the points of all images are in it; they are skipped."""


def colmap_file(folder: Path, stem: str) -> Path:
    """``cameras`` or ``images`` of a model, the binary file where it is there, as COLMAP does."""
    binary = folder / f"{stem}.bin"
    return binary if binary.is_file() else folder / f"{stem}.txt"


def colmap_cameras(file: InputFile) -> dict[str, tuple[Perspective, Lens | None]]:
    """The cameras in a ``cameras`` file, and their lenses, by CAMERA_ID."""
    cameras = {}
    for words in _camera_rows(file):
        if len(words) < 5 or not words[0].isdecimal():
            found = f"a line reads {' '.join(words)[:40]!r}"
            raise file.error(found, "wanted COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]")
        key, model = words[:2]
        focals, more, lens = MODELS.get(model, (0, 0, None))
        if lens is None:
            known = ", ".join(name for name, (_, _, lens) in MODELS.items() if lens)
            wanted = f"wanted one of {known}; undistort others first (colmap image_undistorter)"
            raise file.error(f"camera {key} is of model {model[:30]}", wanted)
        sides = file.flat_numbers(" ".join(words[2:4]), f"the size of camera {key}")
        width, height = (file.size(side, f"the size of camera {key}") or 0 for side in sides)
        values = file.flat_numbers(" ".join(words[4:]), f"the parameters of camera {key}")
        if len(values) != (count := focals + 2 + more):
            raise file.error(f"camera {key} has {len(values)} parameters", f"{model} has {count}")
        fx, fy = (file.positive(values[i], f"focal length of {key}") for i in (0, focals - 1))
        cx, cy, *distortion = values[focals:]
        distortion += [0.0] * (COEFFICIENTS[lens][:2][-1] - len(distortion))
        cameras[key] = Perspective(fx, fy, cx, cy, width, height), Lens.of(lens, distortion)
    if not cameras:
        raise file.error("holds no camera", "wanted COLMAP's cameras.txt or cameras.bin")
    return cameras


def colmap_images(file: InputFile) -> list[tuple[str, str, str]]:
    """Name, CAMERA_ID and QW QX QY QZ TX TY TZ of each image in an ``images`` file."""
    rows = _image_rows(file)
    if short := [words for words in rows if len(words) < 10]:
        raise file.error(f"an image has {len(short[0])} entries", "wanted 10")
    return [(words[9], words[8], " ".join(words[1:8])) for words in rows]


def image_pose(file: InputFile, text: str) -> RigidTransform:
    """``camera_from_world`` of QW QX QY QZ TX TY TZ."""
    numbers = file.flat_numbers(text, "the image's pose", 7)
    rotation = rotation_of(file, [*numbers[1:4], numbers[0]], "the quaternion")
    return RigidTransform(rotation, np.array(numbers[4:]))


def _camera_rows(file: InputFile) -> list[list[str]]:
    """CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] of each camera in a ``cameras`` file."""
    with file.naming_errors(), file.open() as stream:
        if file.path.suffix != ".bin":
            return [line.split() for line in map(_text, stream) if line]
        rows = []
        for _ in range(*_take(file, stream, "<Q")):
            number, model, width, height = _take(file, stream, "<IIQQ")
            if model >= len(MODELS):
                wanted = f"wanted COLMAP's numbers up to {len(MODELS) - 1}"
                raise file.error(f"camera {number} is of model {model}", wanted)
            name, (focals, more, _) = list(MODELS.items())[model]
            numbers = _take(file, stream, f"<{focals + 2 + more}d")
            rows.append([str(number), name, str(width), str(height), *map(repr, numbers)])
        return rows


def _image_rows(file: InputFile) -> list[list[str]]:
    """IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME of each image in an ``images`` file."""
    file, rows = replace(file, largest=MAX_FILE_BYTES), []
    with file.naming_errors(), file.open() as stream:
        if file.path.suffix != ".bin":
            is_of_points = False
            for line in stream:
                is_of_points = is_of_points and not _is_image(line)  # some leave out empty ones
                if not is_of_points and (words := _text(line)):
                    rows.append(words.split(maxsplit=9))
                    is_of_points = True
                else:
                    is_of_points = False
            return rows
        size = file.path.stat().st_size
        for _ in range(*_take(file, stream, "<Q")):
            number, *pose, camera = _take(file, stream, "<I7dI")
            start = stream.tell()
            name, end, _ = stream.read(MAX_NAME_LETTERS).partition(b"\0")
            stream.seek(start + len(name + end))
            text, points = name.decode(errors="replace"), 0
            is_name = bool(end and text) and text.isprintable() and "\ufffd" not in text
            if is_name:
                (points,) = _take(file, stream, "<Q")
            if not is_name or stream.tell() + points * POINT_BYTES > size:
                found = f"its image {number} has the name {printable(text, 40)!r}"
                found += f" and {points:,} points" if is_name else ""
                wanted = "wanted COLMAP's images.bin, of names that end in a zero; or images.txt"
                raise file.error(found, wanted)
            stream.seek(points * POINT_BYTES, SEEK_CUR)
            rows.append([str(number), *map(repr, pose), str(camera), text])
        return rows


def _is_image(line: bytes) -> bool:
    """Tell whether a line is of an image: one of points has x, y and a number for each."""
    words = line.split(maxsplit=10)
    if len(words) <= 10:
        return len(words) == 10
    try:
        float(words[9])
    except ValueError:
        return True
    return False


def _take(file: InputFile, stream: IO[bytes], form: str) -> tuple[Any, ...]:
    data = stream.read(count := struct.calcsize(form))
    if len(data) < count:
        raise file.error("it ends too early", "wanted the whole file, copy it again")
    return struct.unpack(form, data)


def _text(line: bytes) -> str:
    return "" if line.startswith(b"#") else line.decode().strip()
