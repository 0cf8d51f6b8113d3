"""COLMAP's ``cameras.txt`` (and ``images.txt`` beside it, for which camera took which photo).

Pixel centres are at i + 0.5, as inside: https://colmap.github.io/format.html#cameras-txt. Models
and the order of their parameters: https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from poseviewer.files.camera.file_camera import (
    FileCamera,
    lens_of,
    number,
    problem,
    read_text,
    size,
)
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import LensModel

Coefficients = Callable[[list[float]], list[float]]
MODELS: dict[str, tuple[int, int, LensModel, Coefficients]] = {
    "SIMPLE_PINHOLE": (1, 0, "opencv", lambda _: []),
    "PINHOLE": (2, 0, "opencv", lambda _: []),
    "SIMPLE_RADIAL": (1, 1, "opencv", lambda k: [k[0], 0.0, 0.0, 0.0, 0.0]),
    "RADIAL": (1, 2, "opencv", lambda k: [k[0], k[1], 0.0, 0.0, 0.0]),
    "OPENCV": (2, 4, "opencv", lambda k: [*k, 0.0]),
    "FULL_OPENCV": (2, 8, "opencv", lambda k: k),
    "SIMPLE_RADIAL_FISHEYE": (1, 1, "fisheye", lambda k: [k[0], 0.0, 0.0, 0.0]),
    "RADIAL_FISHEYE": (1, 2, "fisheye", lambda k: [k[0], k[1], 0.0, 0.0]),
    "OPENCV_FISHEYE": (2, 4, "fisheye", lambda k: k),
}
"""How many focal lengths and distortion parameters; OpenCV's model, and its coefficients. The
principal point stands between them."""


def colmap_cameras(path: Path) -> list[FileCamera]:
    """The cameras of a file, named by their CAMERA_ID.

    Raises:
        CalibrationFileError: it is not such a file, or a camera's model is not one of OpenCV's.
    """
    photos = _photos_beside(path)
    lines = [line.split() for line in read_text(path).splitlines()]
    rows = [words for words in lines if words and not words[0].startswith("#")]
    if not rows:
        raise problem(path.name, "holds no camera", "wanted COLMAP's cameras.txt")
    return [_camera(path.name, words, photos) for words in rows]


def _camera(name: str, words: list[str], photos: dict[str, set[str]]) -> FileCamera:
    if len(words) < 5 or not words[0].isdigit():
        found = f"a line reads {' '.join(words)[:40]!r}"
        raise problem(name, found, "wanted COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]")
    key, model = words[:2]
    if model not in MODELS:
        raise problem(
            name, f"camera {key} is of model {model[:30]}", f"wanted one of {', '.join(MODELS)}"
        )
    focals, more, lens, coefficients = MODELS[model]
    width, height = (size(name, word, f"the size of camera {key}") for word in words[2:4])
    values = [number(name, word, f"a parameter of camera {key}") for word in words[4:]]
    if len(values) != focals + 2 + more:
        found = f"camera {key} has {len(values)} parameters"
        raise problem(name, found, f"{model} has {focals + 2 + more}")
    fx, fy = (number(name, values[i], f"focal length of {key}", True) for i in (0, focals - 1))
    cx, cy = values[focals : focals + 2]
    camera = Perspective(fx, fy, cx, cy, width, height)
    found = coefficients(values[focals + 2 :]) if more else []
    return FileCamera(key, camera, lens_of(name, lens, found), frozenset(photos[key]))


def _photos_beside(path: Path) -> dict[str, set[str]]:
    """Which photos each camera took, from ``images.txt`` beside the cameras, if it is there.

    Of each pair of lines the first is IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME.
    """
    photos: dict[str, set[str]] = defaultdict(set)
    beside = path.with_name("images.txt")
    if not path.is_file() or not beside.is_file():
        return photos
    lines = [line for line in read_text(beside).splitlines() if not line.startswith("#")]
    for line in lines[::2]:
        words = line.split(maxsplit=9)
        if len(words) == 10:
            photos[words[8]].add(PurePosixPath(words[9]).name)
    return photos
