"""Key points of a vehicle from the file beside its model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import MeshFileError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.keypoints import SideKeypoints, VehicleKeypoints
from poseviewer.vehicle.parts import find_wheels

FORMAT, VERSION = "poseviewer-keypoints", 1


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
    try:
        data = json.loads(path.read_bytes().decode("utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise MeshFileError(
            f"{path.name}: not JSON that can be read ({str(error)[:80]}); mend or remove it."
        ) from error
    return _as_keypoints(path.name, data, mesh)


def _as_keypoints(name: str, data: Any, mesh: Mesh) -> VehicleKeypoints:
    if not isinstance(data, dict) or data.get("format", FORMAT) != FORMAT:
        raise MeshFileError(f"{name}: not a key point file; wanted format {FORMAT!r}.")
    version = data.get("version", VERSION)
    if version is True or version != VERSION:
        raise MeshFileError(f"{name}: version is {version!r}; this poseviewer reads {VERSION}.")
    unit = data.get("unit")
    if unit is not None and mesh.unit is not None and unit != mesh.unit:
        raise MeshFileError(
            f"{name}: lengths in {unit!r}, the model's are in {mesh.unit!r}; give them in the "
            "model's unit."
        )
    return VehicleKeypoints(_side(name, data, "left"), _side(name, data, "right"))


def _side(name: str, data: dict[str, Any], key: str) -> SideKeypoints:
    side = data.get(key)
    if not isinstance(side, dict):
        raise MeshFileError(f"{name}: no side {key!r}; wanted the key points of both sides.")
    points = [_point(name, side, key, what) for what in ("rear_wheel", "front_wheel", "axle")]
    try:
        return SideKeypoints(*points)
    except ValueError as error:
        raise MeshFileError(f"{name}: {key} side: {error}; mend the key points.") from error


def _point(name: str, side: dict[str, Any], key: str, what: str) -> FloatArray:
    value = side.get(what)
    is_list = isinstance(value, list) and len(value) == 3
    if not is_list or not all(type(number) in (int, float) for number in value or []):
        raise MeshFileError(f"{name}: {key}.{what} is not 3 numbers; wanted [x, y, z].")
    point = np.array(value, dtype=float)
    if not np.isfinite(point).all():
        raise MeshFileError(f"{name}: {key}.{what} is not finite; wanted [x, y, z].")
    return point
