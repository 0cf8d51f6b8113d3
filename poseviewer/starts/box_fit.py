"""Where a model lies whose outline fills a rectangle of the photo, for each of many rotations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.transform import RigidTransform, rotation_about

CORRECTIONS = 3
"""The first guess takes the model for flat; each correction leaves a tenth of what is wrong."""
NEAREST = 0.55
"""Of the model's diameter: its centre is no nearer to the camera."""
CHUNK = 256
"""Rotations at a time, which bounds the memory."""


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle in a photo, px."""

    left: float
    top: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Of its right side, px."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Of its lower side, px."""
        return self.top + self.height

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle (u, v)."""
        return self.left + self.width / 2.0, self.top + self.height / 2.0

    def grown(self, share: float) -> Box:
        """The rectangle about the same middle, longer by ``share`` along each side."""
        width, height = self.width * (1.0 + share), self.height * (1.0 + share)
        u, v = self.centre
        return Box(u - width / 2.0, v - height / 2.0, width, height)


@dataclass(frozen=True, slots=True, eq=False)
class BoxFits:
    """Poses whose outline fills a rectangle, and how badly each outline has its shape."""

    poses: tuple[Pose, ...]
    misshapen: FloatArray
    """(n,): the absolute logarithm of the outline's aspect ratio over the rectangle's."""


def box_of(pose: Pose, points: FloatArray) -> Box:
    """The rectangle about ``points`` (k, 3) of the model in the photo, px."""
    seen = pose.project(points)
    low, high = seen.min(axis=0), seen.max(axis=0)
    return Box(float(low[0]), float(low[1]), *(float(side) for side in high - low))


def fit_box(
    box: Box, rotations: FloatArray, points: FloatArray, centre: FloatArray, camera: Camera
) -> BoxFits:
    """A pose for each of ``rotations`` (n, 3, 3), which are as seen along the line of sight through
    the rectangle's middle: 'upright' is upright anywhere in the photo.

    ``points`` (k, 3) are all that the model's outline depends on (``hull_points``), and ``centre``
    (3,) is its centre, both in its frame. The outline has the rectangle's middle and, by the
    geometric mean of width and height, its size.
    """
    if isinstance(camera, Perspective):
        rotations = _towards(camera, box) @ rotations
    # Under parallel projection any depth will do.
    depth = 4.0 * float(np.linalg.norm(points - centre, axis=1).max())
    chunks = [rotations[at : at + CHUNK] for at in range(0, len(rotations), CHUNK)]
    poses: list[Pose] = []
    misshapen: list[FloatArray] = []
    for chunk in chunks:
        turned = (points - centre) @ np.swapaxes(chunk, 1, 2)
        places, sizes = _place(box, turned, camera)
        poses += _poses(chunk, places, centre, camera, depth)
        wanted = np.log(box.width / box.height)
        misshapen.append(np.abs(np.log(sizes[:, 0] / sizes[:, 1]) - wanted))
    return BoxFits(tuple(poses), np.concatenate(misshapen))


def _towards(camera: Perspective, box: Box) -> FloatArray:
    """(3, 3): the least rotation that takes the optical axis to the rectangle's middle."""
    ray = camera.rays(box.centre)
    ray = ray / np.linalg.norm(ray)
    axis = np.cross([0.0, 0.0, 1.0], ray)
    sine = float(np.linalg.norm(axis))
    turn = axis * (np.arctan2(sine, ray[2]) / sine) if sine > 0.0 else axis
    return rotation_about(*turn.tolist())


def _place(box: Box, turned: FloatArray, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """The centre's place (n, 3), in depth or, in parallel projection, scale, last; and the
    outline's width and height (n, 2), px; of points (n, k, 3) about the centre, in camera axes.
    """
    flat = np.ptp(turned[..., :2], axis=1)
    scale = np.sqrt(box.width * box.height / np.maximum(flat.prod(axis=1), 1e-300))
    middle = (turned[..., :2].max(axis=1) + turned[..., :2].min(axis=1)) / 2.0
    wanted = np.array(box.centre)
    if isinstance(camera, Parallel):
        at = (wanted - [camera.cx, camera.cy]) / scale[:, None] - middle
        return np.column_stack([at, scale]), flat * scale[:, None]
    focal = np.array([camera.fx, camera.fy])
    nearest = 2.0 * NEAREST * np.linalg.norm(turned, axis=2).max(axis=1)
    depth = np.maximum(np.sqrt(focal.prod()) / scale, nearest)
    pixel = wanted - middle * focal / depth[:, None]
    for _ in range(CORRECTIONS):
        low, high = _seen(pixel, depth, turned, camera)
        size = high - low
        larger = np.sqrt(size.prod(axis=1) / (box.width * box.height))
        depth = np.maximum(depth * larger, nearest)
        pixel = pixel + wanted - (low + high) / 2.0
    low, high = _seen(pixel, depth, turned, camera)
    at = (pixel - [camera.cx, camera.cy]) / focal * depth[:, None]
    return np.column_stack([at, depth]), high - low


def _seen(
    pixel: FloatArray, depth: FloatArray, turned: FloatArray, camera: Perspective
) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners (n, 2) of the outlines of points (n, k, 3) about centres seen at
    ``pixel`` (n, 2), px, in ``depth`` (n,).
    """
    focal, principal = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    at = (pixel - principal) / focal * depth[:, None]
    z = turned[..., 2] + depth[:, None]
    seen = (turned[..., :2] + at[:, None]) / z[..., None] * focal + principal
    return seen.min(axis=1), seen.max(axis=1)


def _poses(
    rotations: FloatArray, places: FloatArray, centre: FloatArray, camera: Camera, depth: float
) -> list[Pose]:
    found = []
    for rotation, place in zip(rotations, places, strict=True):
        lens = camera
        if isinstance(camera, Parallel):
            lens, place = replace(camera, scale=float(place[2])), np.array([*place[:2], depth])
        found.append(Pose(lens, RigidTransform(rotation, place - rotation @ centre)))
    return found
