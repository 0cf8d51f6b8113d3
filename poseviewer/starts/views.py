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
RISES_DEG = (-2.0, 6.0, 14.0, 24.0, 36.0)
"""From the ground, at which cars are photographed: from a kneeling person's to a first floor's."""
ROLLS_DEG = (-6.0, 0.0, 6.0)
CORRECTIONS = 3
"""The first guess takes the model for flat; each correction leaves a tenth of what is wrong."""
MIN_DISTANCE = 0.55
"""Least distance of the camera from the model's centre, in diameters."""


def even_rotations(count: int) -> FloatArray:
    """(count, 3, 3): rotations spread evenly over all there are, the same each time.

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
    """(n, 3, 3): a vehicle on level ground, seen from all around by a camera held nearly level."""
    turns, rises = np.radians(np.arange(0.0, 360.0, GROUND_STEP_DEG)), np.radians(RISES_DEG)
    rolls = Rotation.from_rotvec([[0.0, 0.0, roll] for roll in np.radians(ROLLS_DEG)]).as_matrix()
    pairs = product(turns, rises)
    return np.concatenate([rolls @ ground_view(keypoints, turn, rise) for turn, rise in pairs])


def ground_view(keypoints: VehicleKeypoints, turn: float, rise: float) -> FloatArray:
    """(3, 3): camera from model, upright, ``turn`` rad from its right to its back, ``rise`` up."""
    right, behind, up = model_axes(keypoints)
    level = math.cos(turn) * right + math.sin(turn) * behind
    return look_along(-(math.cos(rise) * level + math.sin(rise) * up), up)


def look_along(forward: FloatArray, up: FloatArray) -> FloatArray:
    """(3, 3): the axes of a camera that looks along one unit vector (3,), another one upwards."""
    down = -(up - (up @ forward) * forward)
    down = down / np.linalg.norm(down)
    return np.stack([np.cross(down, forward), down, forward])


@dataclass(frozen=True, slots=True, eq=False)
class ViewPoses:
    """Poses whose outline fills a rectangle, and how badly each outline has its shape."""

    poses: tuple[Pose, ...]
    aspect_errors: FloatArray
    """(n,): the absolute logarithm of the outline's aspect ratio over the rectangle's."""


def poses_filling(
    box: Rectangle, rotations: FloatArray, points: FloatArray, centre: FloatArray, camera: Camera
) -> ViewPoses:
    """A pose for each of ``rotations`` (n, 3, 3), upright about the line of sight to the rectangle.

    ``points`` (k, 3) are the model's outermost, ``centre`` (3,) its centre. The outline has the
    rectangle's middle and, by the geometric mean of width and height, its size.
    """
    if isinstance(camera, Perspective):
        to_sight = Rotation.align_vectors([camera.rays(box.centre)], [(0.0, 0.0, 1.0)])[0]
        rotations = to_sight.as_matrix() @ rotations
    # Under parallel projection any depth will do.
    depth = 4.0 * float(np.linalg.norm(points - centre, axis=1).max())
    places, sizes = _place(box, (points - centre) @ np.swapaxes(rotations, 1, 2), camera)
    poses = _poses(rotations, places, centre, camera, depth)
    aspect_errors = np.log(sizes[:, 0] / sizes[:, 1]) - np.log(box.width / box.height)
    return ViewPoses(tuple(poses), np.abs(aspect_errors))


def _place(box: Rectangle, turned: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Centre (n, 3), its last depth or scale, and outline size (n, 2) px, of points (n, k, 3)."""
    flat = np.ptp(turned[..., :2], axis=1)
    scale = np.sqrt(box.width * box.height / np.maximum(flat.prod(axis=1), 1e-300))
    middle = (turned[..., :2].max(axis=1) + turned[..., :2].min(axis=1)) / 2.0
    wanted = np.array(box.centre)
    if isinstance(camera, Parallel):
        at = (wanted - [camera.cx, camera.cy]) / scale[:, None] - middle
        return np.column_stack([at, scale]), flat * scale[:, None]
    focal = np.array([camera.fx, camera.fy])
    nearest = 2.0 * MIN_DISTANCE * np.linalg.norm(turned, axis=2).max(axis=1)
    depth = np.maximum(np.sqrt(focal.prod()) / scale, nearest)
    pixel = wanted - middle * focal / depth[:, None]
    for _ in range(CORRECTIONS):
        low, high = _corners(pixel, depth, turned, camera)
        size = high - low
        larger = np.sqrt(size.prod(axis=1) / (box.width * box.height))
        depth = np.maximum(depth * larger, nearest)
        pixel = pixel + wanted - (low + high) / 2.0
    low, high = _corners(pixel, depth, turned, camera)
    return camera.points_at(pixel, depth), high - low


def _corners(
    pixel: FloatArray, depth: FloatArray, turned: FloatArray, camera: Perspective
) -> tuple[FloatArray, FloatArray]:
    """Corners (n, 2) each of outlines of points (n, k, 3) about centres at ``pixel``, ``depth``."""
    focal, principal = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    at = (pixel - principal) / focal * depth[:, None]
    z = turned[..., 2] + depth[:, None]
    outlines = (turned[..., :2] + at[:, None]) / z[..., None] * focal + principal
    return outlines.min(axis=1), outlines.max(axis=1)


def _poses(
    rotations: FloatArray, places: FloatArray, centre: FloatArray, camera: Camera, depth: float
) -> list[Pose]:
    poses = []
    for rotation, place in zip(rotations, places, strict=True):
        lens = camera
        if isinstance(camera, Parallel):
            lens, place = replace(camera, scale=float(place[2])), np.array([*place[:2], depth])
        poses.append(Pose(lens, RigidTransform(rotation, place - rotation @ centre)))
    return poses
