"""4x4 matrices in both camera conventions, row-major, in one JSON file that says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.files.checks import Reading, checked_rotation
from poseviewer.files.formats.request import (
    Request,
    Written,
    json_text,
    make_record,
    size_of,
    unit_of,
    write_new,
)
from poseviewer.files.pose import (
    PoseRecord,
    camera_as_json,
    camera_from_json,
    distortion_as_json,
    distortion_from_json,
)
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.frames import OPENGL_FROM_OPENCV
from poseviewer.geometry.transform import RigidTransform

CONVENTIONS = (
    "Row-major; points are columns: x_in_camera = camera_from_model @ x_in_model. "
    "OpenCV camera axes: x right, y down, z forward. OpenGL camera axes: x right, y up, z "
    "backward. All right-handed, lengths in the model's unit. fx fy cx cy in px, with pixel "
    "centres at integers: u = fx x/z + cx, v = fy y/z + cy with OpenCV axes; under parallel "
    "projection u = scale x + cx, v = scale y + cy."
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


def write_matrices(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write one JSON file: the pose and its inverse for both kinds of axes, and the camera."""
    opencv = record.pose.camera_from_model
    data: dict[str, Any] = {"conventions": CONVENTIONS}
    for axes, place in (("opencv", opencv), ("opengl", OPENGL_FROM_OPENCV @ opencv)):
        data[axes] = {
            "camera_from_model": as_4x4(place).tolist(),
            "model_from_camera": as_4x4(place.inverse()).tolist(),
        }
    data |= camera_as_json(record.pose.camera)
    data |= {"image_width": record.pose.camera.width, "image_height": record.pose.camera.height}
    if unit := unit_of(record, request):
        data["unit"] = unit
    if record.undistortion is not None:
        data["distortion"] = distortion_as_json(record.undistortion)
    return write_new(request, {out: json_text(data)})


def read_matrices(path: Path, request: Request) -> PoseRecord:
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
