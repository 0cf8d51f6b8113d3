"""The window of a photo about the model: pictures for people are drawn only there."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh, hull_in_photo, hull_points


@dataclass(frozen=True, slots=True)
class Window:
    """A window of the photo, and its number of samples."""

    left: int
    """Left border, px. It may be negative, to tell a silhouette outside from the photo's border."""
    top: int
    width: int
    height: int
    samples: float = 1.0
    """Samples along a photo pixel's side: 3, 2, 1, 1/2, 1/3 ..."""

    def pose(self, pose: Pose) -> Pose:
        """Return the pose in the picture of the window."""
        camera = pose.camera.crop(self.left, self.top, (self.width, self.height))
        cropped = replace(pose, camera=camera)
        return cropped if self.samples == 1.0 else cropped.rescale(self.samples)

    def of_photo(self, width: int, height: int) -> tuple[slice, slice]:
        """Return the rows and columns of a photo of this size that the window covers."""
        rows = slice(max(self.top, 0), max(min(self.top + self.height, height), 0))
        columns = slice(max(self.left, 0), max(min(self.left + self.width, width), 0))
        return rows, columns

    def resample(self, samples: NDArray[np.float32], width: int, height: int) -> NDArray:
        """Resample values from the window's samples to the photo's pixels in ``of_photo``."""
        interpolation = cv2.INTER_AREA if self.samples >= 1.0 else cv2.INTER_LINEAR
        piece = np.asarray(
            cv2.resize(samples, (self.width, self.height), interpolation=interpolation)
        )
        rows, columns = self.of_photo(width, height)
        return piece[
            rows.start - self.top : rows.stop - self.top,
            columns.start - self.left : columns.stop - self.left,
        ]


def model_window(
    mesh: Mesh, pose: Pose, margin: int = 0, finest: int = 1, max_samples: float = math.inf
) -> Window | None:
    """Return the window of the model's box in the photo.

    Args:
        mesh: the model.
        pose: pose in the photo; a model partly behind the camera takes the whole photo.
        margin: margin about the box, px.
        finest: samples along a pixel's side, at most.
        max_samples: samples in the window, at most.

    Returns:
        The window; None if the model is beside the photo.
    """
    points, size = hull_in_photo(mesh, pose), [pose.camera.width, pose.camera.height]
    if not len(points):
        return None
    low, high = np.zeros(2, int), np.array(size)
    if len(points) == len(hull_points(mesh)):
        low = np.floor(np.clip(points.min(axis=0), 0, size)).astype(int)
        high = np.ceil(np.clip(points.max(axis=0), 0, size)).astype(int)
    if np.any(high <= low):
        return None
    left, top = (low - margin).tolist()
    width, height = (high - low + 2 * margin).tolist()
    share = max_samples / (width * height)
    if share >= 1.0:
        return Window(left, top, width, height, int(min(finest, math.sqrt(share))))
    step = math.ceil(math.sqrt(1.0 / share))
    # Whole samples only, or the picture would be stretched.
    return Window(left, top, -(-width // step) * step, -(-height // step) * step, 1.0 / step)
