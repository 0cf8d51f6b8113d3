"""Poses from print: points of a photo that look like points of the model's surface.

SIFT points of views of the model, lit from the camera, are matched with the photo's by D. Lowe's
ratio test, view by view; RANSAC over SQPNP finds the pose that most matches of a view agree on.
"""

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.fit.visibility import depth_image
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.renderers import make_renderer
from poseviewer.render.types import Renderer
from poseviewer.scene.types import PlacedModel
from poseviewer.starts.loading import StartInputs
from poseviewer.starts.views import even_rotations

VIEWS, VIEW_SIZES_PX, BORDER_PX = 42, (320, 160), 20
"""Views of the model; its diameters in them; free pixels about it."""
DISTANCE = 5.0
"""From the model's centre to the camera, in diameters."""
CONTRAST, MAX_FEATURES_PER_VIEW, MAX_FEATURES_IN_PHOTO = 0.01, 800, 10_000
"""Least contrast of a point, and the most points."""
PHOTO_SIDE, ENLARGED = 1920, 2.0
"""px: longer side to which a photo is scaled, enlarged by no more than this."""
RATIO = 0.85
"""Most distance of the nearest descriptor, by that of the second."""
MIN_MATCHES = 6
"""Matches that a pose needs: four give it."""
SURE_INLIERS, MAX_COPIES = 10, 5
"""Pixels from which a pose is right nearly always; copies of the model that are looked for."""
ITERATIONS, CONFIDENCE, MAX_REPROJECTION_PX = 500, 0.999, 4.0
"""RANSAC's most draws and wanted probability; px of the scaled photo by which a point agrees."""


class Points(NamedTuple):
    """Points with descriptors (n, 128) of unit length."""

    at: FloatArray
    """(n, 3) in the model's frame, or (n, 2) px of the photo."""
    descriptors: NDArray[np.float32]


class FeaturePose(NamedTuple):
    """A pose, and the number of different pixels of the photo that agree on it."""

    pose: Pose
    inliers: int


def poses_from_features(
    inputs: StartInputs, camera: Camera, region: Rectangle, watch: Callable[[], object]
) -> list[FeaturePose]:
    """Poses that most matches in a region of the photo agree on, for each copy of the model that
    is seen there, the surest first; ``watch`` is called between views, and may raise.
    """
    if not isinstance(camera, Perspective):
        return []
    mesh = inputs.mesh
    views = model_points(mesh)
    watch()
    points, scale = _photo_points(inputs, region)
    poses: list[FeaturePose] = []
    while len(poses) < MAX_COPIES:
        agreeing: list[FeaturePose] = []
        for view in views:
            watch()
            agreeing += _ransac(view, points, camera, MAX_REPROJECTION_PX / scale)
        if not agreeing:
            break
        poses.append(max(agreeing, key=lambda printed: printed.inliers))
        if poses[-1].inliers < SURE_INLIERS:
            break
        outline = cv2.convexHull(poses[-1].pose.project(hull_points(mesh)).astype(np.float32))
        is_left = [cv2.pointPolygonTest(outline, pixel, False) < 0 for pixel in points.at]
        points = Points(points.at[is_left], points.descriptors[is_left])
    return sorted(poses, key=lambda printed: -printed.inliers)


@lru_cache(maxsize=4)
def model_points(mesh: Mesh) -> tuple[Points, ...]:
    """The points of each view that has enough of them."""
    return tuple(view for view in _views(mesh) if len(view.at) >= MIN_MATCHES)


def _views(mesh: Mesh) -> Iterator[Points]:
    renderer = make_renderer(mesh)
    for rotation in even_rotations(VIEWS):
        sizes = [_view(mesh, renderer, rotation, size) for size in VIEW_SIZES_PX]
        yield Points(*map(np.concatenate, zip(*sizes, strict=True)))


def _view(mesh: Mesh, renderer: Renderer, rotation: FloatArray, size: int) -> Points:
    """Points of a view in which the model's diameter has a ``size``, px."""
    side, focal = size + 2 * BORDER_PX, DISTANCE * size
    camera = Perspective(focal, focal, side / 2, side / 2, side, side)
    place = np.array([0.0, 0.0, DISTANCE * mesh.diameter]) - rotation @ mesh.centre
    pose = Pose(camera, RigidTransform(rotation, place))
    view = renderer.render(pose)
    shaded = view.reflectance @ GREY_WEIGHTS * (0.5 + 0.5 * np.abs(view.normals[..., 2]))
    inside = cv2.erode(view.mask.astype(np.uint8), np.ones((5, 5)))
    pixels, descriptors = _sift(shaded, MAX_FEATURES_PER_VIEW, inside)
    columns, rows = pixels.T.astype(int)
    depth = depth_image(PlacedModel(mesh, pose))[rows, columns]
    points = (camera.rays(pixels) * depth[:, None] - place) @ rotation
    return Points(points, descriptors)


def _photo_points(inputs: StartInputs, region: Rectangle) -> tuple[Points, float]:
    """Points of a region where the mask shows them, and the factor by which it was scaled."""
    photo, mask = inputs.photo, inputs.mask
    inside = region.intersection(Rectangle(0, 0, photo.width, photo.height))
    left, top = int(inside.left), int(inside.top)
    part = photo.grey()[top : int(inside.bottom) + 1, left : int(inside.right) + 1]
    scale = min(PHOTO_SIDE / max(part.shape), ENLARGED)
    size = [max(round(side * scale), 1) for side in part.shape[::-1]]
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    scaled = cv2.resize(part, size, interpolation=how)
    pixels, descriptors = _sift(np.asarray(scaled, np.float32), MAX_FEATURES_IN_PHOTO)
    pixels = pixels * (part.shape[1] / size[0]) + [left, top]
    if mask is not None:
        columns, rows = pixels.astype(int).T
        is_shown = mask.weights[rows, columns] > 0.0
        pixels, descriptors = pixels[is_shown], descriptors[is_shown]
    return Points(pixels, descriptors), scale


def _sift(grey: NDArray[Any], most: int, mask: Any = None) -> Points:
    """Points at pixels (n, 2), with RootSIFT descriptors (R. Arandjelovic, CVPR 2012)."""
    pixels = np.clip(255.0 * grey + 0.5, 0.0, 255.0).astype(np.uint8)
    sift = cv2.SIFT.create(most, contrastThreshold=CONTRAST)
    points, descriptors = sift.detectAndCompute(pixels, mask)
    if not len(points):
        return Points(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    at = np.array([point.pt for point in points]) + 0.5
    return Points(at, np.sqrt(shares, dtype=np.float32))


def _ransac(
    view: Points, photo: Points, camera: Perspective, off_px: float
) -> Iterator[FeaturePose]:
    """The pose that most matches of a view agree on, if any."""
    if len(photo.at) < MIN_MATCHES:
        return
    alike = view.descriptors @ photo.descriptors.T
    rows, nearest = np.arange(len(alike)), np.argmax(alike, axis=1)
    first = alike[rows, nearest]
    alike[rows, nearest] = -1.0
    is_clear = 1.0 - first < RATIO**2 * (1.0 - alike.max(axis=1))
    points, pixels = view.at[is_clear], photo.at[nearest[is_clear]]
    if len(points) < MIN_MATCHES:
        return
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    try:
        is_solved, turn, place, agreeing = cv2.solvePnPRansac(
            points,
            pixels,
            matrix,
            None,
            iterationsCount=ITERATIONS,
            reprojectionError=off_px,
            confidence=CONFIDENCE,
            flags=cv2.SOLVEPNP_SQPNP,
        )
    except cv2.error:  # matches in one point
        return
    if is_solved and agreeing is not None and place[2, 0] > 0.0:
        rotation = np.asarray(cv2.Rodrigues(turn)[0], float)
        pose = Pose(camera, RigidTransform(rotation, np.asarray(place[:, 0], float)))
        different = np.unique(np.round(pixels[np.asarray(agreeing, int)[:, 0]]), axis=0)
        yield FeaturePose(pose, len(different))
