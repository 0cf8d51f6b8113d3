"""Poses under parallel (scaled-orthographic) projection, by least squares.

Minimises ``sum |s R_2 x_i + t - u_i|^2`` over scale, rotation (R_2: its first two rows) and
translation. Points in a plane have two answers, mirror images in depth, from which other points
are solved by iteration (Oberkampf, DeMenthon, Davis, *Iterative pose estimation using coplanar
feature points*, 1996).
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.transform import RigidTransform, nearest_rotation, rotation_about

FLAT = 1e-6
"""Share of the largest extent below which points have no depth of their own."""
DEPTH_PER_SIZE = 4.0
"""Depth given to the points' mean, in their size: no photo can tell it."""

ScaledRotation = tuple[float, FloatArray]
"""Scale in px per model unit, and rotation (3, 3)."""


def solve_scaled_orthographic(
    points: FloatArray, pixels: FloatArray, camera: Parallel
) -> list[Pose]:
    """Return the poses that show points (n, 3), not on a line, nearest to pixels (n, 2)."""
    mean, mean_pixel = points.mean(axis=0), pixels.mean(axis=0)
    about, shown = points - mean, pixels - mean_pixel
    _, extents, axes = np.linalg.svd(about, full_matrices=True)
    is_flat = len(extents) < 3 or extents[2] <= FLAT * extents[0]
    starts = _solve_plane(about, shown, axes)
    if not is_flat:
        starts.append(_solve_solid(about, shown))
    size = float(np.abs(about).max())
    poses = []
    for scale, rotation in starts:
        if not scale > 0.0:
            continue
        if not is_flat:
            scale, rotation = _refine_rotation(about, shown, scale, rotation)
        at = [*((mean_pixel - [camera.cx, camera.cy]) / scale), DEPTH_PER_SIZE * size]
        transform = RigidTransform(rotation, np.array(at) - rotation @ mean)
        poses.append(Pose(replace(camera, scale=scale), transform))
    return poses


def _solve_plane(about: FloatArray, shown: FloatArray, axes: FloatArray) -> list[ScaledRotation]:
    """Return both solutions for the points as if they lay in the plane of their first two axes."""
    # With the plane's axes E (2, 3) the photo gives B = s R_2 E^T (2, 2). B lacks a column c, for
    # the normal, by which the rows of (B, c) are perpendicular and of length s: c c^T = s^2 1 - B
    # B^T has rank one, so that s^2 is the larger eigenvalue of B B^T. The sign of c is open.
    plane = axes[:2]
    b = np.linalg.lstsq(about @ plane.T, shown, rcond=None)[0].T
    values, vectors = np.linalg.eigh(b @ b.T)
    scale = float(np.sqrt(values[1]))
    column = np.sqrt(max(values[1] - values[0], 0.0)) * vectors[:, 0]
    normal = np.cross(plane[0], plane[1])
    frame = np.vstack([plane, normal])
    rows = [np.column_stack([b, sign * column]) @ frame for sign in (1.0, -1.0)]
    return [(scale, _complete_rotation(row)) for row in rows]


def _solve_solid(about: FloatArray, shown: FloatArray) -> ScaledRotation:
    """Return the scale and rotation nearest to the affine map of the points."""
    affine = np.asarray(np.linalg.lstsq(about, shown, rcond=None)[0].T, dtype=np.float64)
    return float(np.linalg.svd(affine, compute_uv=False).mean()), _complete_rotation(affine)


def _complete_rotation(rows: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) whose first two rows are nearest to scaled ``rows`` (2, 3)."""
    u, _, vt = np.linalg.svd(rows, full_matrices=False)
    first, second = np.asarray(u @ vt, float)
    return nearest_rotation(np.stack([first, second, np.cross(first, second)]))


def _refine_rotation(
    about: FloatArray, shown: FloatArray, scale: float, rotation: FloatArray
) -> ScaledRotation:
    """Improve scale and rotation by Levenberg-Marquardt; the means keep the translation at 0."""

    def rotation_at(x: FloatArray) -> ScaledRotation:
        return float(scale * np.exp(x[3])), rotation_about(*x[:3]) @ rotation

    def residuals(x: FloatArray) -> FloatArray:
        s, r = rotation_at(x)
        return (s * about @ r[:2].T - shown).ravel()

    return rotation_at(least_squares(residuals, np.zeros(4), method="lm").x)
