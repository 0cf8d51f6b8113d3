"""A quick outline of the model that needs nothing compiled: OpenCV fills a coarse model's faces."""

from __future__ import annotations

import cv2
import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.contour import silhouette
from poseviewer.render.overlay.window import model_window

FEW_FACES = 4000
"""Models of no more are drawn as they are."""
CELLS = 64
"""Of larger ones, vertices in the same cell become one: cells along the diameter."""
SAMPLES = 60_000
"""Of the picture that the faces are filled in."""
SHIFT = 4
"""Binary digits of a place that OpenCV takes as a fraction of a sample."""
FARTHEST = 2.0**14
"""Samples from the corner: farther places would overflow OpenCV's numbers."""


class Sketch:
    """One model, ready to be drawn from anywhere."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._vertices: FloatArray = mesh.vertices
        self._faces = mesh.faces
        if len(mesh.faces) > FEW_FACES:
            cells = np.floor((mesh.vertices - mesh.centre) * (CELLS / mesh.diameter)).astype(int)
            _, cell = np.unique(cells @ [1, 4 * CELLS, 16 * CELLS**2], return_inverse=True)
            count = np.bincount(cell)[:, None]
            sums = [np.bincount(cell, mesh.vertices[:, axis]) for axis in range(3)]
            self._vertices = np.column_stack(sums) / count
            faces = np.sort(cell[mesh.faces], axis=1)
            is_face = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
            self._faces = np.unique(faces[is_face], axis=0)

    def silhouette(self, pose: Pose) -> FloatArray:
        """(N, 2, 2): its segments in px of the photo, as of ``quick_silhouette``, off by up to a
        hundredth of the model.
        """
        window = model_window(self._mesh, pose, margin=4, most_samples=SAMPLES)
        if window is None:
            return np.zeros((0, 2, 2))
        seen = window.pose(pose)
        places = seen.project(self._vertices)[self._faces] - 0.5  # OpenCV's centres are at integers
        places = places[np.isfinite(places).all(axis=(1, 2))].clip(-FARTHEST, FARTHEST)
        covered = np.zeros((seen.camera.height, seen.camera.width), np.uint8)
        for corners in np.rint(places * 2**SHIFT).astype(np.int32):
            cv2.fillConvexPoly(covered, corners, 1, shift=SHIFT)
        return silhouette(covered > 0, window)
