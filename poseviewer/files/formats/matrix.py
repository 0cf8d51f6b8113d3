"""3x3 intrinsics and 4x4 poses, as lists of rows in JSON and as arrays; each checked on reading."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseviewer.files.pose.checks import Reading, checked_rotation, kind_of
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.transform import RigidTransform


def as_4x4(transform: RigidTransform) -> FloatArray:
    """``[[R, t], [0, 1]]`` (4, 4), for points as columns."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = transform.rotation, transform.translation
    return matrix


def from_4x4(reading: Reading, rows: Any, what: str) -> RigidTransform:
    """The rigid transform in 4 rows of 4 numbers (or 3, without the last).

    Raises:
        PoseFileError: it is something else.
    """
    if not isinstance(rows, list) or len(rows) not in (3, 4):
        raise reading.error(f"{what} is {kind_of(rows)}", "wanted 4 rows of 4 numbers")
    matrix = np.array([reading.numbers(row, f"{what}[{i}]", 4) for i, row in enumerate(rows)])
    if len(matrix) == 4 and not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), rtol=0.0, atol=1e-9):
        raise reading.error(f"the last row of {what} is {rows[3]}", "wanted 0 0 0 1 (row-major)")
    return RigidTransform(checked_rotation(reading, matrix[:3, :3]), matrix[:3, 3])


def intrinsics_matrix(camera: Perspective) -> FloatArray:
    """K (3, 3), in the camera's own pixel coordinates."""
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def camera_from_intrinsics(
    reading: Reading, matrix: FloatArray, width: int, height: int
) -> Perspective:
    """The camera of K (3, 3), in K's own pixel coordinates.

    Raises:
        PoseFileError: K has a skew or no focal length, or is no such matrix.
    """
    skew, lower = matrix[0, 1], (*matrix[1:, 0], matrix[2, 1])
    if abs(skew) > 1e-9 * abs(matrix[0, 0]) or any(lower) or matrix[2, 2] != 1.0:
        raise reading.error(
            f"K is {matrix.tolist()}", "wanted fx 0 cx, 0 fy cy, 0 0 1, without a skew"
        )
    fx = reading.number(float(matrix[0, 0]), "fx", positive=True)
    fy = reading.number(float(matrix[1, 1]), "fy", positive=True)
    return Perspective(fx, fy, float(matrix[0, 2]), float(matrix[1, 2]), width, height)
