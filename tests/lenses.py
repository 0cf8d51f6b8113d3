"""Points of a photo as taken and of the undistorted one, by OpenCV."""

import cv2
import numpy as np

from poseviewer.geometry.lens import Undistortion, opencv_matrix


def to_taken(undistortion: Undistortion, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the undistorted photo, px, in the photo as taken (n, 2)."""
    rays, lens = undistortion.camera.rays(points), undistortion.lens
    matrix = opencv_matrix(undistortion.taken)
    if lens.model == "fisheye":
        flat = np.ascontiguousarray(rays[None, :, :2])
        found = cv2.fisheye.distortPoints(flat, matrix, lens.array)
    else:
        found, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, lens.array)
    return found.reshape(-1, 2) + 0.5


def from_taken(undistortion: Undistortion, points: np.ndarray) -> np.ndarray:
    """Points (n, 2) of the photo as taken, px, in the undistorted photo (n, 2)."""
    lens, wanted = undistortion.lens, opencv_matrix(undistortion.camera)
    enough = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    found = lens.module.undistortPoints(
        points[None] - 0.5, opencv_matrix(undistortion.taken), lens.array, P=wanted,
        criteria=enough,
    )  # fmt: skip
    return found.reshape(-1, 2) + 0.5
