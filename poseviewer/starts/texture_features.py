"""Poses from texture features: points of a photo that look like points of the model's surface.

SIFT points of views of the model, lit from the camera, are matched with the photo's by D. Lowe's
ratio test, view by view; RANSAC over SQPnP finds the pose with most inliers among a view's matches.
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
from poseviewer.geometry.image import GREY_WEIGHTS, Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import Renderer
from poseviewer.render.renderers import make_renderer
from poseviewer.scene.types import PlacedModel
from poseviewer.starts.start import StartInputs
from poseviewer.starts.views import sample_rotations

MODEL_VIEWS = 42
"""Rotations of the model that are rendered."""
VIEW_SIZES_PX = (320, 160)
"""Diameters of the model in its views."""
BORDER_PX = 20
"""Free pixels about the model in a view."""
DISTANCE = 5.0
"""Distance of the camera from the model's centre, in diameters."""
CONTRAST = 0.01
"""Smallest contrast of a feature: models are less sharp than photos."""
MAX_FEATURES_PER_VIEW = 800
"""Features of one view: more take longer."""
MAX_FEATURES_IN_PHOTO = 10_000
"""Features of the photo: more take longer."""
MAX_PHOTO_SIDE_PX = 1920
"""Longer side to which a photo is scaled."""
MAX_ENLARGEMENT = 2.0
"""Factor by which a small photo is enlarged at most."""
RATIO = 0.85
"""Largest distance of the nearest descriptor, by that of the second."""
MIN_MATCHES = 6
"""Matches that a pose needs: four give it, two confirm it."""
SURE_INLIERS = 10
"""Inliers from which a pose is right nearly always."""
MAX_COPIES = 5
"""Copies of the model that are searched for."""
ITERATIONS = 500
"""Largest number of RANSAC's draws."""
CONFIDENCE = 0.999
"""Probability that RANSAC draws inliers alone once."""
MAX_REPROJECTION_PX = 4.0
"""RANSAC's threshold, px of the scaled photo, within which a match is an inlier."""


class TextureFeatures(NamedTuple):
    """Points with descriptors (n, 128) of unit length."""

    at: FloatArray
    """(n, 3) in the model's frame, or (n, 2) px of the photo."""
    descriptors: NDArray[np.float32]


class FeaturePose(NamedTuple):
    """A pose, and the number of different pixels of the photo that are its inliers."""

    pose: Pose
    inliers: int


def poses_from_features(
    inputs: StartInputs, camera: Camera, region: Rectangle, watch: Callable[[], object]
) -> list[FeaturePose]:
    """Find the poses with most inliers in a region, one for each copy, the surest first.

    Args:
        inputs: photo and model.
        camera: camera of the photo.
        region: region of the photo.
        watch: called between views; it may raise to stop the search.
    """
    if not isinstance(camera, Perspective):
        return []
    mesh = inputs.mesh
    views = model_features(mesh)
    watch()
    features, scale = photo_features(inputs.photo, region, inputs.mask)
    poses: list[FeaturePose] = []
    while len(poses) < MAX_COPIES:
        candidates: list[FeaturePose] = []
        for view in views:
            watch()
            candidates += _ransac(view, features, camera, MAX_REPROJECTION_PX / scale)
        if not candidates:
            break
        poses.append(max(candidates, key=lambda candidate: candidate.inliers))
        if poses[-1].inliers < SURE_INLIERS:
            break
        outline = cv2.convexHull(poses[-1].pose.project(hull_points(mesh)).astype(np.float32))
        is_beside = [cv2.pointPolygonTest(outline, pixel, False) < 0 for pixel in features.at]
        features = TextureFeatures(features.at[is_beside], features.descriptors[is_beside])
    return sorted(poses, key=lambda candidate: -candidate.inliers)


@lru_cache(maxsize=4)
def model_features(mesh: Mesh) -> tuple[TextureFeatures, ...]:
    """Return the features of each view that has enough of them."""
    renderer, views = make_renderer(mesh), list[TextureFeatures]()
    for rotation in sample_rotations(MODEL_VIEWS):
        sizes = [_view(mesh, renderer, rotation, size) for size in VIEW_SIZES_PX]
        views.append(TextureFeatures(*map(np.concatenate, zip(*sizes, strict=True))))
    return tuple(view for view in views if len(view.at) >= MIN_MATCHES)


def _view(mesh: Mesh, renderer: Renderer, rotation: FloatArray, size: int) -> TextureFeatures:
    """Return the features of a view in which the model's diameter has a ``size``, px."""
    side, focal = size + 2 * BORDER_PX, DISTANCE * size
    camera = Perspective(focal, focal, side / 2, side / 2, side, side)
    translation = np.array([0.0, 0.0, DISTANCE * mesh.diameter]) - rotation @ mesh.centre
    pose = Pose(camera, RigidTransform(rotation, translation))
    view = renderer.render(pose)
    shaded = view.reflectance @ GREY_WEIGHTS * (0.5 + 0.5 * np.abs(view.normals[..., 2]))
    inside = cv2.erode(view.mask.astype(np.uint8), np.ones((5, 5)))
    pixels, descriptors = _sift(shaded, MAX_FEATURES_PER_VIEW, inside)
    columns, rows = pixels.T.astype(int)
    depth = depth_image(PlacedModel(mesh, pose))[rows, columns]
    points = (camera.rays(pixels) * depth[:, None] - translation) @ rotation
    return TextureFeatures(points, descriptors)


def photo_features(
    photo: Photo, region: Rectangle, mask: Mask | None = None
) -> tuple[TextureFeatures, float]:
    """Return the features of a photo's region that count, and the factor by which it was scaled."""
    inside = region.intersection(Rectangle(0, 0, photo.width, photo.height))
    left, top = int(inside.left), int(inside.top)
    part = photo.grey()[top : int(inside.bottom) + 1, left : int(inside.right) + 1]
    scale = min(MAX_PHOTO_SIDE_PX / max(part.shape), MAX_ENLARGEMENT)
    size = [max(round(side * scale), 1) for side in part.shape[::-1]]
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    scaled = cv2.resize(part, size, interpolation=how)
    pixels, descriptors = _sift(np.asarray(scaled, np.float32), MAX_FEATURES_IN_PHOTO)
    pixels = pixels * (part.shape[1] / size[0]) + [left, top]
    if mask is not None:
        columns, rows = pixels.astype(int).T
        is_shown = mask.weights[rows, columns] > 0.0
        pixels, descriptors = pixels[is_shown], descriptors[is_shown]
    return TextureFeatures(pixels, descriptors), scale


def _sift(grey: NDArray[Any], max_count: int, mask: Any = None) -> TextureFeatures:
    """Return points at pixels (n, 2), with RootSIFT descriptors (R. Arandjelovic, CVPR 2012)."""
    pixels = np.clip(255.0 * grey + 0.5, 0.0, 255.0).astype(np.uint8)
    sift = cv2.SIFT.create(max_count, contrastThreshold=CONTRAST)
    points, descriptors = sift.detectAndCompute(pixels, mask)
    if not len(points):
        return TextureFeatures(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    at = np.array([point.pt for point in points]) + 0.5
    return TextureFeatures(at, np.sqrt(shares, dtype=np.float32))


def match_features(one: TextureFeatures, other: TextureFeatures) -> tuple[FloatArray, FloatArray]:
    """Return where (n, ...) both have features that are alike, by the ratio test."""
    if min(len(one.at), len(other.at)) < MIN_MATCHES:
        return one.at[:0], other.at[:0]
    cosines = one.descriptors @ other.descriptors.T
    rows, nearest = np.arange(len(cosines)), np.argmax(cosines, axis=1)
    first = cosines[rows, nearest]
    cosines[rows, nearest] = -1.0
    is_clear = 1.0 - first < RATIO**2 * (1.0 - cosines.max(axis=1))
    return one.at[is_clear], other.at[nearest[is_clear]]


def _ransac(
    view: TextureFeatures, photo: TextureFeatures, camera: Perspective, threshold_px: float
) -> Iterator[FeaturePose]:
    """Yield the pose with most inliers among the matches of a view, if any."""
    points, pixels = match_features(view, photo)
    if len(points) < MIN_MATCHES:
        return
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    try:
        is_solved, vector, translation, inliers = cv2.solvePnPRansac(
            points,
            pixels,
            matrix,
            None,
            iterationsCount=ITERATIONS,
            reprojectionError=threshold_px,
            confidence=CONFIDENCE,
            flags=cv2.SOLVEPNP_SQPNP,
        )
    except cv2.error:  # all matches are one point
        return
    if is_solved and inliers is not None and translation[2, 0] > 0.0:
        rotation = np.asarray(cv2.Rodrigues(vector)[0], float)
        pose = Pose(camera, RigidTransform(rotation, np.asarray(translation[:, 0], float)))
        different = np.unique(np.round(pixels[np.asarray(inliers, int)[:, 0]]), axis=0)
        yield FeaturePose(pose, len(different))
