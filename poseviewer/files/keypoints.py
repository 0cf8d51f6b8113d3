"""Key points of a vehicle from the file beside its model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import Reading, kind_of
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.keypoints import SideKeypoints, VehicleKeypoints
from poseviewer.vehicle.parts import find_wheels

FORMAT, VERSION = "poseviewer-keypoints", 1
KIND = "key point file"


def keypoints_path(mesh_path: str | Path) -> Path:
    """Where the key points of a model stand: ``car.keypoints.json`` beside ``car.glb``."""
    return Path(mesh_path).with_suffix(".keypoints.json")


def load_keypoints(mesh_path: str | Path, mesh: Mesh) -> VehicleKeypoints | None:
    """The key points of a vehicle: from the file beside the model, else from its named wheels.

    None where neither says where the wheels are.

    Raises:
        MeshFileError: the key point file is there, but cannot be used.
    """
    path = keypoints_path(mesh_path)
    if not path.exists():
        return find_wheels(mesh)
    reading = Reading(path, error_type=MeshFileError, kind=KIND)
    with reading.said():
        return _keypoints_in(reading, mesh)


def _keypoints_in(reading: Reading, mesh: Mesh) -> VehicleKeypoints:
    data = reading.load_object()
    if data.get("format", FORMAT) != FORMAT:
        raise reading.error(f"not a {KIND}", f"wanted format {FORMAT!r}")
    version = data.get("version", VERSION)
    if version is True or version != VERSION:
        raise reading.error(f"version is {kind_of(version)}", f"this poseviewer reads {VERSION}")
    unit = data.get("unit")
    if unit is not None and mesh.unit is not None and unit != mesh.unit:
        raise reading.error(
            f"lengths in {kind_of(unit)}, the model's are in {mesh.unit!r}",
            "give them in the model's unit",
        )
    return VehicleKeypoints(_side(reading, data, "left"), _side(reading, data, "right"))


def _side(reading: Reading, data: dict[str, Any], key: str) -> SideKeypoints:
    names = ("rear_wheel", "front_wheel", "axle")
    points = reading.fields(data.get(key), key, **dict.fromkeys(names, Reading.numbers))
    try:
        return SideKeypoints(*map(np.array, points))
    except ValueError as error:
        raise reading.error(f"{key} side: {error}", "mend the key points") from error
