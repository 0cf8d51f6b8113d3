"""Motion of a model from one photo to the next, by points of the picture on it.

Corners within the model's outline are followed by optical flow (Lucas and Kanade), forwards and
back, lifted onto the model at its last pose, and the pose in the next photo is the one under which
they project to where they are then (PnP). Points know the motion wherever there is print, but not
the model's true edges: what they tell is where a search begins, and a prior of its end.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.fit.visibility import depth_image
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.types import PlacedModel

MAX_CORNERS = 200
"""Corners that are followed: more hardly tell more."""
CORNER_QUALITY = 0.0005
"""Least strength of a corner, as a share of the strongest one's."""
CORNER_DISTANCE_PX = 5
"""Least distance of two corners."""
MARGIN_PX = 4
"""Distance of a corner from the outline, whose own corners belong to what is behind."""
WINDOW = 21, 21
"""Size of what is compared about a corner, px."""
LEVELS = 4
"""Halvings of the photo: motions of some 100 px are followed."""
RETURN_PX = 0.7
"""Distance at which a corner comes back, followed forwards and back, at most."""
OUTLIER_PX = 2.0
"""Distance from the motion of most from which a point is on something else."""
MIN_POINTS = 12
"""Points that tell a motion; fewer may agree by chance."""
MIN_SHARE = 0.5
"""Share of the followed points that must agree."""
MIN_PX = 0.2
"""Standard deviation of a point at least: sampling, blur, the shutter."""
POINTS_PER_FACT = 4.0
"""Points that err together, as they share their surroundings and the model's errors."""

Grey = NDArray[np.uint8]
"""(height, width): a photo's brightness."""


def grey_of(photo: Photo) -> Grey:
    """Return the brightness of a photo."""
    pixels = photo.pixels
    grey = pixels[..., 0] if pixels.shape[2] == 1 else cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    return np.ascontiguousarray(grey, np.uint8)


def follow_points(
    before: Grey, after: Grey, model: PlacedModel, ignored: NDArray[np.bool_] | None = None
) -> PoseCovariance | None:
    """Find the pose of a model in the next photo, and how far its points tell it.

    Args:
        before: photo in which the model stands at its pose.
        after: the next photo, of the same size and camera.
        model: the model at its pose in ``before``.
        ignored: pixels of ``before``, at any size, that do not count: something may be in front.

    Returns:
        The distribution of the pose; None where too few points agree.
    """
    camera = model.pose.camera
    if not isinstance(camera, Perspective) or before.shape != after.shape:
        return None
    depth = depth_image(model)
    inside = np.isfinite(depth)
    if ignored is not None:
        whole = cv2.resize(
            ignored.astype(np.uint8), before.shape[::-1], interpolation=cv2.INTER_NEAREST
        )
        inside &= np.asarray(whole) == 0
    size = 2 * MARGIN_PX + 1
    inner = cv2.erode(inside.astype(np.uint8), np.ones((size, size), np.uint8))
    start = cv2.goodFeaturesToTrack(
        before, MAX_CORNERS, CORNER_QUALITY, CORNER_DISTANCE_PX, mask=inner
    )
    if start is None or len(start) < MIN_POINTS:
        return None
    how = {"winSize": WINDOW, "maxLevel": LEVELS}
    end, is_there, _ = cv2.calcOpticalFlowPyrLK(before, after, start, start.copy(), **how)
    back, is_back, _ = cv2.calcOpticalFlowPyrLK(after, before, end, end.copy(), **how)
    returned = np.linalg.norm(back - start, axis=2)[:, 0] < RETURN_PX
    kept = (is_there[:, 0] > 0) & (is_back[:, 0] > 0) & returned
    start, end = start[kept, 0].astype(float), end[kept, 0].astype(float)
    if len(start) < MIN_POINTS:
        return None
    columns, rows = np.rint(start).astype(int).T
    lifted = camera.points_at(start + 0.5, depth[rows, columns].astype(float))
    points = model.pose.camera_from_model.inverse().apply(lifted)
    pose, agreeing = _solve_pose(points, end, model.pose, camera)
    if pose is None or len(agreeing) < max(MIN_POINTS, MIN_SHARE * len(points)):
        return None
    away = pose.project(points[agreeing]) - (end[agreeing] + 0.5)
    px = max(float(np.sqrt(np.mean(away**2))), MIN_PX)
    each = px * np.sqrt(POINTS_PER_FACT)
    told = PoseCovariance.from_points(model.mesh, pose, points[agreeing], each)
    return (
        told if told is not None and math.isfinite(told.px) else None
    )  # in part behind the camera


def _solve_pose(
    points: NDArray[np.float64], pixels: NDArray[np.float64], near: Pose, camera: Perspective
) -> tuple[Pose | None, NDArray[np.intp]]:
    """Solve for the pose under which most ``points`` (n, 3) project to ``pixels`` (n, 2), OpenCV's;
    with the indices of those.
    """
    matrix, place = opencv_matrix(camera), near.camera_from_model
    guess = np.asarray(cv2.Rodrigues(place.rotation)[0]), place.translation.reshape(3, 1).copy()
    is_solved, turn, shift, agreeing = cv2.solvePnPRansac(
        points, pixels, matrix, None, *guess, useExtrinsicGuess=True,
        reprojectionError=OUTLIER_PX, flags=cv2.SOLVEPNP_ITERATIVE,
    )  # fmt: skip
    if not is_solved or agreeing is None:
        return None, np.zeros(0, np.intp)
    chosen = agreeing[:, 0].astype(np.intp)
    turn, shift = cv2.solvePnPRefineLM(points[chosen], pixels[chosen], matrix, None, turn, shift)
    rotation, shift = np.asarray(cv2.Rodrigues(turn)[0], float), np.asarray(shift, float)
    return Pose(camera, RigidTransform(rotation, shift.ravel())), chosen
