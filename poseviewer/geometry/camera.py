"""Cameras and poses. Image coordinates here have pixel centres at i + 0.5 (see ``frames``)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.transform import RigidTransform

DEFAULT_FIELD_OF_VIEW_DEG = 50.0
"""View along the longer side, where nothing tells it: that of a 39 mm lens on film."""


@dataclass(frozen=True, slots=True)
class Perspective:
    """A pinhole camera without distortion: ``u = fx x / z + cx``, ``v = fy y / z + cy``."""

    fx: float
    """Focal length along u, px."""
    fy: float
    """Focal length along v, px."""
    cx: float
    """Principal point, px from the left edge of the picture."""
    cy: float
    """Principal point, px from the top edge of the picture."""
    width: int
    height: int

    @classmethod
    def from_field_of_view(cls, degrees: float, width: int, height: int) -> Perspective:
        """Square pixels, principal point in the middle; ``degrees`` spans the longer side."""
        focal = 0.5 * max(width, height) / math.tan(math.radians(degrees) / 2.0)
        return cls(focal, focal, width / 2.0, height / 2.0, width, height)

    @classmethod
    def from_focal_length_35mm(cls, focal_mm: float, width: int, height: int) -> Perspective:
        """Take EXIF's 35-mm-equivalent focal length, which compares the diagonals (43.27 mm)."""
        focal = focal_mm * math.hypot(width, height) / math.hypot(36.0, 24.0)
        return cls(focal, focal, width / 2.0, height / 2.0, width, height)

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points (..., 3) in the camera frame to the picture (..., 2); nan for z <= 0."""
        points = np.asarray(points, dtype=float)
        z = np.where(points[..., 2] > 0.0, points[..., 2], np.nan)
        u = self.fx * points[..., 0] / z + self.cx
        v = self.fy * points[..., 1] / z + self.cy
        return np.stack([u, v], axis=-1)

    def rays(self, pixels: ArrayLike) -> FloatArray:
        """Return directions (..., 3), z = 1, of the viewing rays of image points (..., 2)."""
        pixels = np.asarray(pixels, dtype=float)
        x = (pixels[..., 0] - self.cx) / self.fx
        y = (pixels[..., 1] - self.cy) / self.fy
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def points_at(self, pixels: ArrayLike, depths: ArrayLike) -> FloatArray:
        """Return points (..., 3) in the camera frame at depths (...) behind image points."""
        return self.rays(pixels) * np.asarray(depths)[..., None]

    def rescale(self, factor: float) -> Perspective:
        """Return the camera of the picture resized by ``factor``, see ``size_at_scale``."""
        return self.resize(*size_at_scale(self.width, self.height, factor))

    def resize(self, width: int, height: int) -> Perspective:
        """Return the camera of the picture in another size, px."""
        kx, ky = width / self.width, height / self.height
        return Perspective(self.fx * kx, self.fy * ky, self.cx * kx, self.cy * ky, width, height)

    def crop(self, left: float, top: float, size: tuple[int, int]) -> Perspective:
        """Return the camera of a piece of the picture, of a size (width, height), px."""
        return replace(self, cx=self.cx - left, cy=self.cy - top, width=size[0], height=size[1])


@dataclass(frozen=True, slots=True)
class Parallel:
    """A scaled-orthographic camera: ``u = scale x + cx``, ``v = scale y + cy``."""

    scale: float
    """px per model unit."""
    cx: float
    cy: float
    width: int
    height: int

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points (..., 3) in the camera frame to the picture (..., 2)."""
        points = np.asarray(points, dtype=float)
        return self.scale * points[..., :2] + np.array([self.cx, self.cy])

    def points_at(self, pixels: ArrayLike, depths: ArrayLike) -> FloatArray:
        """Return points (..., 3) in the camera frame at depths (...) behind image points."""
        xy = (np.asarray(pixels, dtype=float) - np.array([self.cx, self.cy])) / self.scale
        z = np.broadcast_to(depths, xy.shape[:-1])
        return np.concatenate([xy, z[..., None]], axis=-1)

    def rescale(self, factor: float) -> Parallel:
        """Return the camera of the picture resized by ``factor``; pixels stay square."""
        width, height = size_at_scale(self.width, self.height, factor)
        k = math.sqrt(width / self.width * height / self.height)
        cx, cy = self.cx * width / self.width, self.cy * height / self.height
        return Parallel(self.scale * k, cx, cy, width, height)

    def crop(self, left: float, top: float, size: tuple[int, int]) -> Parallel:
        """Return the camera of a piece of the picture, of a size (width, height), px."""
        return replace(self, cx=self.cx - left, cy=self.cy - top, width=size[0], height=size[1])


Camera = Perspective | Parallel


def principal_offset(start: Camera, camera: Camera) -> tuple[float, float]:
    """Return how far a principal point is off that at the start, of the width and height."""
    return (camera.cx - start.cx) / start.width, (camera.cy - start.cy) / start.height


def offset_principal(camera: Camera, x: float, y: float) -> Camera:
    """Return the camera with its principal point moved by shares of the width and height."""
    return replace(camera, cx=camera.cx + x * camera.width, cy=camera.cy + y * camera.height)


@dataclass(frozen=True, slots=True)
class Pose:
    """Transform of a model and the camera that shows it: all that an image's geometry needs."""

    camera: Camera
    camera_from_model: RigidTransform

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points (..., 3) of the model to the picture (..., 2)."""
        placed = np.asarray(points, dtype=float) @ self.linear.T
        return self.camera.project(placed + self.camera_from_model.translation)

    @property
    def linear(self) -> FloatArray:
        """(3, 3): linear part of the map from model to camera by which the model is drawn."""
        return self.camera_from_model.rotation

    def rescale(self, factor: float) -> Pose:
        """Return the pose in the image resized by ``factor``."""
        return replace(self, camera=self.camera.rescale(factor))


def size_at_scale(width: int, height: int, factor: float) -> tuple[int, int]:
    """Return (width, height) of a picture resized by ``factor``: rounded, at least 1."""
    return max(1, round(width * factor)), max(1, round(height * factor))


def level_pose(pose: Pose, factor: int) -> Pose:
    """Return the pose on a level of the pyramid: sizes are rounded up, coordinates exact."""
    if factor == 1:
        return pose
    camera = pose.camera
    size = level_size(camera.width, factor), level_size(camera.height, factor)
    principal = camera.cx / factor, camera.cy / factor
    if isinstance(camera, Perspective):
        reduced = Perspective(camera.fx / factor, camera.fy / factor, *principal, *size)
    else:
        reduced = Parallel(camera.scale / factor, *principal, *size)
    return replace(pose, camera=reduced)


def level_size(size: int, factor: int) -> int:
    """Count the pixels of a side that show ``size`` px, ``factor`` each, the last in part."""
    return -(-size // factor)
