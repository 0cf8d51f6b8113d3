"""The pixels near a pose: the box that it is compared in, and how finely."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.hull import hull_points
from poseviewer.geometry.mesh import Mesh

NEAR_MARGIN = 0.25
"""How far the pixels ``near`` the start reach, as a share of the diagonal of its box."""
MOST_PIXELS = 20_000
"""Of the model's convex outline at the start: finer photos are made smaller to be compared. A pose
is told to half a pixel of these, which is less than a hundredth of the model's size."""
FINEST_PIXELS = 150_000
"""The same for the photo on which a search ends: there the least loss is nearer to the truth."""

Box = tuple[float, float, float, float]


def box_near(mesh: Mesh, start: Pose) -> Box:
    """Left, top, right, bottom in px of the model at the start, with a margin around it."""
    size = np.array([start.camera.width, start.camera.height])
    seen = start.project(hull_points(mesh))
    seen = seen[np.all(np.isfinite(seen), axis=1)]
    if not len(seen):
        return 0.0, 0.0, 0.0, 0.0
    # Where the start fills the photo and more, the photo is all there is to look at.
    low, high = np.clip([seen.min(axis=0), seen.max(axis=0)], -size, 2 * size)
    margin = NEAR_MARGIN * float(np.linalg.norm(high - low))
    left, top = np.floor(low - margin)
    right, bottom = np.ceil(high + margin)
    return left, top, right, bottom


def inside(shape: tuple[int, int], box: Box) -> NDArray[np.float32]:
    """(height, width): 1 in the box, its right and lower end excluded, 0 beside it."""
    found = np.zeros(shape, np.float32)
    left, top, right, bottom = box
    rows = slice(int(max(top, 0)), int(max(bottom, 0)))
    found[rows, int(max(left, 0)) : int(max(right, 0))] = 1.0
    return found


def working_factor(mesh: Mesh, start: Pose, most: float = MOST_PIXELS) -> int:
    """How many times smaller a photo is compared: the model about the start has ``most`` pixels."""
    seen = start.project(hull_points(mesh))
    seen = seen[np.all(np.isfinite(seen), axis=1)].astype(np.float32)
    if len(seen) < 3:
        return 1
    whole = float(start.camera.width * start.camera.height)
    area = min(float(cv2.contourArea(cv2.convexHull(seen))), whole)
    return max(1, math.ceil(math.sqrt(area / most)))
