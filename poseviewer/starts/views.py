"""Views of a model, spread evenly or on level ground, and poses that fill a rectangle."""

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints, model_axes

GROUND_STEP_DEG = 10.0
"""Azimuth between views of a vehicle."""
ELEVATIONS_DEG = (-2.0, 6.0, 14.0, 24.0, 36.0)
"""Elevations of photos of cars: from a kneeling person's to those from a first floor."""
ROLLS_DEG = (-6.0, 0.0, 6.0)
"""Rolls of a camera that is held nearly level."""
CORRECTIONS = 3
"""Rounds after a guess that takes the model for flat: each leaves a tenth of the error."""
MIN_CAMERA_DISTANCE = 0.55
"""Smallest distance of the camera from the model's centre, in diameters."""


def sample_rotations(count: int) -> FloatArray:
    """Return rotations (count, 3, 3) spread evenly over SO(3), the same each time.

    M. Alexa, *Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3)* (CVPR 2022).
    """
    step = np.arange(count) + 0.5
    share = step / count
    a = 2.0 * math.pi * step / math.sqrt(2.0)
    b = 2.0 * math.pi * step / 1.533751168755204288118041
    inner, outer = np.sqrt(share), np.sqrt(1.0 - share)
    parts = inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)
    return Rotation.from_quat(np.column_stack(parts)).as_matrix()


def ground_views(keypoints: VehicleKeypoints) -> FloatArray:
    """Return rotations (n, 3, 3) of a vehicle on level ground, seen from all around."""
    azimuths = np.radians(np.arange(0.0, 360.0, GROUND_STEP_DEG))
    rolls = Rotation.from_rotvec([[0.0, 0.0, roll] for roll in np.radians(ROLLS_DEG)]).as_matrix()
    pairs = product(azimuths, np.radians(ELEVATIONS_DEG))
    return np.concatenate([rolls @ ground_view(keypoints, *angles) for angles in pairs])


def ground_view(keypoints: VehicleKeypoints, azimuth: float, elevation: float) -> FloatArray:
    """Return the upright rotation (3, 3) from a direction, rad from its right towards its back."""
    right, behind, up = model_axes(keypoints)
    level = math.cos(azimuth) * right + math.sin(azimuth) * behind
    return look_along(-(math.cos(elevation) * level + math.sin(elevation) * up), up)


def look_along(forward: FloatArray, up: FloatArray) -> FloatArray:
    """Return the axes (3, 3) of a camera that looks along one unit vector, another one upwards."""
    down = -(up - (up @ forward) * forward)
    down = down / np.linalg.norm(down)
    return np.stack([np.cross(down, forward), down, forward])


@dataclass(frozen=True, slots=True, eq=False)
class ViewPoses:
    """Poses whose outline fills a rectangle, and how badly each outline has its shape."""

    poses: tuple[Pose, ...]
    aspect_errors: FloatArray
    """(n,): absolute logarithm of the outline's aspect ratio over the rectangle's."""


def poses_filling(
    box: Rectangle, rotations: FloatArray, points: FloatArray, centre: FloatArray, camera: Camera
) -> ViewPoses:
    """Make a pose of each rotation, about the viewing ray to the rectangle's middle.

    The outline has the rectangle's middle and, by the geometric mean of width and height, its size.

    Args:
        box: the rectangle.
        rotations: (n, 3, 3).
        points: (k, 3), the model's outermost.
        centre: (3,), of the model.
        camera: camera of the photo.
    """
    if isinstance(camera, Perspective):
        to_ray = Rotation.align_vectors([camera.rays(box.centre)], [(0.0, 0.0, 1.0)])[0]
        rotations = to_ray.as_matrix() @ rotations
    # Under parallel projection any depth will do.
    depth = 4.0 * float(np.linalg.norm(points - centre, axis=1).max())
    at, sizes = _fill(box, (points - centre) @ np.swapaxes(rotations, 1, 2), camera)
    poses = _poses(rotations, at, centre, camera, depth)
    aspect_errors = np.log(sizes[:, 0] / sizes[:, 1]) - np.log(box.width / box.height)
    return ViewPoses(tuple(poses), np.abs(aspect_errors))


def _fill(box: Rectangle, about: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Return centres (n, 3), z the depth or scale, and outline sizes of points (n, k, 3) about."""
    flat = np.ptp(about[..., :2], axis=1)
    scale = np.sqrt(box.width * box.height / np.maximum(flat.prod(axis=1), 1e-300))
    middle = (about[..., :2].max(axis=1) + about[..., :2].min(axis=1)) / 2.0
    target = np.array(box.centre)
    if isinstance(camera, Parallel):
        at = (target - [camera.cx, camera.cy]) / scale[:, None] - middle
        return np.column_stack([at, scale]), flat * scale[:, None]
    focal = np.array([camera.fx, camera.fy])
    nearest = 2.0 * MIN_CAMERA_DISTANCE * np.linalg.norm(about, axis=2).max(axis=1)
    depth = np.maximum(np.sqrt(focal.prod()) / scale, nearest)
    pixel = target - middle * focal / depth[:, None]
    for _ in range(CORRECTIONS):
        low, high = _outlines(pixel, depth, about, camera)
        size = high - low
        larger = np.sqrt(size.prod(axis=1) / (box.width * box.height))
        depth = np.maximum(depth * larger, nearest)
        pixel = pixel + target - (low + high) / 2.0
    low, high = _outlines(pixel, depth, about, camera)
    return camera.points_at(pixel, depth), high - low


def _outlines(
    pixel: FloatArray, depth: FloatArray, about: FloatArray, camera: Perspective
) -> tuple[FloatArray, FloatArray]:
    """Return the corners (n, 2) of outlines of points (n, k, 3) about centres at a pixel."""
    focal, principal = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    at = (pixel - principal) / focal * depth[:, None]
    z = about[..., 2] + depth[:, None]
    outlines = (about[..., :2] + at[:, None]) / z[..., None] * focal + principal
    return outlines.min(axis=1), outlines.max(axis=1)


def _poses(
    rotations: FloatArray, centres: FloatArray, centre: FloatArray, camera: Camera, depth: float
) -> list[Pose]:
    poses, scaled = [], camera
    for rotation, at in zip(rotations, centres, strict=True):
        if isinstance(camera, Parallel):
            scaled, at = replace(camera, scale=float(at[2])), np.array([*at[:2], depth])
        poses.append(Pose(scaled, RigidTransform(rotation, at - rotation @ centre)))
    return poses
