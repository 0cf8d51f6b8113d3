"""Lines of a model: its silhouette and its visible feature edges, as anti-aliased strokes.

Lines are found in a picture of face ids that is finer than the photo, so that hidden lines do not
occur. Between two neighbouring pixels that show different faces there is a feature edge if one of
these holds:

- the parts differ, or both faces have one colour each and these differ (material boundary);
- the shading normals bend by more than ``CREASE_DEG``, and so do their means on either side
  (crease: the noise of a scan bends them as much, but not their means);
- neither point is near the plane of the other's face (one surface ends in front of another).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.overlay.window import Window, model_window

CREASE_DEG = 35.0
"""Angle between shading normals from which an edge is a crease, in degrees."""
CREASE_REACH = 2.0
"""Length on either side, in line widths, whose mean normals tell creases: noise has gone there."""
MATERIAL_STEP = 0.08
"""Difference of flat colours in a channel, in [0, 1], between two materials, at least."""
DEPTH_STEP = 0.006
"""Distance between two surfaces, in the model's diameter, from which one ends in front."""
MIN_EDGE_LENGTH = 7.0
"""Length of a feature edge, in line widths, at least: shorter ones are specks."""
MIN_HOLE_LENGTH = 16.0
"""Length of a hole that is outlined, in line widths, at least: wheel spokes have shorter ones."""
CROWD_REACH = 10.0
"""Side of the square about a sample in which crowding is measured, in line widths."""
CROWDED_FRACTION = 0.22
"""Fraction of that square covered by edges, from which on edges fade."""
MIN_OPACITY = 0.5
"""Opacity below which crowded edges are left out as segments."""
SEGMENT_TOLERANCE = 0.6
"""Distance between a segment and its edge, in samples, at most."""
MAX_SAMPLES_PER_PX = 3
"""Samples along a photo pixel's side, at most: more are not visible."""
MAX_FACE_ID_SAMPLES = 4_000_000
"""Samples in the picture of face ids, at most: they take two seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class LineDrawing:
    """Distances from the model's lines at the samples of a window, in photo px."""

    window: Window
    silhouette: NDArray[np.float32]
    """(h, w): distance to the silhouette."""
    features: NDArray[np.float32]
    """(h, w): distance to the nearest feature edge."""
    crowding: NDArray[np.float32]
    """(h, w) in [0, 1]: opacity of feature edges; less where they crowd."""
    covered: NDArray[np.bool_]
    """(h, w): samples inside the silhouette, small holes included."""
    nearer: NDArray[np.bool_]
    """(h, w): samples left of feature edges, or above them."""

    def outline(self, line_width: float) -> NDArray[np.float32]:
        """(h, w) in [0, 1]: stroke the silhouette, ``line_width`` px wide."""
        return self._stroke(self.silhouette, line_width)

    def edges(self, line_width: float) -> NDArray[np.float32]:
        """(h, w) in [0, 1]: stroke the feature edges, ``line_width`` px wide."""
        return self._stroke(self.features, line_width) * self.crowding

    def edge_segments(self) -> FloatArray:
        """(N, 2, 2): trace feature edges as segments, px of the photo, without crowded ones."""
        thin = (self.nearer & (self.crowding > MIN_OPACITY)).astype(np.uint8)
        pieces = [np.zeros((0, 2, 2))]
        # The contour of a line one sample wide runs along it, and back.
        for line in cv2.findContours(thin, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]:
            corners = cv2.approxPolyDP(line, SEGMENT_TOLERANCE, closed=True)[:, 0]
            pieces.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(float))
        window = self.window
        return (np.concatenate(pieces) + 0.75) / window.samples + [window.left, window.top]

    def _stroke(self, distance: NDArray[np.float32], line_width: float) -> NDArray[np.float32]:
        return np.clip((line_width / 2.0 - distance) * self.window.samples + 0.5, 0.0, 1.0)


def find_lines(mesh: Mesh, renderer: Renderer, pose: Pose, scale: float) -> LineDrawing | None:
    """Find the model's lines; this takes up to two seconds.

    Args:
        mesh: the model.
        renderer: renderer of the model.
        pose: pose in the photo.
        scale: width of a stroke, px.

    Returns:
        The lines; None if the model is not in sight.
    """
    finest = max(1, round(MAX_SAMPLES_PER_PX / scale))
    window = model_window(mesh, pose, math.ceil(5.0 * scale), finest, MAX_FACE_ID_SAMPLES)
    if window is None:
        return None
    close = window.pose(pose)
    image = renderer.render(close)
    if not image.mask.any():
        return None
    width = scale * window.samples
    half = np.float32(0.5)
    samples = np.float32(window.samples)
    nearer, both = _feature_samples(mesh, close, image, math.ceil(CREASE_REACH * width))
    marked = _without_specks(both, MIN_EDGE_LENGTH * width)
    outside = _without_specks(~image.mask, MIN_HOLE_LENGTH * width)
    silhouette = (np.where(outside, _distance(outside), _distance(~outside)) - half) / samples
    # Samples on both sides of an edge are marked; the edge is half a sample from their centres.
    features = (_distance(~marked) + half) / samples
    return LineDrawing(
        window, silhouette, features, _crowding(marked, width), ~outside, nearer & marked
    )


def _feature_samples(
    mesh: Mesh, pose: Pose, image: AttributeImage, reach: int
) -> NDArray[np.bool_]:
    """(2, h, w): samples left of feature edges or above them, and those on both sides; creases bend
    the mean normals of ``reach`` samples, too.
    """
    ids, normals = image.face_ids.ravel(), image.normals.reshape(-1, 3)
    nearer, farther = np.zeros((2, ids.size), bool)
    index = np.arange(ids.size).reshape(image.face_ids.shape)
    points = pose.camera_from_model.apply(mesh.vertices)
    planes, _ = face_normals_and_areas(points, mesh.faces)
    offsets = np.einsum("ij,ij->i", planes, points[mesh.faces[:, 0]])
    planes = np.column_stack([planes, offsets])  # n . x = d, in the camera frame
    means = cv2.blur(image.normals, (2 * reach + 1,) * 2)
    means = np.asarray(means, np.float32).reshape(-1, 3)
    for one, other in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
        one, other = one.ravel(), other.ravel()
        differ = (ids[one] != ids[other]) & (ids[one] >= 0) & (ids[other] >= 0)
        one, other = one[differ], other[differ]
        lies = _bends(normals[one], normals[other])
        away = reach * int(other[0] - one[0]) if len(one) else 0
        ends = np.clip(one - away, 0, ids.size - 1), np.clip(other + away, 0, ids.size - 1)
        lies &= _bends(means[ends[0]], means[ends[1]])
        lies |= _are_boundaries(mesh, ids[one], ids[other])
        lies |= _are_steps(mesh, pose.camera, planes, ids, one, other)
        nearer[one[lies]] = farther[other[lies]] = True
    return np.stack([nearer, nearer | farther]).reshape(2, *index.shape)


def _bends(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(N,): whether directions (N, 3) differ by more than ``CREASE_DEG``; nothing does from 0."""
    lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    cosines = np.einsum("ij,ij->i", one, other)
    return cosines < math.cos(math.radians(CREASE_DEG)) * lengths


def _are_boundaries(mesh: Mesh, one: NDArray[np.int32], other: NDArray[np.int32]) -> NDArray:
    """(N,): whether faces ``one`` and ``other`` (N,) differ in part or in flat colour."""
    corners = mesh.colours[mesh.faces]
    plain = (np.ptp(corners, axis=1).max(axis=1) < 1e-3) & (mesh.face_texture < 0)
    step = np.abs(corners[one, 0] - corners[other, 0]).max(axis=1) > MATERIAL_STEP
    return (mesh.face_part[one] != mesh.face_part[other]) | (step & plain[one] & plain[other])


def _are_steps(
    mesh: Mesh, camera: Camera, planes: FloatArray, ids: NDArray, one: NDArray, other: NDArray
) -> NDArray:
    """(N,): whether neither sample's surface point is near the plane of the other's face."""
    are_steps = np.ones(len(one), bool)
    for here, there in ((one, other), (other, one)):
        plane = planes[ids[there]]
        point = _surface_points(camera, planes[ids[here]], here)
        away = np.einsum("ij,ij->i", point, plane[:, :3]) - plane[:, 3]
        are_steps &= np.abs(away) > DEPTH_STEP * mesh.diameter
    return are_steps


def _surface_points(camera: Camera, planes: FloatArray, samples: NDArray) -> FloatArray:
    """(N, 3) in the camera frame: intersections of viewing rays of flat samples with planes."""
    uv = np.stack([samples % camera.width, samples // camera.width], axis=-1) + 0.5
    start, normals = camera.points_at(uv, 0.0), planes[:, :3]
    way = camera.points_at(uv, 1.0) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        away = planes[:, 3] - np.einsum("ij,ij->i", start, normals)
        points = start + way * (away / np.einsum("ij,ij->i", way, normals))[:, None]
    # A face seen exactly edge-on has no such point: the test of the other face decides.
    return np.nan_to_num(points, nan=1e30, posinf=1e30, neginf=-1e30)


def _without_specks(marked: NDArray[np.bool_], min_length: float) -> NDArray[np.bool_]:
    """Connected pieces whose bounding box is at least ``min_length`` samples long."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(marked.astype(np.uint8), connectivity=8)
    size = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    keep = size >= min_length
    keep[0] = False  # the background
    return keep[np.asarray(labels, np.int32)]


def _distance(away: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(h, w): distance of each True sample to the nearest False one, in samples; 0 at False."""
    if away.all():
        return np.full(away.shape, 1e6, np.float32)
    distance = cv2.distanceTransform(away.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance, np.float32)


def _crowding(marked: NDArray[np.bool_], line_width: float) -> NDArray[np.float32]:
    """(h, w): 1 where lines are few, falling towards 0 where they crowd."""
    size = 2 * math.ceil(CROWD_REACH * line_width / 2.0) + 1
    # Lines are marked two samples wide, but their strokes may cover more.
    covered = cv2.blur(marked.astype(np.float32), (size, size)) * max(line_width, 2.0) / 2.0
    return np.minimum(1.0, CROWDED_FRACTION / np.maximum(covered, 1e-6)).astype(np.float32)
