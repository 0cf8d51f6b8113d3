"""Photos as taken and undistorted, points of both, and files of cameras, by OpenCV."""

from pathlib import Path

import cv2
import numpy as np

from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens, Undistortion, opencv_matrix


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


def as_taken(undistortion: Undistortion, pixels: np.ndarray) -> np.ndarray:
    """The photo as taken of an undistorted one (height, width, 3)."""
    height, width = pixels.shape[:2]
    rows, columns = np.mgrid[:height, :width] + 0.5
    points = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    at = (from_taken(undistortion, points) - 0.5).reshape(height, width, 2).astype(np.float32)
    return cv2.remap(pixels, at[..., 0], at[..., 1], cv2.INTER_CUBIC)


def write_camera(path: Path, camera: Perspective, lens: Lens) -> Path:
    """Write a camera and its lens as OpenCV's own sample does."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", camera.width)
    storage.write("image_height", camera.height)
    storage.write("fisheye_model", int(lens.model == "fisheye"))
    storage.write("camera_matrix", opencv_matrix(camera))
    storage.write("distortion_coefficients", lens.array.reshape(-1, 1))
    storage.release()
    return path
