"""OpenCV's calibrations in YAML, XML and JSON, and what ROS and NumPy users write by those names.

Pixel centres are at integers. Names as in OpenCV's own samples (``camera_matrix`` and
``distortion_coefficients``; ``M1``, ``D1``, ``M2``, ``D2`` of a stereo pair), ROS's
``camera_info`` and ``calibrateCamera``'s arguments.
"""

from __future__ import annotations

import re
from itertools import accumulate
from typing import Any

import cv2

from poseviewer.files.camera.file_camera import (
    FileCamera,
    camera_of_matrix,
    lens_of,
    number,
    numbers,
    problem,
    size,
)
from poseviewer.files.quiet import quiet_libraries
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.geometry.lens import LensModel

MATRIX_NAMES = ("cameramatrix", "intrinsicmatrix", "mtx", "k", "m")
"""In small letters, without ``_``."""
DISTORTION_NAMES = ("distortioncoefficients", "distcoeffs", "distcoeff", "dist", "d")
FISHEYE_NAMES = ("fisheye", "equidistant")
STANDARD_NAMES = ("plumbbob", "rationalpolynomial", "opencv", "pinhole", "standard", "radtan")
DEEPEST = 8
DEEPEST_TEXT = 100
BRACKETS = re.compile(r"[\[{]|[\]}]|</|/>|<[A-Za-z_]")


def parse_opencv(name: str, text: str) -> dict[str, Any]:
    """What a YAML or XML file of OpenCV's ``FileStorage`` holds, as dicts, lists and numbers.

    Raises:
        CalibrationFileError: OpenCV cannot read it.
    """
    head = text.lstrip()[:3]
    if head[:1] not in ("%", "<"):  # ROS writes plain YAML
        text = "%YAML:1.0\n" + ("" if head == "---" else "---\n") + text
    if _depth(text) > DEEPEST_TEXT:  # OpenCV's parser would overflow its stack, and end us
        raise problem(name, "nested too deeply", "wanted a calibration")
    mode = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    try:
        with quiet_libraries():
            storage = cv2.FileStorage(text, mode)
            data = _tree(storage.root(), 0) if storage.isOpened() else None
    except (cv2.error, SystemError):
        data = None
    if not isinstance(data, dict):
        raise problem(name, "not YAML or XML that OpenCV reads", "is it a calibration, and whole")
    return data


def opencv_cameras(name: str, data: dict[str, Any], fisheye: bool) -> list[FileCamera]:
    """The cameras in a file's content: one; or several, by their numbers or their objects' names.

    ``fisheye`` says of a file that does not say so that its lens model is the fisheye's.

    Raises:
        CalibrationFileError: there is none, or one is not a camera.
    """
    found = _cameras_of(name, "", data, fisheye)
    for key, value in data.items():
        if isinstance(value, dict):
            found += _cameras_of(name, key, value, fisheye)
    if not found:
        raise problem(
            name, "no camera_matrix in it", "wanted OpenCV's camera_matrix, or fx, fy, cx, cy"
        )
    return found


def _cameras_of(name: str, prefix: str, data: dict[str, Any], fisheye: bool) -> list[FileCamera]:
    plain = {key.lower().replace("_", ""): value for key, value in data.items()}
    cameras = []
    for key, value in plain.items():
        match = re.fullmatch(rf"({'|'.join(MATRIX_NAMES)})(\d*|left|right)", key)
        # A number named k1 is a coefficient, and an object named k may be a camera itself.
        is_list = isinstance(value, list) or (isinstance(value, dict) and "data" in value)
        if match is None or not is_list:
            continue
        which = "-".join(part for part in (prefix, match[2]) if part)
        what = "camera_matrix" + (f" of {which}" if which else "")
        values = numbers(name, value, what)
        camera = camera_of_matrix(name, values, what, _size(name, plain))
        coefficients = _coefficients(name, plain, match[2])
        lens = lens_of(name, _model(name, plain, fisheye), coefficients)
        cameras.append(FileCamera(which, camera_from_integer_centres(camera), lens))
    return cameras


def _coefficients(name: str, plain: dict[str, Any], which: str) -> list[float]:
    for key in DISTORTION_NAMES:
        if plain.get(key + which) is not None:
            return numbers(name, plain[key + which], "distortion_coefficients")
    return []


def _size(name: str, plain: dict[str, Any]) -> tuple[int, int]:
    """(width, height), or (0, 0) where nothing says it."""
    for width, height in (("imagewidth", "imageheight"), ("width", "height")):
        if width in plain and height in plain:
            return size(name, plain[width], "image_width"), size(
                name, plain[height], "image_height"
            )
    for key in ("imagesize", "imgsize", "resolution"):
        if key in plain:
            both = numbers(name, plain[key], "image_size")
            if len(both) != 2:
                raise problem(
                    name, f"image_size has {len(both)} numbers", "wanted width and height"
                )
            return size(name, both[0], "image_size"), size(name, both[1], "image_size")
    return 0, 0


def _model(name: str, plain: dict[str, Any], fisheye: bool) -> LensModel:
    """As the file says: OpenCV's sample by ``fisheye_model: 1``, ROS by ``distortion_model``."""
    if plain.get("fisheyemodel") is not None:
        said = number(name, plain["fisheyemodel"], "fisheye_model") != 0.0
        return "fisheye" if said or fisheye else "opencv"
    for key in ("distortionmodel", "cameramodel", "lensmodel", "model"):
        said = plain.get(key)
        if isinstance(said, str) and said:
            word = said.lower().replace("_", "")
            if word in FISHEYE_NAMES:
                return "fisheye"
            if word not in STANDARD_NAMES:
                raise problem(
                    name, f"{key} is {said[:40]!r}", "wanted OpenCV's standard or fisheye model"
                )
    return "fisheye" if fisheye else "opencv"


def _depth(text: str) -> int:
    """How many brackets or tags are open at most."""
    steps = (-1 if found in ("]", "}", "</", "/>") else 1 for found in BRACKETS.findall(text))
    return max(accumulate(steps), default=0)


def _tree(node: Any, depth: int) -> Any:
    if depth > DEEPEST:
        return None
    if node.isMap():
        return {key: _tree(node.getNode(key), depth + 1) for key in node.keys()}  # noqa: SIM118
    if node.isSeq():
        return [_tree(node.at(i), depth + 1) for i in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None
