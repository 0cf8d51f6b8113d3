"""A pose from point pairs: points of the model, and where each of them is seen in the photo.

*Perspective*: OpenCV's SQPnP (G. Terzakis and M. Lourakis, *A consistently fast and globally
optimal solution to the perspective-n-point problem*, 2020), then Levenberg-Marquardt. With
four or five pairs SQPnP now and then ends in a wrong valley: there, AP3P's answers for every three
of them (T. Ke and S. Roumeliotis, 2017) start the latter, too.
*Parallel*: ``scaled_orthographic``. Points in a plane, and few points, can have two answers: all
are given, the best first.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.scaled_orthographic import scaled_orthographic_poses
from poseviewer.geometry.transform import RigidTransform

FEWEST_PERSPECTIVE, FEWEST_PARALLEL, FEWEST_FOR_FOCAL = 4, 3, 6
LEAST_SPREAD = 0.01
"""Points whose second extent is below this share of the first one lie on a line."""
PLANE_SPREAD = 0.001
"""And in a plane, whose two poses are asked for apart, where this holds of the third."""
MANY = 6
"""From so many pairs on, SQPnP's answer alone is refined."""
AS_GOOD, AS_GOOD_PX = 1.5, 1.0
"""An answer is as good as the best one up to this factor, or so many px, of its error."""


@dataclass(frozen=True, slots=True, eq=False)
class PairFit:
    """A pose, and how well it shows the pairs."""

    pose: Pose
    errors_px: FloatArray
    """(n,): distance of each pair's photo point from where the pose shows its model point."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "errors_px", frozen_array(self.errors_px, (-1,)))

    @property
    def rms_px(self) -> float:
        """Root of the mean squared error."""
        return float(np.sqrt(np.mean(self.errors_px**2)))


def fewest_pairs(camera: Camera) -> int:
    """How many pairs a pose needs."""
    return FEWEST_PARALLEL if isinstance(camera, Parallel) else FEWEST_PERSPECTIVE


def poses_from_pairs(points: ArrayLike, pixels: ArrayLike, camera: Camera) -> tuple[PairFit, ...]:
    """The poses that show model points (n, 3) nearest to photo points (n, 2), the best first.

    Of a parallel ``camera`` the centre counts, and the scale is found.

    Raises:
        QuickStartError: too few pairs, all on a line, or no pose in front of the camera.
    """
    points, pixels = _checked(points, pixels, fewest_pairs(camera))
    if isinstance(camera, Parallel):
        found = scaled_orthographic_poses(points, pixels, camera)
    else:
        found = _perspective_poses(points, pixels, camera)
    fits = sorted((fit_of(pose, points, pixels) for pose in found), key=lambda fit: fit.rms_px)
    fits = [fit for fit in fits if np.isfinite(fit.rms_px)]
    if not fits:
        raise QuickStartError(
            "No pose in front of the camera shows these point pairs; check which point of the "
            "photo belongs to which of the model."
        )
    worst = max(AS_GOOD * fits[0].rms_px, fits[0].rms_px + AS_GOOD_PX)
    return _distinct([fit for fit in fits if fit.rms_px <= worst])


def fit_of(pose: Pose, points: ArrayLike, pixels: ArrayLike) -> PairFit:
    """How well a pose shows model points (n, 3) at photo points (n, 2)."""
    return PairFit(pose, np.linalg.norm(pose.project(points) - np.asarray(pixels), axis=1))


def _checked(points: ArrayLike, pixels: ArrayLike, fewest: int) -> tuple[FloatArray, FloatArray]:
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise QuickStartError(
            "A point pair has a coordinate that is not finite; mend or remove it."
        )
    count = len(np.unique(points, axis=0))
    if count < fewest:
        raise QuickStartError(
            f"{count} point pair{'' if count == 1 else 's'} (of different model points); a pose "
            f"needs at least {fewest}: add {fewest - count}."
        )
    for places, where in ((points, "model"), (pixels, "photo")):
        extents = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        if extents[1] <= LEAST_SPREAD * extents[0]:
            raise QuickStartError(
                f"The {len(places)} point pairs lie on a line in the {where}, about which the "
                "model could turn; add one beside the line."
            )
    return points, pixels


def _perspective_poses(points: FloatArray, pixels: FloatArray, camera: Perspective) -> list[Pose]:
    """Answers of SQPnP, and for points in a plane of IPPE too, each refined."""
    # OpenCV works in the unit of the points: about 1 is where its thresholds fit.
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    unit = (points - middle) / size
    seen = pixels - 0.5
    integer = camera_as_integer_centres(camera)
    assert isinstance(integer, Perspective)
    matrix = np.array([[integer.fx, 0, integer.cx], [0, integer.fy, integer.cy], [0, 0, 1.0]])
    poses = []
    for rotation, place in _answers(unit, seen, matrix):
        turn = RigidTransform.from_rotation_vector(rotation, place * size)
        place = turn.apply(-middle)
        poses.append(Pose(camera, RigidTransform(turn.rotation, place)))
    return poses


def _answers(
    points: FloatArray, pixels: FloatArray, matrix: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """(rotation vector, translation) of each answer, after Levenberg-Marquardt over all pairs."""
    extents = np.linalg.svd(points, compute_uv=False)
    ways = [cv2.SOLVEPNP_SQPNP]
    if extents[2] <= PLANE_SPREAD * extents[0]:
        ways.append(cv2.SOLVEPNP_IPPE)
    starts: list[tuple[Any, Any]] = []
    for way in ways:
        # A way that finds no answer raises: IPPE wants an exact plane.
        with suppress(cv2.error):
            found = cv2.solvePnPGeneric(points, pixels, matrix, None, flags=way)
            starts += zip(found[1], found[2], strict=True)
    if len(points) < MANY:
        for three in map(list, combinations(range(len(points)), 3)):
            with suppress(cv2.error):
                found = cv2.solveP3P(
                    points[three], pixels[three], matrix, None, flags=cv2.SOLVEPNP_AP3P
                )
                starts += zip(found[1], found[2], strict=True)
    refined = [cv2.solvePnPRefineLM(points, pixels, matrix, None, *start) for start in starts]
    answers = [frozen_array(np.concatenate([turn, at])[:, 0], (6,)) for turn, at in refined]
    return [(answer[:3], answer[3:]) for answer in answers if np.isfinite(answer).all()]


def _distinct(fits: list[PairFit]) -> tuple[PairFit, ...]:
    """Without those that another, better one equals but for rounding."""
    kept: list[PairFit] = []
    for fit in fits:
        turn = fit.pose.camera_from_model.rotation
        if all(np.abs(turn - k.pose.camera_from_model.rotation).max() > 1e-3 for k in kept):
            kept.append(fit)
    return tuple(kept)
