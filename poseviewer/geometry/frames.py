"""Every axis flip and half-pixel shift of the program.

Camera frames are OpenCV's: x right, y down, z forward. Image coordinates:

- *inside*: pixel centres at ``i + 0.5``; the picture spans ``[0, width] x [0, height]``;
- *files and users* (OpenCV): pixel centres at integers; the picture starts at ``-0.5``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera
from poseviewer.geometry.transform import RigidTransform

HALF_PIXEL = 0.5

OPENGL_FROM_OPENCV = RigidTransform(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
"""OpenGL cameras look along -z with y up; it is its own inverse."""


def camera_from_integer_centres(camera: Camera) -> Camera:
    """A camera whose cx, cy count from pixel centres (OpenCV, files), as used inside."""
    return replace(camera, cx=camera.cx + HALF_PIXEL, cy=camera.cy + HALF_PIXEL)


def camera_as_integer_centres(camera: Camera) -> Camera:
    """A camera as used inside, with cx, cy counted from pixel centres (OpenCV, files)."""
    return replace(camera, cx=camera.cx - HALF_PIXEL, cy=camera.cy - HALF_PIXEL)


def points_from_integer_centres(points: ArrayLike) -> FloatArray:
    """Photo points (..., 2) counted from pixel centres (OpenCV, files), as used inside."""
    return np.asarray(points, dtype=float) + HALF_PIXEL
