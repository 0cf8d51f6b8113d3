"""Key points of a vehicle from the file beside its model."""

from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.files.checks import InputFile
from poseviewer.files.writing import write_json
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints
from poseviewer.vehicle.wheel_parts import find_wheels

FORMAT = "poseviewer-keypoints"
KIND = "key point file"
NAMES = "rear_wheel", "front_wheel", "axle"


def keypoints_path(mesh_path: str | Path) -> Path:
    """Path of a model's key points: ``car.keypoints.json`` beside ``car.glb``."""
    return Path(mesh_path).with_suffix(".keypoints.json")


def load_keypoints(mesh_path: str | Path, mesh: Mesh) -> VehicleKeypoints | None:
    """Key points from the file beside the model, else from its named wheels; None without."""
    path = keypoints_path(mesh_path)
    if not path.exists():
        return find_wheels(mesh)
    file = InputFile(path, error_type=MeshFileError, kind=KIND)
    with file.naming_errors():
        data = file.load_beside_model(FORMAT, mesh.unit)
        return VehicleKeypoints(_side(file, data, "left"), _side(file, data, "right"))


def save_keypoints(mesh_path: str | Path, keypoints: VehicleKeypoints, unit: str | None) -> None:
    """Write key points beside a model, for ``load_keypoints``.

    Raises:
        MeshFileError: the file cannot be written.
    """
    data: dict[str, Any] = {"format": FORMAT, "version": 1} | ({"unit": unit} if unit else {})
    for key in ("left", "right"):
        side = getattr(keypoints, key)
        data[key] = {name: getattr(side, name).tolist() for name in NAMES}
    write_json(keypoints_path(mesh_path), data, MeshFileError)


def is_equal(one: VehicleKeypoints, other: VehicleKeypoints) -> bool:
    """Tell whether two models have the same key points, to what files keep."""
    sides = ((one.left, other.left), (one.right, other.right))
    pairs = ((getattr(a, name), getattr(b, name)) for a, b in sides for name in NAMES)
    return all(np.allclose(a, b, rtol=1e-9, atol=0.0) for a, b in pairs)


def _side(file: InputFile, data: dict[str, Any], key: str) -> SideKeypoints:
    side = file.object(data.get(key), key)
    points = [file.flat_numbers(side.get(name), f"{key}.{name}", 3) for name in NAMES]
    return SideKeypoints(*map(np.array, points))
