"""Edge support: the fraction of an outline along which the photo has edges."""

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.render.structure import (
    LIGHTENING,
    PHOTO_NOISE,
    SMOOTHING_PX,
    bounding_slices,
)

EDGE_PX = 1
"""Distance, in px, up to which an edge lies on the outline."""
MARGIN_PX = 16
"""Pixels about the model that are looked at: more than blur and gradient reach."""
MIN_EDGE_FRACTION = 0.5
"""Fraction of the squared gradient across the outline: an edge within 45 degrees of it."""


def outline_support(
    channels: NDArray[np.float32], weights: NDArray[np.float32], covered: NDArray[np.bool_]
) -> float:
    """Return the fraction, in [0, 1], of the outline's points at which the photo has an edge along
    the outline. Only points within the picture whose pixel counts are looked at.

    Args:
        channels: (height, width, n): the photo.
        weights: (height, width): above 0 where a pixel counts.
        covered: (height, width): pixels that show the model.
    """
    if not covered.any():
        return 0.0
    near = bounding_slices(covered, MARGIN_PX)
    channels, weights, covered = channels[near], weights[near], covered[near]
    points, normals = _outline(covered, weights)
    if not len(points):
        return 0.0
    light = np.clip(channels, 0.0, 1.0) ** np.float32(LIGHTENING)
    smooth = np.asarray(cv2.GaussianBlur(light, (0, 0), SMOOTHING_PX)).reshape(light.shape)
    tensor = np.zeros((3, *light.shape[:2]), np.float32)
    for channel in np.moveaxis(smooth, 2, 0):
        du = cv2.Sobel(channel, cv2.CV_32F, 1, 0, scale=0.125)
        dv = cv2.Sobel(channel, cv2.CV_32F, 0, 1, scale=0.125)
        tensor += np.stack([du * du, du * dv, dv * dv])
    steps = np.arange(-EDGE_PX, EDGE_PX + 1)
    u, v = (points[:, None, :] + steps[None, :, None] * normals[:, None, :]).transpose(2, 0, 1)
    at = u.astype(np.float32), v.astype(np.float32)
    xx, xy, yy = (np.asarray(cv2.remap(np.asarray(part), *at, cv2.INTER_LINEAR)) for part in tensor)
    n_u, n_v = normals[:, :1], normals[:, 1:]
    along = n_u * n_u * xx + 2.0 * n_u * n_v * xy + n_v * n_v * yy
    across = along / (xx + yy + PHOTO_NOISE**2)
    return float(np.mean(across.max(axis=1) > MIN_EDGE_FRACTION))


def _outline(
    covered: NDArray[np.bool_], weights: NDArray[np.float32]
) -> tuple[FloatArray, FloatArray]:
    """Points (k, 2) of the outline as column, row, and outward normals (k, 2)."""
    soft = np.asarray(cv2.GaussianBlur(covered.astype(np.float32), (0, 0), 1.5))
    rim = covered & (cv2.erode(covered.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    rim &= weights > 0.0
    rim[:2] = False
    rim[-2:] = False
    rim[:, :2] = False
    rim[:, -2:] = False
    rows, columns = np.nonzero(rim)
    gradient = np.stack(
        [-cv2.Sobel(soft, cv2.CV_32F, *order)[rows, columns] for order in ((1, 0), (0, 1))], axis=1
    )
    length = np.linalg.norm(gradient, axis=1)
    kept = length > 1e-3
    normals = gradient[kept] / length[kept, None]
    return np.stack([columns, rows], axis=1)[kept].astype(float), normals.astype(float)
