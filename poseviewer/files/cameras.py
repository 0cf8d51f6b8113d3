"""Cameras in the files of OpenCV (YAML, XML, JSON; ROS and NumPy users too), BOP and COLMAP; and
the one that took a photo, chosen and scaled.

Pixel centres are at integers but in COLMAP, which counts as we do inside (i + 0.5).
"""

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from poseviewer.errors import CalibrationFileError
from poseviewer.files.checks import Reading
from poseviewer.files.colmap_model import colmap_cameras, colmap_images
from poseviewer.files.structs import checked_camera
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.geometry.lens import COEFFICIENTS, Lens, LensModel

KIND = "file of cameras"
LARGEST_SKEW = 1e-6
"""Share of the focal length."""
ALIASES = {
    "matrix": ("cameramatrix", "intrinsicmatrix", "camk", "mtx", "k", "m"),
    "distortion": ("distortioncoefficients", "distcoeffs", "distcoeff", "dist", "d"),
    "size": ("imagesize", "imgsize", "resolution"),
    "width": ("imagewidth", "width"),
    "height": ("imageheight", "height"),
    "fisheye": ("fisheyemodel",),
    "model": ("distortionmodel", "cameramodel", "lensmodel", "model"),
}
"""Names of a camera's numbers with OpenCV's samples, ROS, BOP and users of NumPy, in small letters,
without ``_``. A number behind a name tells the cameras of a file apart.
"""
LOADER = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
"""Every number a text, every tag and anchor plain; libyaml's where PyYAML was built with it."""
FIELDS = {alias: name for name, aliases in ALIASES.items() for alias in aliases}
LENS_MODELS: dict[str, LensModel] = {
    **dict.fromkeys(("fisheye", "equidistant"), "fisheye"),
    **dict.fromkeys(
        ("plumbbob", "rationalpolynomial", "opencv", "pinhole", "standard", "radtan"), "opencv"
    ),
}


@dataclass(frozen=True, slots=True)
class FileCamera:
    """A camera as a file has it."""

    name: str
    """Name among the file's cameras; "" where there is one alone."""
    camera: Perspective
    """Pixel centres at i + 0.5; 0x0 px where the file does not say the size of its pictures."""
    lens: Lens | None = None
    """None for a pinhole."""
    photos: frozenset[str] = frozenset()
    """File names of the photos it took, as far as the file says."""


def load_cameras(path: str | Path, fisheye: bool = False) -> list[FileCamera]:
    """All cameras in a file; ``fisheye``: OpenCV's fisheye model where it names no other."""
    path = Path(path)
    reading = Reading(path, [], CalibrationFileError, KIND, numbers_as_text=True)
    with reading.naming_errors():
        match path.suffix.lower():
            case ".bin" | ".txt":
                cameras = _colmap_cameras(reading)
            case ".yml" | ".yaml" | ".xml":
                cameras = opencv_cameras(reading, opencv_storage(reading), fisheye)
            case ".json":
                cameras = opencv_cameras(reading, reading.load_object(), fisheye)
            case kind:
                wanted = "wanted .yml, .xml, .json, .txt or .bin"
                raise reading.error(f"its ending is {kind or 'missing'}", wanted)
        return [replace(entry, camera=checked_camera(reading, entry.camera)) for entry in cameras]


def _colmap_cameras(reading: Reading) -> list[FileCamera]:
    """Cameras by their CAMERA_ID; the ``images`` file beside says which photos each took."""
    photos, beside = defaultdict[str, set[str]](set), reading.path.with_stem("images")
    if beside.is_file():
        for name, key, _ in colmap_images(replace(reading, path=beside)):
            photos[key].add(PurePosixPath(name).name)
    return [
        FileCamera(key, *known, frozenset(photos[key]))
        for key, known in colmap_cameras(reading).items()
    ]


def opencv_storage(reading: Reading) -> dict[str, Any]:
    """The dicts, lists and texts in a YAML or XML of OpenCV's ``FileStorage``."""
    text, data = reading.load_text(), None
    try:
        if text.lstrip().startswith("<"):
            data = _of_element(ElementTree.fromstring(text))  # expat refuses bombs of entities
        else:  # its head is none that YAML knows; what it calls a matrix is a mapping
            body = re.sub(r"\A\s*%YAML:1\.0", "", text)
            data = next(iter(yaml.load_all(body, LOADER)), None)
    except (yaml.YAMLError, ElementTree.ParseError, RecursionError):
        pass
    if not isinstance(data, dict):
        raise reading.error("not YAML or XML as OpenCV writes it", "wanted a whole file")
    return data


def _of_element(element: ElementTree.Element) -> Any:
    if not len(element):
        return element.text or ""
    if all(child.tag == "_" for child in element):
        return [_of_element(child) for child in element]
    return {child.tag: _of_element(child) for child in element}


def opencv_cameras(reading: Reading, data: dict[str, Any], fisheye: bool) -> list[FileCamera]:
    """One camera; or several, by their numbers or their objects' names."""
    cameras = []
    if {"fx", "fy", "cx", "cy"} <= set(data):  # as BOP's camera.json says it
        rows = [[data["fx"], 0.0, data["cx"]], [0.0, data["fy"], data["cy"]], [0.0, 0.0, 1.0]]
        data = {**data, "camera_matrix": rows}
    for prefix, value in [("", data), *data.items()]:
        of_number: dict[str, dict[str, Any]] = defaultdict(dict)
        for key, entry in value.items() if isinstance(value, dict) else ():
            stem = str(key).rstrip("0123456789")
            field = FIELDS.get(stem.lower().replace("_", ""))
            if field is not None and entry is not None:
                of_number[str(key)[len(stem) :]].setdefault(field, entry)
        shared = {
            k: v for k, v in of_number.get("", {}).items() if k not in ("matrix", "distortion")
        }
        for number, own in of_number.items():
            matrix = own.get("matrix")
            # A number named k1 is a coefficient, and an object named k may be a camera itself.
            if isinstance(matrix, list) or (isinstance(matrix, dict) and "data" in matrix):
                which = "-".join(part for part in (prefix, number) if part)
                cameras.append(_opencv_camera(reading, which, shared | own, fisheye))
    if not cameras:
        raise reading.error(
            "no camera_matrix in it", "wanted OpenCV's camera_matrix, or fx, fy, cx, cy"
        )
    return cameras


def _opencv_camera(reading: Reading, name: str, own: dict[str, Any], fisheye: bool) -> FileCamera:
    """The camera of what a file says of it, by the names of ``ALIASES``."""
    size = reading.flat_numbers(own["size"], "image_size") if "size" in own else []
    size = [own["width"], own["height"]] if {"width", "height"} <= set(own) else size
    if len(size) not in (0, 2):
        raise reading.error(f"image_size has {len(size)} numbers", "wanted width and height")
    sides = [reading.size(value, "image_size") or 0 for value in size] or [0, 0]
    what = "camera_matrix" + (f" of {name}" if name else "")
    camera = camera_of_matrix(reading, own["matrix"], what, (sides[0], sides[1]))
    coefficients = reading.flat_numbers(own.get("distortion", []), "distortion_coefficients")
    model: LensModel = "fisheye" if fisheye else "opencv"
    if "fisheye" in own:
        model = "fisheye" if reading.number(own["fisheye"], "fisheye_model") else model
    elif isinstance(said := own.get("model"), str) and said:
        known = LENS_MODELS.get(said.lower().replace("_", ""))
        if known is None:
            wanted = "wanted OpenCV's standard or fisheye model"
            raise reading.error(f"its lens model is {said[:40]!r}", wanted)
        model = "fisheye" if fisheye else known
    if any(coefficients) and len(coefficients) not in COEFFICIENTS[model]:
        wanted = f"OpenCV's {'fisheye' if model == 'fisheye' else 'standard'} model has "
        wanted += ", ".join(map(str, COEFFICIENTS[model]))
        raise reading.error(f"{len(coefficients)} distortion coefficients", wanted)
    return FileCamera(name, camera, Lens.of(model, coefficients))


def camera_of_matrix(
    reading: Reading, value: Any, what: str, size: tuple[int, int] = (0, 0)
) -> Perspective:
    """The pinhole (centres at i + 0.5) of a 3x3 matrix without skew (centres at integers)."""
    values = reading.flat_numbers(value, what)
    if len(values) != 9:
        raise reading.error(f"{what} has {len(values)} numbers", "wanted a 3x3 camera matrix")
    matrix = np.array(values).reshape(3, 3)
    fx, fy = (reading.positive(values[4 * i], f"{what}: f{'xy'[i]}") for i in range(2))
    if not np.allclose(matrix[2], [0.0, 0.0, 1.0]) or abs(matrix[1, 0]) > LARGEST_SKEW * fx:
        raise reading.error(f"{what} is {values}", "wanted rows fx 0 cx, 0 fy cy, 0 0 1")
    if abs(matrix[0, 1]) > LARGEST_SKEW * fx:
        raise reading.error(f"{what} has a skew of {matrix[0, 1]:g}", "calibrate without skew")
    camera = Perspective(fx, fy, float(matrix[0, 2]), float(matrix[1, 2]), *size)
    return camera_from_integer_centres(camera)


ROUNDING_PX = 1.0
"""By how much a picture's size may differ from an exact scaling: programs round and cut off."""
MOST_NAMES = 8


@dataclass(frozen=True, slots=True)
class Calibration:
    """A file of cameras, and what the user says of it."""

    path: Path
    camera: str | None = None
    """Which camera of the file; None: the only one, or the one that took the photo."""
    fisheye: bool = False
    """The coefficients are of OpenCV's fisheye model, though the file does not say so."""


def load_calibration(
    choice: Calibration, photo: str, width: int, height: int
) -> tuple[FileCamera, tuple[str, ...]]:
    """Load the camera of a photo of this name and size, scaled if need be; notes say so."""
    chosen = _chosen(choice, load_cameras(choice.path, choice.fisheye), photo)
    camera = chosen.camera
    if not camera.width:
        return replace(chosen, camera=replace(camera, width=width, height=height)), ()
    if (camera.width, camera.height) == (width, height):
        return chosen, ()
    said = f"the camera is for {camera.width}x{camera.height} px, the photo has {width}x{height} px"
    if not _is_scaling(camera, width, height):
        wanted = "calibrate on pictures of the photo's size and orientation"
        raise Reading(choice.path, error_type=CalibrationFileError).error(said, wanted)
    scaled = replace(chosen, camera=camera.resized(width, height))
    return scaled, (f"{choice.path.name}: {said}; it was scaled to the photo's size.",)


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


def _is_scaling(camera: Perspective, width: int, height: int) -> bool:
    """Whether one factor, and rounding, makes one size of the other."""
    least = max((width - ROUNDING_PX) / camera.width, (height - ROUNDING_PX) / camera.height)
    most = min((width + ROUNDING_PX) / camera.width, (height + ROUNDING_PX) / camera.height)
    return least <= most
