"""Cameras in the files of OpenCV (YAML, XML, JSON; ROS and NumPy users too), BOP and COLMAP; and
the one that took a photo, chosen and scaled.

Pixel centres are at integers but in COLMAP, which counts as we do inside (i + 0.5).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np

from poseviewer.errors import CalibrationFileError
from poseviewer.files.checks import Reading, checked_camera, quiet_libraries
from poseviewer.files.colmap_model import SUFFIXES as COLMAP_SUFFIXES
from poseviewer.files.colmap_model import camera_rows, image_rows
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel

KIND = "file of cameras"
LARGEST_FILE = 50_000_000
"""Bytes: the cameras of a thousand photos have some hundred thousand."""
LARGEST_SKEW = 1e-6
"""As a share of the focal length."""
MATRIX_NAMES = ("cameramatrix", "intrinsicmatrix", "mtx", "k", "m")
"""Of OpenCV's samples, ROS and ``calibrateCamera``'s arguments; in small letters, without ``_``."""
DISTORTION_NAMES = ("distortioncoefficients", "distcoeffs", "distcoeff", "dist", "d")
SIZE_NAMES = (("imagewidth", "imageheight"), ("width", "height"))
FISHEYE_NAMES = ("fisheye", "equidistant")
STANDARD_NAMES = ("plumbbob", "rationalpolynomial", "opencv", "pinhole", "standard", "radtan")
MOST_LINES = 20_000
"""Of a YAML or XML: OpenCV's parser takes a time that grows by the square of the keys."""
MOST_ENTRIES = 100
"""Of a list: no longer one is of use, and OpenCV walks to each entry from the first."""
DEEPEST, DEEPEST_TEXT = 8, 100
"""Levels of a calibration that are looked into, and brackets that OpenCV's parser is trusted with:
deeper ones overflow its stack.
"""
BRACKETS = re.compile(r"[\[{]|[\]}]|</|/>|<[A-Za-z_]")

Coefficients = Callable[[list[float]], list[float]]
COLMAP_MODELS: dict[str, tuple[int, int, LensModel, Coefficients]] = {
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
"""How many focal lengths and distortion parameters, the principal point between them; OpenCV's
model, and its coefficients. https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h
"""


@dataclass(frozen=True, slots=True)
class FileCamera:
    """A camera as a file has it."""

    name: str
    """What it is called among the file's cameras; "" where there is one alone."""
    camera: Perspective
    """Pixel centres at i + 0.5; 0x0 px where the file does not say the size of its pictures."""
    lens: Lens | None = None
    """None for a pinhole."""
    photos: frozenset[str] = frozenset()
    """File names of the photos it took, as far as the file says."""


def load_cameras(path: str | Path, fisheye: bool = False) -> list[FileCamera]:
    """All cameras in an OpenCV YAML, XML or JSON, a BOP JSON or a COLMAP ``cameras.txt`` or
    ``cameras.bin``.

    ``fisheye`` says of an OpenCV file that does not say so that its lens model is the fisheye's.

    Raises:
        CalibrationFileError: it cannot be used as one of these.
    """
    path = Path(path)
    reading = Reading(path, [], CalibrationFileError, KIND, LARGEST_FILE, numbers_as_text=True)
    with reading.naming_errors():
        found = _cameras_in(reading, path.suffix.lower(), fisheye)
        return [replace(one, camera=checked_camera(reading, one.camera)) for one in found]


DOCUMENT = re.compile(r"^(---(?=\s|\Z)|\.\.\.)", re.MULTILINE)
"""Where a document of YAML begins or ends."""
LINES_BEFORE = re.compile(r"\A([ \t\r]*([%#][^\n]*)?\n)*\s*")
"""Directives, comments and empty lines, before what is of use."""


def _cameras_in(reading: Reading, kind: str, fisheye: bool) -> list[FileCamera]:
    if kind in COLMAP_SUFFIXES:
        return _colmap_cameras(reading)
    if kind in (".yml", ".yaml", ".xml"):
        return _opencv_cameras(reading, opencv_storage(reading), fisheye)
    if kind == ".json":
        data = reading.load_object()
        return bop_cameras(reading, data) or _opencv_cameras(reading, data, fisheye)
    raise reading.error(
        f"its ending is {kind or 'missing'}", "wanted .yml, .xml, .json, .txt or .bin"
    )


def bop_cameras(reading: Reading, data: dict[str, Any]) -> list[FileCamera]:
    """The camera of BOP's ``camera.json``, or those of a ``scene_camera.json``, which say no size,
    named by their photos' numbers; none where it is neither.

    https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
    """
    if data and all(isinstance(entry, dict) and "cam_K" in entry for entry in data.values()):
        return [
            FileCamera(key, camera_of_matrix(reading, entry["cam_K"], f"cam_K of {key}"))
            for key, entry in data.items()
        ]
    if not {"fx", "fy", "cx", "cy"} <= set(data):
        return []
    fx, fy, cx, cy, width, height = reading.fields(
        data, "", fx=Reading.positive, fy=Reading.positive, cx=Reading.number, cy=Reading.number,
        width=Reading.size, height=Reading.size,
    )  # fmt: skip
    camera = camera_from_integer_centres(Perspective(fx, fy, cx, cy, width or 0, height or 0))
    return [FileCamera("", camera)]


def opencv_storage(reading: Reading) -> dict[str, Any]:
    """What the file, a YAML or XML of OpenCV's ``FileStorage``, holds: dicts, lists and numbers;
    raises the reading's error where OpenCV cannot read it.
    """
    text = reading.load_text()
    head = text.lstrip()[:3]
    if head[:1] not in ("%", "<"):  # ROS writes plain YAML
        text = "%YAML:1.0\n" + ("" if head == "---" else "---\n") + text
    if text.count("\n") > MOST_LINES:
        found = f"more than {MOST_LINES:,} lines"
        raise reading.error(found, "wanted the camera, without the views it was calibrated from")
    steps = (-1 if found in ("]", "}", "</", "/>") else 1 for found in BRACKETS.findall(text))
    if max(accumulate(steps), default=0) > DEEPEST_TEXT:
        raise reading.error("nested too deeply", "wanted a calibration or a pose")
    if head[:1] != "<":
        text = _first_document(text)
    data = None
    try:
        with quiet_libraries():
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            data = _tree(storage.root(), 0) if storage.isOpened() else None
    except (cv2.error, SystemError):
        pass
    if not isinstance(data, dict):
        raise reading.error("not YAML or XML that OpenCV reads", "wanted a whole file")
    return data


def _first_document(text: str) -> str:
    """The first document of a YAML text, no keys where it is a list: OpenCV 5.0 goes on for ever
    at a ``-`` after the end of one.
    """
    marks = list(DOCUMENT.finditer(text))
    begins = bool(marks) and not LINES_BEFORE.sub("", text[: marks[0].start()])
    ends = [mark.start() for mark in marks[begins:]]
    first = text[: ends[0]] if ends else text
    body = first[marks[0].end() :] if begins else first
    return "%YAML:1.0\n---\n" if LINES_BEFORE.sub("", body).startswith("-") else first


def _tree(node: Any, depth: int) -> Any:
    if depth > DEEPEST:
        return None
    if node.isMap():
        return {key: _tree(node.getNode(key), depth + 1) for key in node.keys()}  # noqa: SIM118
    if node.isSeq() and node.size() > MOST_ENTRIES:
        return f"a list of {node.size()}"
    if node.isSeq():
        return [_tree(node.at(i), depth + 1) for i in range(node.size())]
    if node.isString():
        return node.string()
    return node.real() if node.isReal() or node.isInt() else None


def _opencv_cameras(reading: Reading, data: dict[str, Any], fisheye: bool) -> list[FileCamera]:
    """One camera; or several, by their numbers or their objects' names."""
    objects = [("", data), *((key, value) for key, value in data.items())]
    found = []
    for prefix, value in objects:
        if isinstance(value, dict):
            plain = {key.lower().replace("_", ""): entry for key, entry in value.items()}
            found += _cameras_of(reading, prefix, plain, fisheye)
    if not found:
        raise reading.error(
            "no camera_matrix in it", "wanted OpenCV's camera_matrix, or fx, fy, cx, cy"
        )
    return found


def _cameras_of(
    reading: Reading, prefix: str, plain: dict[str, Any], fisheye: bool
) -> list[FileCamera]:
    cameras = []
    for key, value in plain.items():
        match = re.fullmatch(rf"({'|'.join(MATRIX_NAMES)})(\d*|left|right)", key)
        # A number named k1 is a coefficient, and an object named k may be a camera itself.
        is_list = isinstance(value, list) or (isinstance(value, dict) and "data" in value)
        if match is None or not is_list:
            continue
        which = "-".join(part for part in (prefix, match[2]) if part)
        what = "camera_matrix" + (f" of {which}" if which else "")
        camera = camera_of_matrix(reading, value, what, _size(reading, plain))
        names = (name + match[2] for name in DISTORTION_NAMES)
        distortion = next((plain[name] for name in names if plain.get(name) is not None), [])
        coefficients = reading.flat_numbers(distortion, "distortion_coefficients")
        lens = lens_of(reading, _model(reading, plain, fisheye), coefficients)
        cameras.append(FileCamera(which, camera, lens))
    return cameras


def _size(reading: Reading, plain: dict[str, Any]) -> tuple[int, int]:
    """(width, height), or (0, 0) where nothing says it."""
    both = next(([plain[w], plain[h]] for w, h in SIZE_NAMES if w in plain and h in plain), None)
    for key in ("imagesize", "imgsize", "resolution"):
        if both is None and key in plain:
            both = reading.flat_numbers(plain[key], "image_size")
            if len(both) != 2:
                found = f"image_size has {len(both)} numbers"
                raise reading.error(found, "wanted width and height")
    if both is None:
        return 0, 0
    width, height = map(reading.size, both, ("image_width", "image_height"))
    return width or 0, height or 0


def _model(reading: Reading, plain: dict[str, Any], fisheye: bool) -> LensModel:
    """As the file says: OpenCV's sample by ``fisheye_model: 1``, ROS by ``distortion_model``."""
    if plain.get("fisheyemodel") is not None:
        said = reading.number(plain["fisheyemodel"], "fisheye_model") != 0.0
        return "fisheye" if said or fisheye else "opencv"
    for key in ("distortionmodel", "cameramodel", "lensmodel", "model"):
        said = plain.get(key)
        if isinstance(said, str) and said:
            word = said.lower().replace("_", "")
            if word in FISHEYE_NAMES:
                return "fisheye"
            if word not in STANDARD_NAMES:
                wanted = "wanted OpenCV's standard or fisheye model"
                raise reading.error(f"{key} is {said[:40]!r}", wanted)
    return "fisheye" if fisheye else "opencv"


def camera_of_matrix(
    reading: Reading, value: Any, what: str, size: tuple[int, int] = (0, 0)
) -> Perspective:
    """The camera (pixel centres at i + 0.5) of a 3x3 camera matrix with pixel centres at integers;
    raises the reading's error where it is not the matrix of a pinhole without skew.
    """
    values = reading.flat_numbers(value, what)
    if len(values) != 9:
        raise reading.error(f"{what} has {len(values)} numbers", "wanted a 3x3 camera matrix")
    matrix = np.array(values).reshape(3, 3)
    fx, fy = (reading.positive(matrix[i, i], f"{what}: f{'xy'[i]}") for i in range(2))
    if not np.allclose(matrix[2], [0.0, 0.0, 1.0]) or abs(matrix[1, 0]) > LARGEST_SKEW * fx:
        raise reading.error(f"{what} is {values}", "wanted rows fx 0 cx, 0 fy cy, 0 0 1")
    if abs(matrix[0, 1]) > LARGEST_SKEW * fx:
        raise reading.error(f"{what} has a skew of {matrix[0, 1]:g}", "calibrate without skew")
    camera = Perspective(fx, fy, float(matrix[0, 2]), float(matrix[1, 2]), *size)
    return camera_from_integer_centres(camera)


def lens_of(reading: Reading, model: LensModel, coefficients: list[float]) -> Lens | None:
    """The lens with these coefficients; None where they are all 0, and nothing is distorted.

    Raises the reading's error where the model has not as many.
    """
    if not any(coefficients):
        return None
    if len(coefficients) not in COEFFICIENTS[model]:
        wanted = ", ".join(str(count) for count in COEFFICIENTS[model])
        raise reading.error(
            f"{len(coefficients)} distortion coefficients",
            f"OpenCV's {'fisheye' if model == 'fisheye' else 'standard'} model has {wanted}",
        )
    return Lens(model, tuple(coefficients))


def _colmap_cameras(reading: Reading) -> list[FileCamera]:
    """The cameras of a ``cameras`` file, named by their CAMERA_ID; the ``images`` file beside it
    says which photos each took.
    """
    photos: dict[str, set[str]] = defaultdict(set)
    beside = replace(reading, path=reading.path.with_stem("images"))
    if beside.path.is_file():
        for words in image_rows(beside):
            if len(words) == 10:
                photos[words[8]].add(PurePosixPath(words[9]).name)
    cameras = [
        FileCamera(words[0], *colmap_camera(reading, words), frozenset(photos[words[0]]))
        for words in camera_rows(reading)
    ]
    if not cameras:
        raise reading.error("holds no camera", "wanted COLMAP's cameras.txt or cameras.bin")
    return cameras


def colmap_camera(reading: Reading, words: list[str]) -> tuple[Perspective, Lens | None]:
    """The camera and lens of a row of a ``cameras`` file: CAMERA_ID MODEL WIDTH HEIGHT PARAMS[].

    Raises the reading's error where it is none, or of a model that OpenCV does not have.
    """
    if len(words) < 5 or not words[0].isdigit():
        found = f"a line reads {' '.join(words)[:40]!r}"
        raise reading.error(found, "wanted COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]")
    key, model = words[:2]
    if model not in COLMAP_MODELS:
        found = f"camera {key} is of model {model[:30]}"
        raise reading.error(
            found,
            f"wanted one of {', '.join(COLMAP_MODELS)}, or undistort the images first (colmap "
            "image_undistorter)",
        )
    focals, more, lens, coefficients = COLMAP_MODELS[model]
    what = f"the size of camera {key}"
    width, height = (reading.size(n, what) or 0 for n in reading.words(" ".join(words[2:4]), what))
    values = reading.words(" ".join(words[4:]), f"the parameters of camera {key}")
    if len(values) != focals + 2 + more:
        found = f"camera {key} has {len(values)} parameters"
        raise reading.error(found, f"{model} has {focals + 2 + more}")
    fx, fy = (reading.positive(values[i], f"focal length of {key}") for i in (0, focals - 1))
    cx, cy = values[focals : focals + 2]
    camera = Perspective(fx, fy, cx, cy, width, height)
    found = coefficients(values[focals + 2 :]) if more else []
    return camera, lens_of(reading, lens, found)


ROUNDING_PX = 1.0
"""By how much a picture's size may differ from an exact scaling: programs round and cut off."""
MOST_NAMES = 8


@dataclass(frozen=True, slots=True)
class Calibration:
    """A file of cameras, and what the user says of it."""

    path: Path
    camera: str | None = None
    """Which camera of the file; None: the only one, or the one that took the photo."""
    crop: tuple[int, int, int, int] | None = None
    """The rectangle (left, top, width, height) of the calibrated picture that the photo shows."""
    resized: bool = False
    """The photo is the calibrated picture, or its rectangle, in another size."""
    fisheye: bool = False
    """The coefficients are of OpenCV's fisheye model, though the file does not say so."""
    zoom: float = 1.0
    """Focal length of the undistorted photo, as a share of the calibrated one."""


def load_calibration(choice: Calibration, photo: str, width: int, height: int) -> FileCamera:
    """The camera that took the photo named ``photo``, of ``width`` x ``height`` px.

    Raises:
        CalibrationFileError: the file cannot be used; it has several cameras and none of them is
            chosen; the camera is for pictures of another size.
    """
    found = _chosen(choice, load_cameras(choice.path, choice.fisheye), photo)
    return replace(found, camera=_for_size(choice, found.camera, width, height))


def _chosen(choice: Calibration, cameras: list[FileCamera], photo: str) -> FileCamera:
    reading = Reading(choice.path, error_type=CalibrationFileError)
    if choice.camera is not None:
        for camera in cameras:
            if camera.name == choice.camera:
                return camera
        raise reading.error(f"no camera {choice.camera[:30]!r} in it", f"it has {_names(cameras)}")
    if len(cameras) == 1:
        return cameras[0]
    stem = Path(photo).stem
    named = [c for c in cameras if photo in c.photos]
    # BOP numbers its photos: 000017.png is the scene's 17.
    named = named or [c for c in cameras if stem.isdigit() and c.name == str(int(stem))]
    if len(named) == 1:
        return named[0]
    found = f"{len(cameras)} cameras, {_names(cameras)}, and none of them named after {photo}"
    raise reading.error(found, "choose one by --calibration-camera NAME")


def _names(cameras: list[FileCamera]) -> str:
    names = [repr(camera.name) if camera.name else "one without a name" for camera in cameras]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


def _for_size(choice: Calibration, camera: Perspective, width: int, height: int) -> Perspective:
    """The camera of the photo: cropped and resized as the user says, or of its size already."""
    reading = Reading(choice.path, error_type=CalibrationFileError)
    sized = camera.width > 0
    if choice.crop is not None:
        left, top, across, down = choice.crop
        outside = sized and (left + across > camera.width or top + down > camera.height)
        if min(left, top) < 0 or min(across, down) < 1 or outside:
            found = f"is for {_size_text(camera)}, and {left},{top},{across},{down} is not inside"
            raise reading.error(found, "give --calibration-crop left,top,width,height in its px")
        camera = camera.cropped(left, top, across, down)
    elif not sized:
        if choice.resized:
            found = "says no size of its pictures"
            raise reading.error(found, "give it as --calibration-crop 0,0,WIDTH,HEIGHT")
        return replace(camera, width=width, height=height)
    if (camera.width, camera.height) == (width, height):
        return camera
    if choice.resized and _is_scaling(camera, width, height):
        return camera.resized(width, height)
    found = f"the camera is for {_size_text(camera)}, the photo has {width}x{height} px"
    raise reading.error(found, _advice(choice, camera, width, height))


def _advice(choice: Calibration, camera: Perspective, width: int, height: int) -> str:
    if (camera.height, camera.width) == (width, height):
        return "the photo is turned upright, calibrate on upright photos"
    if _is_scaling(camera, width, height):
        return "if the photo is the whole picture resized, add --calibration-resized"
    if choice.resized:
        return "their sides differ in ratio, so it is no plain resizing"
    return "if it is a part of the calibrated picture, add --calibration-crop left,top,width,height"


def _is_scaling(camera: Perspective, width: int, height: int) -> bool:
    """Whether one factor, and rounding, makes one size of the other."""
    least = max((width - ROUNDING_PX) / camera.width, (height - ROUNDING_PX) / camera.height)
    most = min((width + ROUNDING_PX) / camera.width, (height + ROUNDING_PX) / camera.height)
    return least <= most


def _size_text(camera: Perspective) -> str:
    return f"{camera.width}x{camera.height} px" if camera.width else "pictures of unsaid size"
