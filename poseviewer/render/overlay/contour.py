"""The model's silhouette as line segments in the photo, exact or by a quick sketch."""

import cv2
import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh, hull_in_photo
from poseviewer.render.attributes import Renderer
from poseviewer.render.overlay.window import Window, model_window

LINE_TOLERANCE = 0.2
"""Distance, in samples, up to which a simplified line leaves out points: invisible."""
SMOOTHING = 0.7
"""Standard deviation, in samples, of the blur that removes the stairs of the mask."""
MIN_HOLE_PX = 16.0
"""Holes whose outline is shorter than this, in px, are not drawn (wheel spokes)."""
PIECE = 3.0
"""Length, in samples, of the pieces of a line that are tested for visibility."""
BESIDE = 2
"""Distance, in samples, from visible pixels up to which a piece is visible."""
QUICK_SAMPLES = 160_000
"""Samples in the picture of a silhouette in motion, at most: it must keep up with the mouse."""
MAX_SKETCH_FACES = 4000
"""Faces up to which a sketch draws all faces; drawing more takes too long."""
SKETCH_CELLS = 64
"""Cells along the diameter in which a sketch merges the vertices of larger models."""
SHIFT = 4
"""Binary digits of OpenCV's fractions of a sample."""
MAX_COORDINATE = 2.0**14
"""Largest coordinate, in samples, that does not overflow in OpenCV."""


def quick_silhouette(mesh: Mesh, renderer: Renderer, pose: Pose) -> FloatArray:
    """(N, 2, 2): draw segments of the silhouette, px, to half a pixel or coarser."""
    window = model_window(mesh, pose, margin=4, max_samples=QUICK_SAMPLES)
    if window is None:
        return np.zeros((0, 2, 2))
    return silhouette(renderer.render_mask(window.pose(pose)), window)


def silhouette(covered: NDArray[np.bool_], window: Window) -> FloatArray:
    """(N, 2, 2): draw segments, in px of the photo, around ``covered`` samples (h, w)."""
    soft = cv2.GaussianBlur(covered.astype(np.float32), (0, 0), SMOOTHING)
    # An empty rim closes outlines at the border of the picture.
    soft = np.pad(np.asarray(soft), 1)
    min_hole = MIN_HOLE_PX * window.samples
    pieces = [np.zeros((0, 2, 2))]
    for line in contour_generator(z=soft).lines(0.5):
        points = np.asarray(line, np.float32)
        is_hole = cv2.contourArea(points, oriented=True) < 0.0
        if is_hole and np.ptp(points, axis=0).max(initial=0.0) < min_hole:
            continue
        corners = cv2.approxPolyDP(points[:-1, None], LINE_TOLERANCE, closed=True)[:, 0]
        pieces.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(float))
    samples = np.concatenate(pieces) - 0.5  # the rim, and centres at i + 0.5
    return samples / window.samples + np.array([window.left, window.top])


def select_visible_lines(
    lines: FloatArray, visible: NDArray[np.bool_], samples: float
) -> FloatArray:
    """Select the pieces (M, 2, 2) of segments (N, 2, 2), px, that run along visible samples.

    ``visible`` has ``samples`` along the side of a px.
    """
    ends = lines * samples
    counts = np.maximum(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / PIECE), 1.0)
    index = np.repeat(np.arange(len(ends)), counts.astype(int))
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])[index] if len(ends) else index
    share = ((np.arange(len(index)) - first) / counts[index])[:, None]
    start, way = ends[index, 0], ends[index, 1] - ends[index, 0]
    shares = share, share + 1.0 / counts[index][:, None]
    pieces = np.stack([start + end * way for end in shares], axis=1)
    near = cv2.dilate(visible.astype(np.uint8), np.ones((2 * BESIDE + 1,) * 2, np.uint8))
    size = np.array(visible.shape[::-1]) - 1
    x, y = np.clip(np.floor(pieces.mean(axis=1)).astype(int), 0, size).T
    return pieces[np.asarray(near)[y, x] > 0] / samples


def is_within_outline(point: FloatArray, pose: Pose, mesh: Mesh, reach: float) -> bool:
    """Tell whether a point lies within the model's convex outline, or near it.

    Args:
        point: (2,): point of the photo, px.
        pose: pose of the model.
        mesh: the model.
        reach: distance from the outline up to which a point is near, px.
    """
    outline = hull_in_photo(mesh, pose).astype(np.float32)
    if len(outline) < 3 or not np.isfinite(point).all():
        return False
    u, v = point.tolist()
    return cv2.pointPolygonTest(cv2.convexHull(outline), (u, v), True) >= -reach


class Sketch(Renderer):
    """Renderer of silhouettes alone, to a hundredth of the model, without compiled kernels."""

    def __init__(self, mesh: Mesh) -> None:
        self._vertices: FloatArray = mesh.vertices
        self._faces = mesh.faces
        if len(mesh.faces) > MAX_SKETCH_FACES:
            per_length = SKETCH_CELLS / mesh.diameter
            cells = np.floor((mesh.vertices - mesh.centre) * per_length).astype(int)
            strides = [1, 4 * SKETCH_CELLS, 16 * SKETCH_CELLS**2]
            _, cell = np.unique(cells @ strides, return_inverse=True)
            count = np.bincount(cell)[:, None]
            sums = [np.bincount(cell, mesh.vertices[:, axis]) for axis in range(3)]
            self._vertices = np.column_stack(sums) / count
            faces = np.sort(cell[mesh.faces], axis=1)
            is_face = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
            self._faces = np.unique(faces[is_face], axis=0)

    def render_mask(self, pose: Pose) -> NDArray[np.bool_]:
        """(height, width): draw the pixels that show the model."""
        # OpenCV's pixel centres are at integers.
        points = pose.project(self._vertices)[self._faces] - 0.5
        points = points[np.isfinite(points).all(axis=(1, 2))].clip(-MAX_COORDINATE, MAX_COORDINATE)
        covered = np.zeros((pose.camera.height, pose.camera.width), np.uint8)
        for corners in np.rint(points * 2**SHIFT).astype(np.int32):
            cv2.fillConvexPoly(covered, corners, 1, shift=SHIFT)
        return covered > 0
