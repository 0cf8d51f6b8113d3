"""OpenCV: camera matrix, rotation vector, translation, in the files of ``cv2.FileStorage``.

Names are those of OpenCV's own calibration sample; pixel centres are at integers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.lens_models import seen_as_taken
from poseviewer.files.formats.matrix import camera_from_intrinsics, intrinsics_matrix
from poseviewer.files.formats.request import (
    Request,
    Written,
    lens_from,
    make_record,
    refuse_existing,
    size_of,
)
from poseviewer.files.pose.checks import LARGEST_FILE, Reading, checked_rotation, read_json
from poseviewer.files.pose.file import PoseRecord
from poseviewer.files.quiet import quiet_libraries
from poseviewer.files.writing import write_whole
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.lens import Lens
from poseviewer.geometry.transform import RigidTransform

KINDS = {
    ".yml": cv2.FILE_STORAGE_FORMAT_YAML,
    ".yaml": cv2.FILE_STORAGE_FORMAT_YAML,
    ".json": cv2.FILE_STORAGE_FORMAT_JSON,
}


def write_opencv(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write YAML or JSON, by the ending.

    Raises:
        PoseFileError: parallel projection, another ending, or the file is there already.
    """
    taken, lens = seen_as_taken(record, "OpenCV")
    camera = camera_as_integer_centres(taken)
    assert isinstance(camera, Perspective)
    kind = KINDS.get(out.suffix.lower())
    if kind is None:
        raise PoseFileError(f"{out.name}: OpenCV files end in {', '.join(KINDS)}; name one so.")
    refuse_existing(request, out)
    transform = record.pose.camera_from_model
    storage = cv2.FileStorage(
        out.suffix.lower(), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind
    )
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", intrinsics_matrix(camera))
    coefficients = np.zeros(5) if lens is None else lens.array
    storage.write("distortion_coefficients", coefficients.reshape(-1, 1))
    if lens is not None and lens.model == "fisheye":
        storage.write("fisheye_model", 1)  # as OpenCV's calibration sample says it
    storage.write("rvec", transform.as_rotation_vector().reshape(3, 1))
    storage.write("tvec", np.array(transform.translation).reshape(3, 1))
    write_whole(out, storage.releaseAndGetString().encode(), PoseFileError)
    return Written((out,))


def read_opencv(path: Path, request: Request) -> PoseRecord:
    """Read ``camera_matrix`` or ``K``, ``rvec`` or ``R``, ``tvec`` or ``t``; JSON lists as well.

    Raises:
        PoseFileError: it does not hold them.
    """
    reading = Reading(path.name, [])
    values = _json_values(path) if path.suffix.lower() == ".json" else _yaml_values(path)
    lens = _lens(reading, values)
    matrix = _matrix(reading, values, ("camera_matrix", "K"), (9,)).reshape(3, 3)
    sizes = (_whole(reading, values, "image_width"), _whole(reading, values, "image_height"))
    width, height = size_of(reading, request, sizes)
    camera = camera_from_intrinsics(reading, matrix, width, height)
    rotation = _matrix(reading, values, ("rvec", "R"), (3, 9))
    translation = _matrix(reading, values, ("tvec", "t"), (3,))
    if len(rotation) == 9:
        place = RigidTransform(checked_rotation(reading, rotation.reshape(3, 3)), translation)
    else:
        place = RigidTransform.from_rotation_vector(rotation, translation)
    pose = Pose(camera_from_integer_centres(camera), place)
    return make_record(reading, pose, unit=request.unit, lens=lens)


def _yaml_values(path: Path) -> dict[str, Any]:
    """What ``cv2.FileStorage`` finds at the top of a YAML file."""
    text = _text_of(path)
    try:
        with quiet_libraries():
            storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            root = storage.root()  # which lives no longer than its storage
            return {key: _value(root.getNode(key)) for key in root.keys()}  # noqa: SIM118
    except (cv2.error, SystemError) as error:
        raise PoseFileError(
            f"{path.name}: not YAML as OpenCV writes it; is it whole, does it begin with %YAML?"
        ) from error


def _text_of(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise PoseFileError(f"{path.name}: larger than any pose file; wanted a pose.")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise PoseFileError(f"{path.name}: cannot be read ({reason}); check the path.") from error


def _value(node: cv2.FileNode) -> Any:
    if node.isMap():
        matrix = node.mat()
        return None if matrix is None else matrix.tolist()
    if node.isSeq():
        return [_value(node.at(i)) for i in range(node.size())]
    return node.real() if node.isInt() or node.isReal() else node.string()


def _json_values(path: Path) -> dict[str, Any]:
    """OpenCV's JSON, or anybody's with lists for matrices."""
    reading = Reading(path.name, [])
    values = reading.object(read_json(path), "its content")
    return {
        key: value.get("data") if isinstance(value, dict) and "data" in value else value
        for key, value in values.items()
    }


def _whole(reading: Reading, values: dict[str, Any], name: str) -> int | None:
    value = values.get(name)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return reading.size(value, name)


def _lens(reading: Reading, values: dict[str, Any]) -> Lens | None:
    """``distortion_coefficients``, of the fisheye model where ``fisheye_model`` says so."""
    is_fisheye = bool(reading.number(values.get("fisheye_model") or 0.0, "fisheye_model"))
    for name in ("distortion_coefficients", "dist_coeffs"):
        if values.get(name) is not None:
            numbers = _flat(reading, values[name], name).tolist()
            return lens_from(reading, "fisheye" if is_fisheye else "opencv", numbers)
    return None


def _matrix(
    reading: Reading, values: dict[str, Any], names: tuple[str, str], sizes: tuple[int, ...]
) -> FloatArray:
    """The first of the names that is there, flattened by rows."""
    found = next((name for name in names if values.get(name) is not None), None)
    if found is None:
        raise reading.error(f"it has no {' or '.join(names)}", "wanted a camera and a pose")
    flat = _flat(reading, values[found], found)
    if len(flat) not in sizes:
        raise reading.error(f"{found} has {len(flat)} numbers", f"wanted {sizes[0]}")
    return flat


def _flat(reading: Reading, value: Any, name: str) -> FloatArray:
    if isinstance(value, list):
        return np.array([x for item in value for x in _flat(reading, item, name)], dtype=float)
    return np.array([reading.number(value, name)])
