"""4x4 matrices in both camera conventions, row-major, in one JSON file that says so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from poseviewer.errors import PoseFileError
from poseviewer.files.camera.distortion_block import distortion_as_json, distortion_from_json
from poseviewer.files.formats.matrix import as_4x4, from_4x4
from poseviewer.files.formats.request import (
    Request,
    Written,
    make_record,
    refuse_existing,
    size_of,
    unit_of,
)
from poseviewer.files.pose.checks import Reading, read_json
from poseviewer.files.pose.file import PoseRecord, camera_as_json, camera_from_json
from poseviewer.files.writing import write_whole
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


def write_matrices(record: PoseRecord, out: Path, request: Request) -> Written:
    """Write one JSON file: the pose and its inverse for both kinds of axes, and the camera.

    Raises:
        PoseFileError: the file is there already, or cannot be written.
    """
    refuse_existing(request, out)
    opencv = record.pose.camera_from_model
    opengl = OPENGL_FROM_OPENCV @ opencv
    data = {
        "conventions": CONVENTIONS,
        "opencv": _both_ways(opencv),
        "opengl": _both_ways(opengl),
        **camera_as_json(record.pose.camera),
        "image_width": record.pose.camera.width,
        "image_height": record.pose.camera.height,
    }
    if unit := unit_of(record, request):
        data["unit"] = unit
    if record.undistortion is not None:
        data["distortion"] = distortion_as_json(record.undistortion)
    write_whole(out, (json.dumps(data, indent=2) + "\n").encode(), PoseFileError)
    return Written((out,))


def _both_ways(camera_from_model: RigidTransform) -> dict[str, Any]:
    return {
        "camera_from_model": as_4x4(camera_from_model).tolist(),
        "model_from_camera": as_4x4(camera_from_model.inverse()).tolist(),
    }


def read_matrices(path: Path, request: Request) -> PoseRecord:
    """Read such a file; any one of its four matrices is enough.

    Raises:
        PoseFileError: it has none, or no camera.
    """
    reading = Reading(path.name, [])
    data = reading.object(read_json(path), "its content")
    sizes = tuple(reading.size(data.get(f"image_{side}"), side) for side in ("width", "height"))
    width, height = size_of(reading, request, (sizes[0], sizes[1]))
    camera = camera_from_json(reading, data, width, height)
    unit = request.unit or reading.text(data.get("unit"), "unit")
    record = make_record(reading, Pose(camera, _place(reading, data)), unit=unit)
    if data.get("distortion") is None:
        return record
    undistortion = distortion_from_json(reading, data["distortion"], width, height)
    return replace(record, undistortion=undistortion)


def _place(reading: Reading, data: dict[str, Any]) -> RigidTransform:
    for axes in ("opencv", "opengl"):
        group = reading.object(data.get(axes, {}), axes)
        for name, rows in group.items():
            place = from_4x4(reading, rows, f"{axes}.{name}")
            if name == "model_from_camera":
                place = place.inverse()
            elif name != "camera_from_model":
                continue
            return place if axes == "opencv" else OPENGL_FROM_OPENCV @ place
    raise reading.error(
        "it has no matrix", "wanted camera_from_model or model_from_camera in opencv or opengl"
    )
