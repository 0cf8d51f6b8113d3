"""Which of several poses that show the same point pairs is meant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import rotation_angle
from poseviewer.starts.placing import surface_point
from poseviewer.starts.point_pairs import PairFit

HIDDEN_BEHIND = 0.02
"""A point is hidden where a surface lies before it by this share of the model's diameter."""


def likeliest(
    fits: Sequence[PairFit], points: ArrayLike, mesh: Mesh, near: Pose | None = None
) -> PairFit:
    """Of poses that show points (n, 3) about equally well, the one from which most of them can be
    seen, since the photo shows them; of equals the one turned least from ``near``, else the first.
    """
    if len(fits) == 1:
        return fits[0]
    points = np.asarray(points, dtype=float)

    def rank(fit: PairFit) -> tuple[int, float]:
        turned = 0.0
        if near is not None:
            turned = rotation_angle(
                near.camera_from_model.rotation, fit.pose.camera_from_model.rotation
            )
        return -_seen(fit.pose, points, mesh), turned

    return min(fits, key=rank)


def _seen(pose: Pose, points: FloatArray, mesh: Mesh) -> int:
    """How many of the points (n, 3) no other part of the surface hides."""
    depths = pose.camera_from_model.apply(points)[:, 2]
    count = 0
    for pixel, depth in zip(pose.project(points), depths, strict=True):
        nearest = surface_point(mesh, pose, pixel)
        if nearest is None:
            count += 1  # at the outline, just beside it
            continue
        before = depth - pose.camera_from_model.apply(nearest)[2]
        count += bool(before <= HIDDEN_BEHIND * mesh.diameter)
    return count
