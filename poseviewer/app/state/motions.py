"""How a pose follows the pointer: moves, turns, rolls and scales, and pins that hold.

All points are in photo px with pixel centres at i + 0.5. The model's centre stays where it is in
the photo under every rotation.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.chart import LEAST_AXLE_COMPONENT, VehicleChart

LEAST_LEVER = 8.0
"""Rolls and scales are taken as if grabbed at least so many px from the centre."""
LARGEST_ZOOM = 20.0
"""One drag makes the model no more than so many times larger or smaller."""
STIFFNESS = 1e-2
"""px per unit of the free-body chart: what pins do not say is kept."""


def moved(pose: Pose, centre: ArrayLike, delta: ArrayLike) -> Pose:
    """The pose whose model ``centre`` (3,) lies ``delta`` (2,) px further, at the same depth."""
    return with_point_at(pose, centre, pose.project(centre) + np.asarray(delta, dtype=float))


def turned(pose: Pose, centre: ArrayLike, rotation_vector: ArrayLike) -> Pose:
    """The pose rotated about ``centre`` (3,) by an axis times an angle (3,), in camera axes."""
    turn = Rotation.from_rotvec(np.array(rotation_vector, dtype=float)).as_matrix()
    rotation = turn @ pose.camera_from_model.rotation
    fixed = pose.camera_from_model.apply(centre)
    translation = fixed - rotation @ np.asarray(centre, dtype=float)
    return replace(pose, camera_from_model=RigidTransform(rotation, translation))


def trackball(
    pose: Pose, centre: ArrayLike, radius: float, start: ArrayLike, end: ArrayLike
) -> Pose:
    """The pose rotated as if a ball of ``radius`` px about ``centre`` were dragged.

    Beyond the ball's rim its surface goes over into a hyperbola (G. Bell's trackball), so that
    there is no jump.
    """
    middle = pose.project(centre)
    first, second = (_on_trackball((np.asarray(p) - middle) / radius) for p in (start, end))
    axis = np.cross(first, second)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return pose
    return turned(pose, centre, axis / sine * math.atan2(sine, float(first @ second)))


def rolled_and_scaled(pose: Pose, centre: ArrayLike, start: ArrayLike, end: ArrayLike) -> Pose:
    """Rolled about the line of sight, and brought nearer or farther, so that ``start`` is seen at
    ``end``.
    """
    middle = pose.project(centre)
    before, after = np.asarray(start) - middle, np.asarray(end) - middle
    lever, reach = (max(float(np.linalg.norm(v)), LEAST_LEVER) for v in (before, after))
    angle = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
    if float(np.linalg.norm(before)) < LEAST_LEVER:
        angle = 0.0  # no direction to speak of
    zoom = min(max(reach / lever, 1.0 / LARGEST_ZOOM), LARGEST_ZOOM)
    return scaled_about(rolled(pose, centre, angle), centre, zoom)


def rolled(pose: Pose, centre: ArrayLike, angle: float) -> Pose:
    """Rolled by ``angle`` (rad), clockwise in the photo, about the line of sight of ``centre``."""
    sight = np.array([0.0, 0.0, 1.0])
    if not isinstance(pose.camera, Parallel):
        sight = pose.camera_from_model.apply(centre)
    return turned(pose, centre, angle * sight / np.linalg.norm(sight))


def scaled_about(pose: Pose, centre: ArrayLike, zoom: float) -> Pose:
    """``zoom`` times as large in the photo, about the image of ``centre``: by scale, or depth."""
    pixel, camera = pose.project(centre), pose.camera
    if isinstance(camera, Parallel):
        pose = replace(pose, camera=replace(camera, scale=camera.scale * zoom))
        return with_point_at(pose, centre, pixel)
    at = pose.camera_from_model.apply(centre)
    shift = at / zoom - at
    transform = pose.camera_from_model
    return replace(
        pose,
        camera_from_model=RigidTransform(transform.rotation, transform.translation + shift),
    )


def radius_in_photo(pose: Pose, mesh: Mesh) -> float:
    """The model's radius about its centre, in px of the photo; nan behind the camera."""
    at = pose.camera_from_model.apply(mesh.centre)
    aside = at + np.array([mesh.diameter / 2.0, 0.0, 0.0])
    return float(np.linalg.norm(pose.camera.project(aside) - pose.camera.project(at)))


def pinned(mesh: Mesh, pose: Pose, points: ArrayLike, pixels: ArrayLike) -> Pose:
    """The pose nearest to ``pose`` that shows model ``points`` (k, 3) at ``pixels`` (k, 2).

    One pin moves the model; two turn and scale it as well; three fix it. Least squares in the
    free-body chart, with a faint pull towards the pose as it is.
    """
    points, pixels = np.atleast_2d(points), np.atleast_2d(pixels)
    if len(points) == 1:
        return with_point_at(pose, points[0], pixels[0])
    chart = FreeBodyChart.near(mesh, pose)

    def residuals(parameters: FloatArray) -> FloatArray:
        try:
            seen = chart.to_pose(parameters).project(points)
        except OutsideChartError:
            seen = np.full(pixels.shape, 1e6)
        away = np.nan_to_num(seen - pixels, nan=1e6)
        return np.append(away.ravel(), STIFFNESS * parameters)

    found = least_squares(residuals, np.zeros(len(chart.names)), method="lm", max_nfev=200)
    return chart.to_pose(found.x)


def vehicle_pins(chart: VehicleChart, parameters: FloatArray) -> FloatArray:
    """(3, 2): rear wheel, front wheel and axle tip in px: the vehicle chart's six numbers.

    The tip lies ``axle_length`` times psi from the rear wheel.
    """
    size = np.array([chart.camera.width, chart.camera.height])
    rear = parameters[0:2] * size
    return np.array(
        [rear, rear + parameters[2:4] * size, rear + parameters[4:6] * axle_length(chart)]
    )


def with_vehicle_pin(
    chart: VehicleChart, parameters: FloatArray, pin: int, pixel: ArrayLike
) -> FloatArray:
    """The chart's numbers with one pin (0 rear, 1 front, 2 tip) at ``pixel``, the others held.

    An axle that would point away from the camera stays at the rim of what the chart allows.
    """
    pins = vehicle_pins(chart, parameters)
    pins[pin] = pixel
    size = np.array([chart.camera.width, chart.camera.height])
    psi = (pins[2] - pins[0]) / axle_length(chart)
    rim = math.sqrt(1.0 - LEAST_AXLE_COMPONENT**2) - 1e-6
    psi *= min(1.0, rim / max(float(np.linalg.norm(psi)), 1e-12))
    changed = np.array(parameters)
    if pin != 2:
        changed[0:2] = pins[0] / size
        changed[2:4] = (pins[1] - pins[0]) / size
    if pin != 1:
        changed[4:6] = psi
    return changed


def axle_length(chart: VehicleChart) -> float:
    """Length in px at which a whole unit of psi is drawn: fixed for a photo, so that one pin's
    place says nothing about another's.
    """
    return 0.25 * min(chart.camera.width, chart.camera.height)


def _on_trackball(point: FloatArray) -> FloatArray:
    """The unit vector towards a point of the trackball, in camera axes, in radii."""
    square = float(point @ point)
    depth = math.sqrt(1.0 - square) if square <= 0.5 else 0.5 / math.sqrt(square)
    vector = np.array([point[0], point[1], -depth])
    return vector / np.linalg.norm(vector)


def with_point_at(pose: Pose, point: ArrayLike, pixel: ArrayLike) -> Pose:
    """Moved parallel to the photo until the model's ``point`` is seen at ``pixel``."""
    camera, transform = pose.camera, pose.camera_from_model
    at, pixel = transform.apply(point), np.asarray(pixel, dtype=float)
    if isinstance(camera, Parallel):
        place = np.append((pixel - np.array([camera.cx, camera.cy])) / camera.scale, at[2])
    else:
        place = camera.rays(pixel) * at[2]
    return replace(
        pose,
        camera_from_model=RigidTransform(transform.rotation, transform.translation + place - at),
    )
