"""Poses from point pairs: points of the model, and where each of them is seen in the photo.

*Perspective*: OpenCV's SQPnP (Terzakis and Lourakis, 2020), then Levenberg-Marquardt; few pairs,
for which SQPnP may be wrong, are also solved by AP3P for every three (Ke and Roumeliotis, 2017).
*Parallel*: ``scaled_orthographic``. Where two answers are as good, both are given.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations
from operator import attrgetter
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from poseviewer.errors import QuickStartError, percent
from poseviewer.files.marks import PointPairs
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import HALF_PIXEL
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.placing import surface_point
from poseviewer.geometry.rectangle import non_maximum_suppression
from poseviewer.geometry.scaled_orthographic import solve_scaled_orthographic
from poseviewer.geometry.transform import RigidTransform, rotation_about, rotation_angle
from poseviewer.starts.start import Start, StartCamera, StartInputs

MIN_PAIRS_PERSPECTIVE = 4
"""Pairs that a pose needs: three leave up to four answers."""
MIN_PAIRS_PARALLEL = 3
"""Pairs that a pose under parallel projection needs."""
MIN_PAIRS_FOR_FOCAL = 6
"""Pairs that tell the focal length, too."""
MIN_SPREAD = 0.01
"""Second extent of points over the first, below which they lie on a line."""
PLANE_SPREAD = 0.001
"""Third extent of points over the first, below which they lie in a plane, with two poses."""
MANY_PAIRS = 6
"""Pairs from which on SQPnP's answer alone is refined."""
SAME_ROTATION = 1e-3
"""Largest difference between entries of rotations that are equal but for rounding."""
AS_GOOD = 1.5
"""Factor of the best answer's error within which another is as good."""
AS_GOOD_PX = 1.0
"""px beyond the best answer's error within which another is as good."""
FOCALS = tuple(np.geomspace(0.25, 16.0, 13))
"""Focal lengths that are tried first, in longer sides of the photo: views of 127 to 3.6 degrees."""
MIN_ERROR_PX = 1.0
"""Smallest standard deviation of a pair that is assumed: few pairs can fit by chance."""
MAX_FOCAL_DEVIATION = 0.3
"""Standard deviation of the logarithm of a focal length that is still an answer: 30 per cent."""
HIDDEN_BEHIND = 0.02
"""Least distance, by the model's diameter, from a point to a surface that occludes it."""


def start_from_pairs(inputs: StartInputs, pairs: PointPairs, known: StartCamera) -> Start:
    """Return the start by point pairs, of mirror images the one that shows the points."""
    camera, notes = known.of(inputs.photo), list[str]()
    points, pixels = pairs.points, pairs.pixels
    fits: tuple[PairFit, ...] = ()
    is_open = not known.knows_focal(inputs.photo) and len(points) >= MIN_PAIRS_FOR_FOCAL
    if isinstance(camera, Perspective) and (known.free_focal or is_open):
        with suppress(*(() if known.free_focal else (QuickStartError,))):
            fit, deviation = focal_from_pairs(points, pixels, camera)
            camera, fits = fit.pose.camera, (fit,)
            assert isinstance(camera, Perspective)
            notes.append(
                f"focal length from the pairs: {camera.fx:.0f} px, to {percent(deviation)}."
            )
    fit = likeliest(fits or poses_from_pairs(points, pixels, camera), points, inputs.mesh)
    errors = ", ".join(f"{error:.1f}" for error in fit.errors_px)
    notes.append(f"start from {len(points)} point pairs, off by {errors} px.")
    return Start(fit.pose, tuple(notes))


class PairFit(NamedTuple):
    """A pose, and how well it shows the pairs."""

    pose: Pose
    errors_px: FloatArray
    """(n,): distance of each photo point from where the pose shows its model point."""

    @property
    def rms_px(self) -> float:
        """Root mean squared error."""
        return float(np.sqrt(np.mean(self.errors_px**2)))


def fewest_pairs(camera: Camera) -> int:
    """Return the number of pairs that a pose needs."""
    return MIN_PAIRS_PARALLEL if isinstance(camera, Parallel) else MIN_PAIRS_PERSPECTIVE


def poses_from_pairs(points: ArrayLike, pixels: ArrayLike, camera: Camera) -> tuple[PairFit, ...]:
    """Find the poses, and scales if parallel, that show model points (n, 3) at photo points (n, 2).

    The best come first.

    Raises:
        QuickStartError: there are too few pairs, all on a line, or no pose before the camera.
    """
    points, pixels = _check(points, pixels, fewest_pairs(camera))
    if isinstance(camera, Parallel):
        poses = solve_scaled_orthographic(points, pixels, camera)
    else:
        poses = _perspective_poses(points, pixels, camera)
    fits = sorted((fit_of(pose, points, pixels) for pose in poses), key=lambda fit: fit.rms_px)
    fits = [fit for fit in fits if np.isfinite(fit.rms_px)]
    if not fits:
        raise QuickStartError(
            "No pose in front of the camera shows these point pairs; check which point of the "
            "photo belongs to which of the model."
        )
    worst = max(AS_GOOD * fits[0].rms_px, fits[0].rms_px + AS_GOOD_PX)
    good = (fit for fit in fits if fit.rms_px <= worst)
    rotation = attrgetter("pose.camera_from_model.rotation")
    return tuple(
        non_maximum_suppression(
            good, lambda a, b: np.abs(rotation(a) - rotation(b)).max() <= SAME_ROTATION
        )
    )


def fit_of(pose: Pose, points: ArrayLike, pixels: ArrayLike) -> PairFit:
    """Compute the errors of a pose that shows model points (n, 3) at photo points (n, 2)."""
    return PairFit(pose, np.linalg.norm(pose.project(points) - np.asarray(pixels), axis=1))


def _check(points: ArrayLike, pixels: ArrayLike, min_pairs: int) -> tuple[FloatArray, FloatArray]:
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    if not (np.isfinite(points).all() and np.isfinite(pixels).all()):
        raise QuickStartError(
            "A point pair has a coordinate that is not finite; mend or remove it."
        )
    count = len(np.unique(points, axis=0))
    if count < min_pairs:
        raise QuickStartError(
            f"{count} point pair{'' if count == 1 else 's'} (of different model points); a pose "
            f"needs at least {min_pairs}: add {min_pairs - count}."
        )
    for array, where in ((points, "model"), (pixels, "photo")):
        extents = np.linalg.svd(array - array.mean(axis=0), compute_uv=False)
        if extents[1] <= MIN_SPREAD * extents[0]:
            raise QuickStartError(
                f"The {len(array)} point pairs lie on a line in the {where}, about which the "
                "model could turn; add one beside the line."
            )
    return points, pixels


def _perspective_poses(points: FloatArray, pixels: FloatArray, camera: Perspective) -> list[Pose]:
    """Refine the answers of SQPnP, of IPPE for points in a plane, and of AP3P for few pairs."""
    # OpenCV works in the unit of the points: about 1 is where its thresholds fit.
    mean, matrix = points.mean(axis=0), opencv_matrix(camera)
    size = float(np.abs(points - mean).max())
    unit, pixels = (points - mean) / size, pixels - HALF_PIXEL
    extents = np.linalg.svd(unit, compute_uv=False)
    is_plane = extents[2] <= PLANE_SPREAD * extents[0]
    starts: list[tuple[Any, Any]] = []
    for solver in (cv2.SOLVEPNP_SQPNP, *((cv2.SOLVEPNP_IPPE,) if is_plane else ())):
        # A solver that finds no answer raises: IPPE wants an exact plane.
        with suppress(cv2.error):
            _, vectors, shifts, *_ = cv2.solvePnPGeneric(unit, pixels, matrix, None, flags=solver)
            starts += zip(vectors, shifts, strict=True)
    for three in map(list, combinations(range(len(unit)), 3)) if len(unit) < MANY_PAIRS else ():
        with suppress(cv2.error):
            given = unit[three], pixels[three], matrix, None
            _, vectors, shifts = cv2.solveP3P(*given, flags=cv2.SOLVEPNP_AP3P)
            starts += zip(vectors, shifts, strict=True)
    poses = []
    for start in starts:
        vector, shift = map(np.ravel, cv2.solvePnPRefineLM(unit, pixels, matrix, None, *start))
        if np.isfinite([vector, shift]).all():
            about = RigidTransform.from_rotation_vector(vector, shift * size)
            poses.append(Pose(camera, RigidTransform(about.rotation, about.apply(-mean))))
    return poses


def focal_from_pairs(
    points: ArrayLike, pixels: ArrayLike, camera: Perspective
) -> tuple[PairFit, float]:
    """Find the pose and focal length that show points (n, 3) nearest to pixels (n, 2).

    Returns:
        The pose with that camera, and the focal length's standard deviation as a share of it.

    Raises:
        QuickStartError: the pairs leave the focal length open.
    """
    points, pixels = np.asarray(points, dtype=float), np.asarray(pixels, dtype=float)
    if len(points) < MIN_PAIRS_FOR_FOCAL:
        raise QuickStartError(
            f"{len(points)} point pairs; the focal length needs at least {MIN_PAIRS_FOR_FOCAL}: "
            f"add {MIN_PAIRS_FOR_FOCAL - len(points)}, or give the focal length."
        )
    tried: list[PairFit] = []
    for focal in FOCALS:
        known = with_focal(camera, focal * max(camera.width, camera.height))
        with suppress(QuickStartError):
            tried += poses_from_pairs(points, pixels, known)
    if not tried:
        poses_from_pairs(points, pixels, camera)  # says why there is none
    fit, deviation = _refine_with_focal(points, pixels, min(tried, key=lambda fit: fit.rms_px).pose)
    if not deviation <= MAX_FOCAL_DEVIATION:
        least = percent(min(deviation, 9.99))
        raise QuickStartError(
            f"The point pairs leave the focal length open (by {least}): add "
            "pairs nearer and farther away, or give the focal length."
        )
    return fit, deviation


def with_focal(camera: Perspective, fx: float) -> Perspective:
    """Return the camera with another focal length; its pixels keep their shape."""
    return replace(camera, fx=fx, fy=camera.fy * fx / camera.fx)


def _refine_with_focal(
    points: FloatArray, pixels: FloatArray, start: Pose
) -> tuple[PairFit, float]:
    """Fit rotation, translation and focal length at once; returns the focal's deviation, too."""
    camera, transform = start.camera, start.camera_from_model
    assert isinstance(camera, Perspective)  # as ``focal_from_pairs`` made it
    mean = points.mean(axis=0)
    at = transform.apply(mean)

    def pose_of(x: FloatArray) -> Pose:
        # The depth goes along with the focal length, or the two would hold each other.
        moved_mean = at * [1.0, 1.0, math.exp(x[6])] + x[3:6] * at[2]
        rotation = rotation_about(*x[:3]) @ transform.rotation
        focal = with_focal(camera, camera.fx * math.exp(x[6]))
        return Pose(focal, RigidTransform(rotation, moved_mean - rotation @ mean))

    def residuals(x: FloatArray) -> FloatArray:
        # Behind the camera: worse than anything in front of it.
        return np.nan_to_num(pose_of(x).project(points) - pixels, nan=1e6).ravel()

    end = least_squares(residuals, np.zeros(7), method="lm", max_nfev=2000)
    fit = fit_of(pose_of(end.x), points, pixels)
    freedom = max(2 * len(points) - 7, 1)
    error = max(MIN_ERROR_PX, math.sqrt(2.0 * end.cost / freedom))
    variances = np.linalg.pinv(end.jac.T @ end.jac, rcond=1e-14)
    return fit, error * math.sqrt(max(float(variances[6, 6]), 0.0))


def likeliest(
    fits: Sequence[PairFit], points: ArrayLike, mesh: Mesh, near: Pose | None = None
) -> PairFit:
    """Return the pose that shows most points, of equals the one least rotated.

    Args:
        fits: poses to choose from, at least one.
        points: (n, 3), of the model.
        mesh: the model.
        near: the pose from which rotations count; None: none does.
    """
    if len(fits) == 1:
        return fits[0]
    points = np.asarray(points, dtype=float)

    def rank(fit: PairFit) -> tuple[int, float]:
        angle = 0.0
        if near is not None:
            angle = rotation_angle(
                near.camera_from_model.rotation, fit.pose.camera_from_model.rotation
            )
        return -_count_visible(fit.pose, points, mesh), angle

    return min(fits, key=rank)


def _count_visible(pose: Pose, points: FloatArray, mesh: Mesh) -> int:
    """Count the points (n, 3) that no other part of the surface hides."""
    depths = pose.camera_from_model.apply(points)[:, 2]
    count, reach = 0, HIDDEN_BEHIND * mesh.diameter
    for pixel, depth in zip(pose.project(points), depths, strict=True):
        nearest = surface_point(mesh, pose, pixel)
        # None: the pixel is just beside the outline.
        is_visible = nearest is None or depth - pose.camera_from_model.apply(nearest)[2] <= reach
        count += bool(is_visible)
    return count
