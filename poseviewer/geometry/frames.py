"""Every axis flip and half-pixel shift of the program.

Camera frames are OpenCV's: x right, y down, z forward. Image coordinates:

- *inside*: pixel centres at ``i + 0.5``; the picture spans ``[0, width] x [0, height]``;
- *files and users* (OpenCV): pixel centres at integers; the picture starts at ``-0.5``.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.transform import RigidTransform

HALF_PIXEL = 0.5
"""px between the two conventions."""
AnyCamera = TypeVar("AnyCamera", Perspective, Parallel, Perspective | Parallel)

OPENGL_FROM_OPENCV = RigidTransform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""OpenGL cameras look along -z with y up; the transform is its own inverse."""


def camera_from_integer_centres(camera: AnyCamera) -> AnyCamera:
    """Convert a camera whose cx, cy count from pixel centres (OpenCV, files) to the inside's."""
    return replace(camera, cx=camera.cx + HALF_PIXEL, cy=camera.cy + HALF_PIXEL)


def camera_as_integer_centres(camera: AnyCamera) -> AnyCamera:
    """Convert a camera of the inside to cx, cy that count from pixel centres (OpenCV, files)."""
    return replace(camera, cx=camera.cx - HALF_PIXEL, cy=camera.cy - HALF_PIXEL)


def camera_with_rows_from_below(camera: Perspective) -> Perspective:
    """Count cy from the lower edge, as MeshLab does, or back from there."""
    return replace(camera, cy=camera.height - camera.cy)


def points_from_integer_centres(points: ArrayLike) -> FloatArray:
    """Convert image points (..., 2) that count from pixel centres (OpenCV, files)."""
    return np.asarray(points, dtype=float) + HALF_PIXEL
