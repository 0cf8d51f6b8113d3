"""Buffers for the sums of classes and edges, kept from pose to pose."""

from __future__ import annotations

import numpy as np

from poseviewer.render.software.kernel_structure import PLANES
from poseviewer.render.structure import BLUR_TAPS


class ClassRoom:
    """What the kernels of ``kernel_structure`` write, for a photo (height, width)."""

    def __init__(self, height: int, width: int, model: int, photo: int) -> None:
        """For so many attributes of the model, with the 1 on it, and of the photo."""
        self.size = model, photo
        self.planes = np.zeros((PLANES, height + 2, width + 2), np.float32)
        self.spans = np.zeros((height, 2), np.int64)
        self.run = np.empty((photo + model + 1, width))
        self.joint = np.empty((photo, model))
        self.second = np.empty((model, model))
        self.rows = np.empty((5, width + 2 * (len(BLUR_TAPS) - 1)), np.float32)
        self.across = np.empty((2, height, width), np.float32)
