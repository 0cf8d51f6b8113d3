"""Matrices: 4x4 in both camera conventions, in a JSON file that says so; and OpenCV's camera
matrix, rotation vector and translation, in the files of ``cv2.FileStorage``, by the names of
OpenCV's own calibration sample. Rows first; pixel centres are at integers.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from poseviewer.errors import PoseFileError
from poseviewer.files.cameras import camera_of_matrix, lens_of, opencv_storage
from poseviewer.files.checks import Reading, checked_rotation
from poseviewer.files.formats.conversion import (
    ConvertOptions,
    Format,
    Written,
    json_text,
    make_record,
    photo_name,
    seen_as_taken,
    size_of,
    unit_of,
    write_new,
)
from poseviewer.files.pose import (
    PoseRecord,
    SetFrame,
    camera_as_json,
    camera_from_json,
    distortion_as_json,
    distortion_from_json,
    set_frame,
)
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.lens import Lens, opencv_matrix
from poseviewer.geometry.transform import RigidTransform

STORAGES = {
    ".yml": cv2.FILE_STORAGE_FORMAT_YAML,
    ".yaml": cv2.FILE_STORAGE_FORMAT_YAML,
    ".json": cv2.FILE_STORAGE_FORMAT_JSON,
}
CONVENTIONS = (
    "Row-major; points are columns: x_in_camera = camera_from_model @ x_in_model. "
    "OpenCV camera axes: x right, y down, z forward. OpenGL camera axes: x right, y up, z "
    "backward. All right-handed, lengths in the model's unit. fx fy cx cy in px, with pixel "
    "centres at integers: u = fx x/z + cx, v = fy y/z + cy with OpenCV axes; under parallel "
    "projection u = scale x + cx, v = scale y + cy. In a set of photos: x_in_set = "
    "set_from_model @ x_in_model, in the set's unit."
)


def as_4x4(transform: RigidTransform) -> FloatArray:
    """``[[R, t], [0, 1]]`` (4, 4), for points as columns."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = transform.rotation, transform.translation
    return matrix


def from_4x4(reading: Reading, rows: Any, what: str) -> RigidTransform:
    """The rigid transform in 4 rows of 4 numbers (or 3, without the last); raises the reading's
    error where it is something else.
    """
    matrix = reading.matrix(rows, what, (3, 4), 4)
    if len(matrix) == 4 and not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
        raise reading.error(f"the last row of {what} is {rows[3]}", "wanted 0 0 0 1 (row-major)")
    return RigidTransform(checked_rotation(reading, matrix[:3, :3]), matrix[:3, 3])


def write_matrices(record: PoseRecord, out: Path, request: ConvertOptions) -> Written:
    """Write one JSON file: the pose and its inverse for both kinds of axes, and the camera; of a
    set its frame, and the same for its other photos.
    """
    data: dict[str, Any] = {"conventions": CONVENTIONS, **_seen(record)}
    if unit := unit_of(record, request):
        data["unit"] = unit
    if frame := set_frame(record):
        data["set"] = {
            **frame_as_json(frame),
            "views": [{"photo": photo_name(one), **_seen(one)} for one, _ in request.others],
        }
    return write_new(request, {out: json_text(data)})


def frame_as_json(frame: SetFrame) -> dict[str, Any]:
    """The frame of a set; its matrix is for points as columns."""
    unit = {} if frame.unit is None else {"unit": frame.unit}
    return {"file": frame.name, **unit, "set_from_model": frame.set_from_model.tolist()}


def _seen(record: PoseRecord) -> dict[str, Any]:
    """Of one photo."""
    data: dict[str, Any] = {}
    opencv = record.pose.camera_from_model
    for axes, place in (("opencv", opencv), ("opengl", OPENGL_FROM_OPENCV @ opencv)):
        data[axes] = {
            "camera_from_model": as_4x4(place).tolist(),
            "model_from_camera": as_4x4(place.inverse()).tolist(),
        }
    data |= camera_as_json(record.pose.camera)
    data |= {"image_width": record.pose.camera.width, "image_height": record.pose.camera.height}
    if record.undistortion is not None:
        data["distortion"] = distortion_as_json(record.undistortion)
    return data


def read_matrices(path: Path, request: ConvertOptions) -> PoseRecord:
    """Read such a file; any one of its four matrices is enough."""
    reading = Reading(path)
    data = reading.load_object()
    width, height = size_of(reading, request, data.get("image_width"), data.get("image_height"))
    camera = camera_from_json(reading, data, width, height)
    unit = request.unit or reading.text(data.get("unit"), "unit")
    record = make_record(reading, Pose(camera, _place(reading, data)), unit=unit)
    if data.get("distortion") is None:
        return record
    undistortion = distortion_from_json(reading, data["distortion"], width, height)
    return replace(record, undistortion=undistortion)


def _place(reading: Reading, data: dict[str, Any]) -> RigidTransform:
    for axes in ("opencv", "opengl"):
        for name, rows in reading.object(data.get(axes, {}), axes).items():
            if name in ("camera_from_model", "model_from_camera"):
                place = from_4x4(reading, rows, f"{axes}.{name}")
                place = place if name == "camera_from_model" else place.inverse()
                return place if axes == "opencv" else OPENGL_FROM_OPENCV @ place
    raise reading.error(
        "it has no matrix", "wanted camera_from_model or model_from_camera in opencv or opengl"
    )


def write_opencv(record: PoseRecord, out: Path, request: ConvertOptions) -> Written:
    """Write YAML or JSON, by the ending."""
    camera, (_, lens) = seen_as_taken(record, "OpenCV", opencv_lens)
    ending, transform = out.suffix.lower(), record.pose.camera_from_model
    if ending not in STORAGES:
        raise PoseFileError(f"{out.name}: OpenCV files end in {', '.join(STORAGES)}; name one so.")
    mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | STORAGES[ending]
    storage = cv2.FileStorage(ending, mode)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("camera_matrix", opencv_matrix(camera))
    coefficients = np.zeros(5) if lens is None else lens.array
    storage.write("distortion_coefficients", coefficients.reshape(-1, 1))
    if lens is not None and lens.model == "fisheye":
        storage.write("fisheye_model", 1)  # as OpenCV's calibration sample says it
    storage.write("rvec", transform.as_rotation_vector().reshape(3, 1))
    storage.write("tvec", np.array(transform.translation).reshape(3, 1))
    if frame := set_frame(record):
        storage.write("set_file", frame.name)
        storage.write("set_unit", frame.unit or "")
        storage.write("set_from_model", frame.set_from_model)
    return write_new(request, {out: storage.releaseAndGetString()})


def opencv_lens(lens: Lens | None) -> tuple[str, Lens | None]:
    """What OpenCV calls a lens's model, and the lens."""
    return ("OpenCV fisheye" if lens and lens.model == "fisheye" else "OpenCV"), lens


def read_opencv(path: Path, request: ConvertOptions) -> PoseRecord:
    """Read ``camera_matrix`` or ``K``, ``rvec`` or ``R``, ``tvec`` or ``t``; JSON lists as well."""
    reading = Reading(path)
    is_json = path.suffix.lower() == ".json"
    data = reading.load_object() if is_json else opencv_storage(reading)
    key, distortion = _first(data, "distortion_coefficients", "dist_coeffs")
    coefficients = [] if distortion is None else reading.flat_numbers(distortion, key)
    is_fisheye = bool(reading.number(data.get("fisheye_model") or 0.0, "fisheye_model"))
    lens = lens_of(reading, "fisheye" if is_fisheye else "opencv", coefficients)
    key, matrix = _first(data, "camera_matrix", "K")
    camera = camera_of_matrix(reading, matrix, key)
    width, height = size_of(reading, request, data.get("image_width"), data.get("image_height"))
    camera = replace(camera, width=width, height=height)
    rotation = _numbers(reading, data, ("rvec", "R"), (3, 9))
    translation = _numbers(reading, data, ("tvec", "t"), (3,))
    if len(rotation) == 9:
        place = RigidTransform(checked_rotation(reading, rotation.reshape(3, 3)), translation)
    else:
        place = RigidTransform.from_rotation_vector(rotation, translation)
    return make_record(reading, Pose(camera, place), unit=request.unit, lens=lens)


def _first(data: dict[str, Any], *names: str) -> tuple[str, Any]:
    """The first of the names that is there, and what it holds; (all of them, None): none is."""
    name = next((name for name in names if data.get(name) is not None), "")
    return name or " or ".join(names), data.get(name)


def _numbers(
    reading: Reading, data: dict[str, Any], names: tuple[str, str], sizes: tuple[int, ...]
) -> FloatArray:
    name, value = _first(data, *names)
    numbers = reading.flat_numbers(value, name)
    if len(numbers) not in sizes:
        raise reading.error(f"{name} has {len(numbers)} numbers", f"wanted {sizes[0]}")
    return np.array(numbers)


MATRICES = Format(write_matrices, read_matrices, parallel=True, both_photos=True)
OPENCV = Format(write_opencv, read_opencv, lens_as=opencv_lens, several=False)
