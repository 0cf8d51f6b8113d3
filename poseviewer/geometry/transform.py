"""Rigid transforms, named ``b_from_a``: ``x_in_b = b_from_a.apply(x_in_a)`` (as in COLMAP)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray, freeze_array


@dataclass(frozen=True, slots=True, eq=False)
class RigidTransform:
    """A rotation followed by a translation, ``x_in_b = rotation @ x_in_a + translation``."""

    rotation: FloatArray
    """(3, 3), orthonormal, determinant +1."""
    translation: FloatArray
    """(3,), in the unit of the points."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", freeze_array(self.rotation, (3, 3)))
        object.__setattr__(self, "translation", freeze_array(self.translation, (3,)))

    @classmethod
    def identity(cls) -> RigidTransform:
        """Make the transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_matrix(cls, matrix: FloatArray) -> RigidTransform:
        """Take the rotation nearest to that of a matrix (4, 4) or (3, 4), and its last column."""
        return cls(nearest_rotation(matrix[:3, :3]), matrix[:3, 3])

    @classmethod
    def from_rotation_vector(cls, vector: ArrayLike, translation: ArrayLike) -> RigidTransform:
        """Take an axis times an angle in radians (3,) and a translation (3,)."""
        rotation = Rotation.from_rotvec(np.array(vector, dtype=float)).as_matrix()
        return cls(rotation, np.asarray(translation, dtype=float))

    def as_matrix(self) -> FloatArray:
        """Return (4, 4): ``x_in_b = matrix @ x_in_a`` for homogeneous points as columns."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation
        return matrix

    def as_quaternion(self) -> FloatArray:
        """Return the rotation as a unit quaternion (w, x, y, z) with w >= 0."""
        return Rotation.from_matrix(self.rotation).as_quat(canonical=True, scalar_first=True)

    def as_rotation_vector(self) -> FloatArray:
        """Return the rotation as axis times angle in radians (3,), angle in [0, pi]."""
        return Rotation.from_matrix(self.rotation).as_rotvec()

    def apply(self, points: ArrayLike) -> FloatArray:
        """Transform points (..., 3) of frame a to frame b."""
        return np.asarray(points, dtype=float) @ self.rotation.T + self.translation

    def inverse(self) -> RigidTransform:
        """Return ``a_from_b``."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        """``c_from_b @ b_from_a`` is ``c_from_a``."""
        return RigidTransform(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """A scaling followed by a rigid transform, ``x_in_b = rigid.apply(scale * x_in_a)``."""

    rigid: RigidTransform
    """Rigid part, in the unit of frame b."""
    scale: float = 1.0
    """Lengths of frame b's unit in one of frame a's."""

    def as_matrix(self) -> FloatArray:
        """Return (4, 4): ``x_in_b = matrix @ x_in_a`` for homogeneous points as columns."""
        matrix = self.rigid.as_matrix()
        matrix[:3, :3] *= self.scale
        return matrix

    def apply(self, points: ArrayLike) -> FloatArray:
        """Transform points (..., 3) of frame a to frame b."""
        return self.rigid.apply(self.scale * np.asarray(points, dtype=float))


def rotation_about(x: float, y: float, z: float) -> FloatArray:
    """Return the rotation (3, 3) by axis times angle v, rad: ``1 + a [v]x + b [v]x^2`` (Rodrigues).

    It is ten times quicker than SciPy's.
    """
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    # a = sin(t) / t and b = (1 - cos(t)) / t^2; below 1e-4, where these divide by little, series.
    a = math.sin(angle) / angle if angle > 1e-4 else 1.0 - angle * angle / 6.0
    b = 0.5 * (math.sin(half) / half) ** 2 if angle > 1e-4 else 0.5 - angle * angle / 24.0
    bx, by = b * x, b * y
    return np.array(
        [
            [1.0 - by * y - b * z * z, bx * y - a * z, bx * z + a * y],
            [bx * y + a * z, 1.0 - bx * x - b * z * z, by * z - a * x],
            [bx * z - a * y, by * z + a * x, 1.0 - bx * x - by * y],
        ]
    )


def rotation_angle(a: FloatArray, b: FloatArray) -> float:
    """Return the angle in [0, pi] of the rotation that takes ``a`` (3, 3) to ``b`` (3, 3)."""
    return float(Rotation.from_matrix(b @ a.T).magnitude())


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) nearest to ``matrix`` in the Frobenius norm (Procrustes)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
