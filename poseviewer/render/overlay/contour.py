"""The model's silhouette as line segments in the photo; a sketch of it needs nothing compiled."""

import cv2
import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh, hull_in_photo
from poseviewer.render.overlay.window import Window, model_window
from poseviewer.render.types import Renderer

TOLERANCE, SMOOTHING = 0.2, 0.7
"""Samples: points closer to the line they lie on are left out; blur of the coverage's stairs."""
MIN_HOLE_PX = 16.0
"""Holes whose outline is shorter than this, in px, are not drawn (wheel spokes)."""
PIECE, BESIDE = 3.0, 2
"""Samples: a line is cut into pieces so long; those this far beside what is seen run along it."""
QUICK_SAMPLES = 160_000
"""A silhouette in motion is found in a picture of no more samples than this."""
FEW_FACES, CELLS = 4000, 64
"""Faces that a sketch draws as they are; of more, vertices in one cell of the diameter are one."""
SHIFT, MAX_COORDINATE = 4, 2.0**14
"""OpenCV's binary digits for fractions of a sample; farther samples would overflow its numbers."""


def quick_silhouette(mesh: Mesh, renderer: Renderer, pose: Pose) -> FloatArray:
    """(N, 2, 2): the silhouette's segments, px of the photo, to half a pixel, or coarser."""
    window = model_window(mesh, pose, margin=4, most_samples=QUICK_SAMPLES)
    if window is None:
        return np.zeros((0, 2, 2))
    return silhouette(renderer.render_mask(window.pose(pose)), window)


def silhouette(covered: NDArray[np.bool_], window: Window) -> FloatArray:
    """(N, 2, 2): segments, in px of the photo, around the samples (h, w) that are ``covered``."""
    soft = cv2.GaussianBlur(covered.astype(np.float32), (0, 0), SMOOTHING)
    # A rim of nothing closes outlines that run into the border of the picture.
    soft = np.pad(np.asarray(soft), 1)
    shortest = MIN_HOLE_PX * window.samples
    pieces = [np.zeros((0, 2, 2))]
    for line in contour_generator(z=soft).lines(0.5):
        points = np.asarray(line, np.float32)
        is_hole = cv2.contourArea(points, oriented=True) < 0.0
        if is_hole and np.ptp(points, axis=0).max(initial=0.0) < shortest:
            continue
        kept = cv2.approxPolyDP(points[:-1, None], TOLERANCE, closed=True)[:, 0]
        pieces.append(np.stack([kept, np.roll(kept, -1, axis=0)], axis=1).astype(float))
    samples = np.concatenate(pieces) - 0.5  # the rim, and centres at i + 0.5
    return samples / window.samples + np.array([window.left, window.top])


def select_visible_lines(lines: FloatArray, seen: NDArray[np.bool_], samples: float) -> FloatArray:
    """(M, 2, 2): pieces of segments (N, 2, 2), px, along what is ``seen`` at ``samples`` a px."""
    ends = lines * samples
    counts = np.maximum(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / PIECE), 1.0)
    index = np.repeat(np.arange(len(ends)), counts.astype(int))
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])[index] if len(ends) else index
    share = ((np.arange(len(index)) - first) / counts[index])[:, None]
    start, way = ends[index, 0], ends[index, 1] - ends[index, 0]
    shares = share, share + 1.0 / counts[index][:, None]
    pieces = np.stack([start + end * way for end in shares], axis=1)
    near = cv2.dilate(seen.astype(np.uint8), np.ones((2 * BESIDE + 1,) * 2, np.uint8))
    size = np.array(seen.shape[::-1]) - 1
    x, y = np.clip(np.floor(pieces.mean(axis=1)).astype(int), 0, size).T
    return pieces[np.asarray(near)[y, x] > 0] / samples


def is_within_outline(points: FloatArray, pose: Pose, mesh: Mesh, reach: float) -> bool:
    """Whether a point (2,) of the photo lies on the model's convex outline, or ``reach`` px off."""
    outline = hull_in_photo(mesh, pose).astype(np.float32)
    if len(outline) < 3 or not np.isfinite(points).all():
        return False
    point = (float(points[0]), float(points[1]))
    return cv2.pointPolygonTest(cv2.convexHull(outline), point, True) >= -reach


class Sketch(Renderer):
    """A renderer that knows which pixels the model covers, to a hundredth of it, and no more."""

    def __init__(self, mesh: Mesh) -> None:
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

    def render_mask(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): where the model is seen."""
        places = pose.project(self._vertices)[self._faces] - 0.5  # OpenCV's centres are at integers
        places = places[np.isfinite(places).all(axis=(1, 2))].clip(-MAX_COORDINATE, MAX_COORDINATE)
        covered = np.zeros((pose.camera.height, pose.camera.width), np.uint8)
        for corners in np.rint(places * 2**SHIFT).astype(np.int32):
            cv2.fillConvexPoly(covered, corners, 1, shift=SHIFT)
        return covered > 0
