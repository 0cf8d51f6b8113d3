"""Ellipses in a photo, and the circles in space that they show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel

FEWEST_RIM_POINTS = 5
LARGEST_RIM_ERROR = 0.1
"""How far points of a rim may lie from their ellipse, as a share of its longer half axis."""
LEAST_FLATNESS = 0.02
"""Shorter over longer half axis: what is below it is a line."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse in px of the photo, pixel centres at i + 0.5."""

    cx: float
    cy: float
    a: float
    """Half axis along ``angle``, px; the longer one."""
    b: float
    """The other half axis, px."""
    angle: float
    """Radians from the u axis towards the v axis (clockwise as seen)."""

    def __post_init__(self) -> None:
        parameters = (self.cx, self.cy, self.a, self.b, self.angle)
        if not all(map(math.isfinite, parameters)) or min(self.a, self.b) <= 0.0:
            raise QuickStartError(
                f"An ellipse with half axes {self.a:g} and {self.b:g} px is none; both must be "
                "above 0 px."
            )
        if self.b > self.a:
            longer, shorter, angle = self.b, self.a, self.angle + math.pi / 2.0
            for name, value in (("a", longer), ("b", shorter), ("angle", angle)):
                object.__setattr__(self, name, value)
        if self.b < LEAST_FLATNESS * self.a:
            raise QuickStartError(
                f"An ellipse of {self.a:.0f} by {self.b:.2g} px is a wheel seen edge-on, which "
                "gives no pose; use point pairs."
            )

    def outline(self, count: int = 48) -> FloatArray:
        """(count, 2): points on it, all around."""
        t = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
        return self.from_unit(np.column_stack([np.cos(t), np.sin(t)]))

    def from_unit(self, points: ArrayLike) -> FloatArray:
        """Points (..., 2) of the unit disk, as the ellipse stretches it over the photo."""
        return np.asarray(points, dtype=float) @ self._axes().T + [self.cx, self.cy]

    def as_unit(self, points: ArrayLike) -> FloatArray:
        """Photo points (..., 2) where the ellipse is the unit circle."""
        away = np.asarray(points, dtype=float) - [self.cx, self.cy]
        return away @ np.linalg.inv(self._axes()).T

    def distances(self, points: ArrayLike) -> FloatArray:
        """(n,): about how far, in px, photo points (n, 2) lie outside of it (inside: below 0).

        Sampson's distance: the implicit function over the length of its gradient.
        """
        unit = self.as_unit(points)
        value = np.sum(unit**2, axis=1) - 1.0
        gradient = 2.0 * np.linalg.norm(unit / [self.a, self.b], axis=1)
        return value / np.maximum(gradient, 1e-9)

    def conic(self) -> FloatArray:
        """(3, 3): symmetric, ``(u, v, 1) C (u, v, 1)^T = 0`` on the ellipse, below 0 inside."""
        to_unit = np.linalg.inv(self._axes())
        h = np.eye(3)
        h[:2, :2], h[:2, 2] = to_unit, -to_unit @ [self.cx, self.cy]
        return h.T @ np.diag([1.0, 1.0, -1.0]) @ h

    def _axes(self) -> FloatArray:
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[self.a * c, -self.b * s], [self.a * s, self.b * c]])


def ellipse_through(points: ArrayLike) -> Ellipse:
    """The ellipse through or near points (n, 2) on a rim, n at least 5.

    A. Fitzgibbon, M. Pilu, R. Fisher, *Direct least square fitting of ellipses*, 1999 (OpenCV's).

    Raises:
        QuickStartError: too few points, or no ellipse is near all of them.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    if len(np.unique(points, axis=0)) < FEWEST_RIM_POINTS:
        raise QuickStartError(
            f"{len(points)} points on the rim; an ellipse needs {FEWEST_RIM_POINTS} different ones."
        )
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    unit = ((points - middle) / size).astype(np.float32)
    (x, y), (width, height), degrees = cv2.fitEllipseDirect(unit)
    place = middle + size * np.array([x, y])
    half = 0.5 * size * width, 0.5 * size * height
    ellipse = Ellipse(float(place[0]), float(place[1]), *half, math.radians(degrees))
    error = float(np.abs(ellipse.distances(points)).max())
    if not error <= LARGEST_RIM_ERROR * ellipse.a:
        raise QuickStartError(
            f"No ellipse runs near all of these {len(points)} points ({error:.0f} px off at best); "
            "click points of one rim, all around it."
        )
    return ellipse


@dataclass(frozen=True, slots=True, eq=False)
class SeenCircle:
    """A circle in space, of unknown size, that an ellipse shows."""

    normal: FloatArray
    """(3,): unit, in the camera's frame, towards the camera."""
    centre: FloatArray
    """(2,): where its centre is seen, px: not the ellipse's own, in perspective."""


def circles_of(ellipse: Ellipse, camera: Camera) -> tuple[SeenCircle, SeenCircle]:
    """Both circles that an ellipse can show.

    *Parallel*: the shorter over the longer axis is the cosine of the tilt, to either side.
    *Perspective*: the circular sections of the cone through eye and ellipse, by its eigenvectors
    (K. Kanatani and W. Liu, *3D interpretation of conics and orthogonality*, 1993).
    """
    if isinstance(camera, Parallel):
        tilt = math.sqrt(1.0 - (ellipse.b / ellipse.a) ** 2)
        shorter = np.array([-math.sin(ellipse.angle), math.cos(ellipse.angle)])
        facing, centre = -ellipse.b / ellipse.a, np.array([ellipse.cx, ellipse.cy])
        one, other = (np.array([*(sign * tilt * shorter), facing]) for sign in (1.0, -1.0))
        return SeenCircle(one, centre), SeenCircle(other, centre)
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    cone = matrix.T @ ellipse.conic() @ matrix
    values, vectors = np.linalg.eigh(cone)
    least, middle, most = values  # one below 0: the cone's own axis; two above
    across = math.sqrt(max(most - middle, 0.0) / (most - least))
    along = math.sqrt(max(middle - least, 0.0) / (most - least))
    found = []
    for sign in (1.0, -1.0):
        normal = sign * across * vectors[:, 2] + along * vectors[:, 0]
        # The pole of the section's vanishing line is the centre's line of sight.
        sight = np.linalg.solve(cone, normal)
        sight *= np.sign(sight[2])
        normal = normal * -np.sign(normal @ sight)
        found.append(SeenCircle(normal, camera.project(sight)))
    return found[0], found[1]
