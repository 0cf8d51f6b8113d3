"""Poses under parallel (scaled-orthographic) projection, by least squares.

Minimises ``sum |s R_2 x_i + t - u_i|^2`` over scale, rotation (R_2: its first two rows) and shift.
Points in a plane have two answers, mirror images in depth, which start the iteration for others.
Oberkampf, DeMenthon, Davis, *Iterative pose estimation using coplanar feature points*, 1996.
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
"""Depth given to the points' middle, in their size: no photo can tell it."""

Turned = tuple[float, FloatArray]
"""Scale in px per model unit, and rotation (3, 3)."""


def solve_scaled_orthographic(
    points: FloatArray, pixels: FloatArray, camera: Parallel
) -> list[Pose]:
    """The poses that show points (n, 3), not on a line, nearest to pixels (n, 2)."""
    middle, centre = points.mean(axis=0), pixels.mean(axis=0)
    about, shown = points - middle, pixels - centre
    _, extents, axes = np.linalg.svd(about, full_matrices=True)
    flat = len(extents) < 3 or extents[2] <= FLAT * extents[0]
    starts = _of_a_plane(about, shown, axes)
    if not flat:
        starts.append(_of_a_solid(about, shown))
    size = float(np.abs(about).max())
    poses = []
    for scale, rotation in starts:
        if not scale > 0.0:
            continue
        if not flat:
            scale, rotation = _refined(about, shown, scale, rotation)
        place = [*((centre - [camera.cx, camera.cy]) / scale), DEPTH_PER_SIZE * size]
        transform = RigidTransform(rotation, np.array(place) - rotation @ middle)
        poses.append(Pose(replace(camera, scale=scale), transform))
    return poses


def _of_a_plane(about: FloatArray, shown: FloatArray, axes: FloatArray) -> list[Turned]:
    """Both (scale, rotation) for the points as if they lay in the plane of their first two axes.

    With the plane's axes E (2, 3) the photo gives B = s R_2 E^T (2, 2). The column c that B lacks,
    for the normal, must make the rows of (B, c) perpendicular and of length s: c c^T = s^2 1 - B
    B^T has rank one, so that s^2 is the larger eigenvalue of B B^T. The sign of c is open.
    """
    plane = axes[:2]
    b = np.linalg.lstsq(about @ plane.T, shown, rcond=None)[0].T
    values, vectors = np.linalg.eigh(b @ b.T)
    scale = float(np.sqrt(values[1]))
    column = np.sqrt(max(values[1] - values[0], 0.0)) * vectors[:, 0]
    normal = np.cross(plane[0], plane[1])
    frame = np.vstack([plane, normal])
    rows = [np.column_stack([b, sign * column]) @ frame for sign in (1.0, -1.0)]
    return [(scale, _completed(row)) for row in rows]


def _of_a_solid(about: FloatArray, shown: FloatArray) -> Turned:
    """(scale, rotation) nearest to the affine map of the points."""
    affine = np.asarray(np.linalg.lstsq(about, shown, rcond=None)[0].T, dtype=np.float64)
    return float(np.linalg.svd(affine, compute_uv=False).mean()), _completed(affine)


def _completed(rows: FloatArray) -> FloatArray:
    """The rotation (3, 3) whose first two rows are nearest to ``rows`` (2, 3) but for scale."""
    u, _, vt = np.linalg.svd(rows, full_matrices=False)
    first, second = np.asarray(u @ vt, float)
    return nearest_rotation(np.stack([first, second, np.cross(first, second)]))


def _refined(about: FloatArray, shown: FloatArray, scale: float, rotation: FloatArray) -> Turned:
    """Levenberg-Marquardt over scale and rotation; the shift stays, both middles being 0."""

    def placed(x: FloatArray) -> Turned:
        return float(scale * np.exp(x[3])), rotation_about(*x[:3]) @ rotation

    def residuals(x: FloatArray) -> FloatArray:
        s, turn = placed(x)
        return (s * about @ turn[:2].T - shown).ravel()

    return placed(least_squares(residuals, np.zeros(4), method="lm").x)
