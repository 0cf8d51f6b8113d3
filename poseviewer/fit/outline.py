"""The share of an outline along which the photo has edges."""

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.render.structure import LIGHTENING, PHOTO_NOISE, SMOOTHING_PX

EDGE_PX = 1
"""An edge so near to the outline lies on it."""
EDGE_SHARE = 0.5
"""Share of the photo's gradient across the outline from which a point of it has an edge."""


def outline_support(
    channels: NDArray[np.float32], weights: NDArray[np.float32], covered: NDArray[np.bool_]
) -> float:
    """The share, in [0, 1], of points of a model's outline with an edge of its direction in the
    photo: those within the picture whose pixel counts (``weights`` > 0).

    ``channels``: (height, width, n); ``covered``: where the model is seen.
    """
    places, normals = _outline(covered, weights)
    if not len(places):
        return 0.0
    light = np.clip(channels, 0.0, 1.0) ** np.float32(LIGHTENING)
    smooth = np.asarray(cv2.GaussianBlur(light, (0, 0), SMOOTHING_PX)).reshape(light.shape)
    tensor = np.zeros((3, *light.shape[:2]), np.float32)
    for channel in np.moveaxis(smooth, 2, 0):
        du = cv2.Sobel(channel, cv2.CV_32F, 1, 0, scale=0.125)
        dv = cv2.Sobel(channel, cv2.CV_32F, 0, 1, scale=0.125)
        tensor += np.stack([du * du, du * dv, dv * dv])
    steps = np.arange(-EDGE_PX, EDGE_PX + 1)
    u, v = (places[:, None, :] + steps[None, :, None] * normals[:, None, :]).transpose(2, 0, 1)
    here = u.astype(np.float32), v.astype(np.float32)
    xx, xy, yy = (
        np.asarray(cv2.remap(np.asarray(part), *here, cv2.INTER_LINEAR)) for part in tensor
    )
    n_u, n_v = normals[:, :1], normals[:, 1:]
    along = n_u * n_u * xx + 2.0 * n_u * n_v * xy + n_v * n_v * yy
    across = along / (xx + yy + PHOTO_NOISE**2)
    return float(np.mean(across.max(axis=1) > EDGE_SHARE))


def _outline(
    covered: NDArray[np.bool_], weights: NDArray[np.float32]
) -> tuple[FloatArray, FloatArray]:
    """Points (k, 2) of the outline as column, row, and its outward normals (k, 2)."""
    soft = np.asarray(cv2.GaussianBlur(covered.astype(np.float32), (0, 0), 1.5))
    rim = covered & (cv2.erode(covered.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    rim &= weights > 0.0
    rim[:2] = False
    rim[-2:] = False
    rim[:, :2] = False
    rim[:, -2:] = False
    rows, columns = np.nonzero(rim)
    gradient = np.stack(
        [-cv2.Sobel(soft, cv2.CV_32F, *way)[rows, columns] for way in ((1, 0), (0, 1))], axis=1
    )
    length = np.linalg.norm(gradient, axis=1)
    kept = length > 1e-3
    normals = gradient[kept] / length[kept, None]
    return np.stack([columns, rows], axis=1)[kept].astype(float), normals.astype(float)
