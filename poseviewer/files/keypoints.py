"""Key points of a vehicle from the file beside its model."""

from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import Reading
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from poseviewer.vehicle.wheel_parts import find_wheels

FORMAT = "poseviewer-keypoints"
KIND = "key point file"


def keypoints_path(mesh_path: str | Path) -> Path:
    """Path of a model's key points: ``car.keypoints.json`` beside ``car.glb``."""
    return Path(mesh_path).with_suffix(".keypoints.json")


def load_keypoints(mesh_path: str | Path, mesh: Mesh) -> VehicleKeypoints | None:
    """Key points from the file beside the model, else from its named wheels; None without."""
    path = keypoints_path(mesh_path)
    if not path.exists():
        return find_wheels(mesh)
    reading = Reading(path, error_type=MeshFileError, kind=KIND)
    with reading.naming_errors():
        data = reading.load_beside_model(FORMAT, mesh.unit)
        return VehicleKeypoints(_side(reading, data, "left"), _side(reading, data, "right"))


def _side(reading: Reading, data: dict[str, Any], key: str) -> SideKeypoints:
    names, side = ("rear_wheel", "front_wheel", "axle"), reading.object(data.get(key), key)
    points = [reading.numbers(side.get(name), f"{key}.{name}") for name in names]
    try:
        return SideKeypoints(*map(np.array, points))
    except ValueError as error:
        raise reading.error(f"{key} side: {error}", "mend the key points") from error
