"""The focal length from six or more point pairs, with the pose."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.transform import RigidTransform, rotation_about
from poseviewer.starts.point_pairs import FEWEST_FOR_FOCAL, PairFit, fit_of, poses_from_pairs

FOCALS = tuple(np.geomspace(0.25, 16.0, 13))
"""Focal lengths that are tried first, in longer sides of the photo: views of 127 to 3.6 degrees."""
LEAST_ERROR_PX = 1.0
"""Standard deviation of a pair that is taken at least: few pairs can fit by chance."""
LARGEST_DOUBT = 0.3
"""Standard deviation of the logarithm of a focal length that is still an answer: 30 per cent."""


@dataclass(frozen=True, slots=True, eq=False)
class FocalFit:
    """A pose with a camera whose focal length was found."""

    fit: PairFit
    doubt: float
    """Standard deviation of the focal length, as a share of it, as the pairs' errors make it."""


def focal_from_pairs(points: ArrayLike, pixels: ArrayLike, camera: Perspective) -> FocalFit:
    """The pose and the focal length that show points (n, 3) nearest to pixels (n, 2).

    ``camera`` gives the principal point and the ratio of ``fx`` and ``fy``.

    Raises:
        QuickStartError: too few pairs, or pairs that leave the focal length open, as those do that
            are all about as far away.
    """
    points, pixels = np.asarray(points, dtype=float), np.asarray(pixels, dtype=float)
    if len(points) < FEWEST_FOR_FOCAL:
        raise QuickStartError(
            f"{len(points)} point pairs; the focal length needs at least {FEWEST_FOR_FOCAL}: add "
            f"{FEWEST_FOR_FOCAL - len(points)}, or give the focal length."
        )
    tried = [fit for focal in FOCALS for fit in _at(points, pixels, camera, focal)]
    if not tried:
        poses_from_pairs(points, pixels, camera)  # says why there is none
    found, doubt = _refined(points, pixels, min(tried, key=lambda fit: fit.rms_px).pose)
    if not doubt <= LARGEST_DOUBT:
        raise QuickStartError(
            f"The point pairs leave the focal length open (by {min(doubt, 9.99):.0%}): add pairs "
            "nearer and farther away, or give the focal length."
        )
    return FocalFit(found, doubt)


def _at(
    points: FloatArray, pixels: FloatArray, camera: Perspective, focal: float
) -> tuple[PairFit, ...]:
    """The poses with a focal length in longer sides of the photo; none where that gives none."""
    fx = focal * max(camera.width, camera.height)
    try:
        return poses_from_pairs(points, pixels, with_focal(camera, fx))
    except QuickStartError:
        return ()


def with_focal(camera: Perspective, fx: float) -> Perspective:
    """The camera with another focal length; its pixels keep their shape."""
    return replace(camera, fx=fx, fy=camera.fy * fx / camera.fx)


def _refined(points: FloatArray, pixels: FloatArray, start: Pose) -> tuple[PairFit, float]:
    """Least squares over rotation, place and focal length at once; and the focal's deviation."""
    camera, transform = start.camera, start.camera_from_model
    assert isinstance(camera, Perspective)  # as ``focal_from_pairs`` made it
    middle = points.mean(axis=0)
    at = transform.apply(middle)

    def placed(x: FloatArray) -> Pose:
        # The depth goes along with the focal length, or the two would hold each other.
        place = at * [1.0, 1.0, math.exp(x[6])] + x[3:6] * at[2]
        rotation = rotation_about(*x[:3]) @ transform.rotation
        focal = with_focal(camera, camera.fx * math.exp(x[6]))
        return Pose(focal, RigidTransform(rotation, place - rotation @ middle))

    def residuals(x: FloatArray) -> FloatArray:
        # Behind the camera: worse than anything in front of it.
        return np.nan_to_num(placed(x).project(points) - pixels, nan=1e6).ravel()

    end = least_squares(residuals, np.zeros(7), method="lm", max_nfev=2000)
    fit = fit_of(placed(end.x), points, pixels)
    freedom = max(2 * len(points) - 7, 1)
    error = max(LEAST_ERROR_PX, math.sqrt(2.0 * end.cost / freedom))
    variances = np.linalg.pinv(end.jac.T @ end.jac, rcond=1e-14)
    return fit, error * math.sqrt(max(float(variances[6, 6]), 0.0))
