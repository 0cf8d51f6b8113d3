"""A vehicle's pose from the ellipses of its two visible wheels (Hutter and Brewer, *Matching 2-D
ellipses to 3-D circles with application to vehicle pose estimation*, 2009).

One wheel leaves two directions of the axle, from which least squares over pose and wheel radius
fit the circles: well from the true one alone, but for cars far away, taken as seen from above.
"""

import math
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from operator import attrgetter
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.rectangle import non_maximum_suppression
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints, model_axes

MIN_RIM_POINTS = 5
"""Points that determine an ellipse."""
MAX_RIM_ERROR = 0.1
"""Largest distance of a rim's points from their ellipse, as a share of its longer half axis."""
MIN_FLATNESS = 0.02
"""Shorter over longer half axis: below it an ellipse is a line."""
RIM_POINTS = 24
"""Points of a wheel's circle that are compared with its ellipse."""
MAX_WHEEL_ERROR = 0.15
"""Largest error of two wheels of this car, by the smaller one's radius (of a disk of its area)."""
MIN_RADIUS = 0.04
"""Smallest radius of a wheel, in wheelbases: that of a hub cap."""
MAX_RADIUS = 0.4
"""Largest radius of a wheel, in wheelbases: that of a tractor's tyre."""
AS_GOOD = 1.5
"""Factor of the best answer's error within which another is as good."""
AS_GOOD_PX = 0.5
"""px beyond the best answer's error within which another is as good."""
SAME_ROTATION = 0.02
"""Largest difference between entries of rotations that count as equal."""
OUTSIDE_ERROR_PX = 1e4
"""Error of parameters that are no pose: larger than any photo."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse in px of the photo, pixel centres at i + 0.5."""

    cx: float
    cy: float
    a: float
    """Half axis along ``angle``, px; the longer one."""
    b: float
    """The other half axis, px."""
    angle: float
    """Radians from the u axis towards the v axis (clockwise as seen)."""

    def __post_init__(self) -> None:
        parameters = (self.cx, self.cy, self.a, self.b, self.angle)
        if not all(map(math.isfinite, parameters)) or min(self.a, self.b) <= 0.0:
            axes = f"half axes {self.a:g} and {self.b:g} px"
            raise QuickStartError(f"An ellipse with {axes} is none; both must be above 0 px.")
        if self.b > self.a:
            swapped = {"a": self.b, "b": self.a, "angle": self.angle + math.pi / 2.0}
            for name, value in swapped.items():
                object.__setattr__(self, name, value)
        if self.b < MIN_FLATNESS * self.a:
            raise QuickStartError(
                f"An ellipse of {self.a:.0f} by {self.b:.2g} px is a wheel seen edge-on, which "
                "gives no pose; use point pairs."
            )

    def outline(self, count: int = 48) -> FloatArray:
        """Return points (count, 2) of the ellipse, all around."""
        t = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
        return np.column_stack([np.cos(t), np.sin(t)]) @ self._axes().T + [self.cx, self.cy]

    def distances(self, points: ArrayLike) -> FloatArray:
        """Return Sampson's distances (n,) of photo points (n, 2), about px; below 0 inside."""
        # Where the ellipse is the unit circle.
        away = np.asarray(points, dtype=float) - [self.cx, self.cy]
        unit = away @ np.linalg.inv(self._axes()).T
        value = np.sum(unit**2, axis=1) - 1.0
        gradient = 2.0 * np.linalg.norm(unit / [self.a, self.b], axis=1)
        return value / np.maximum(gradient, 1e-9)

    def _axes(self) -> FloatArray:
        """Return the half axes (2, 2) as columns."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[self.a * c, -self.b * s], [self.a * s, self.b * c]])


def ellipse_through(points: ArrayLike) -> Ellipse:
    """Fit an ellipse to points (n, 2) on a rim, n at least 5.

    A. Fitzgibbon, M. Pilu, R. Fisher, *Direct least square fitting of ellipses*, 1999 (OpenCV's).

    Raises:
        QuickStartError: there are too few points, or no ellipse is near all of them.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    if len(np.unique(points, axis=0)) < MIN_RIM_POINTS:
        raise QuickStartError(
            f"{len(points)} points on the rim; an ellipse needs {MIN_RIM_POINTS} different ones."
        )
    middle = points.mean(axis=0)
    size = float(np.abs(points - middle).max())
    unit = ((points - middle) / size).astype(np.float32)
    (x, y), (width, height), degrees = cv2.fitEllipseDirect(unit)
    centre = middle + size * np.array([x, y])
    half = 0.5 * size * width, 0.5 * size * height
    ellipse = Ellipse(float(centre[0]), float(centre[1]), *half, math.radians(degrees))
    error = float(np.abs(ellipse.distances(points)).max())
    if not error <= MAX_RIM_ERROR * ellipse.a:
        raise QuickStartError(
            f"No ellipse runs near all of these {len(points)} points ({error:.0f} px off at best); "
            "click points of one rim, all around it."
        )
    return ellipse


class Wheels(NamedTuple):
    """Outlines of a vehicle's visible wheels: of both tyres, or of both rims."""

    rear: Ellipse
    front: Ellipse


@dataclass(frozen=True, slots=True, eq=False)
class WheelFit:
    """A pose, and how well it shows the wheels."""

    pose: Pose
    radius: float
    """Radius of the wheels' outlines, in the model's unit."""
    error_px: float
    """Root mean squared distance of the wheels' circles from their ellipses."""
    from_above: bool
    """Whether the camera stands above the plane of the axles."""


def poses_from_wheels(
    wheels: Wheels, keypoints: VehicleKeypoints, camera: Camera
) -> tuple[WheelFit, ...]:
    """Find the upright poses, and scales if parallel, that show the wheels best, likeliest first.

    Raises:
        QuickStartError: no pose shows the wheels as these ellipses.
    """
    fits, up = [], model_axes(keypoints)[2]
    for side, axle in product((keypoints.left, keypoints.right), _axles(wheels, camera)):
        with suppress(OutsideChartError):
            fits.append(_fit_side(side, axle, wheels, up, camera))
    fits.sort(key=lambda fit: fit.error_px)
    limit = MAX_WHEEL_ERROR * min(math.sqrt(wheel.a * wheel.b) for wheel in wheels)
    if not fits or not fits[0].error_px <= limit:
        best = f"{fits[0].error_px:.0f} px off at best" if fits else "no upright car"
        raise QuickStartError(
            f"No pose of this model shows its wheels as these two ellipses ({best}); check which "
            "is the rear wheel, and that both outline the same part of a wheel."
        )
    rotation = attrgetter("pose.camera_from_model.rotation")
    worst = max(AS_GOOD * fits[0].error_px, fits[0].error_px + AS_GOOD_PX)
    good = non_maximum_suppression(
        (fit for fit in fits if fit.error_px <= worst),
        lambda a, b: np.abs(rotation(a) - rotation(b)).max() <= SAME_ROTATION,
    )
    return tuple(sorted(good, key=lambda fit: not fit.from_above))  # stable: then by error


def _axles(wheels: Wheels, camera: Camera) -> list[FloatArray]:
    """Return two axles (3,) for each wheel, by its flatness, about the cosine of the tilt."""
    axles = []
    for wheel in wheels:
        flatness, rotation = wheel.b / wheel.a, np.eye(3)
        if isinstance(camera, Perspective):
            ray = camera.rays((wheel.cx, wheel.cy))
            rotation = Rotation.align_vectors([ray], [(0.0, 0.0, 1.0)])[0].as_matrix()
        across = math.sqrt(1.0 - flatness**2) * np.array(
            [-math.sin(wheel.angle), math.cos(wheel.angle), 0.0]
        )
        axles += [rotation @ (tilt - [0.0, 0.0, flatness]) for tilt in (across, -across)]
    return axles


def _fit_side(
    side: SideKeypoints, axle: FloatArray, wheels: Wheels, up: FloatArray, camera: Camera
) -> WheelFit:
    """Fit the upright pose of one side near an axle.

    Raises:
        OutsideChartError: there is none.
    """
    chart = VehicleChart(side, camera, depth=4.0 * side.wheelbase)

    def residuals(x: FloatArray) -> FloatArray:
        try:
            pose = chart.to_pose(x[:6])
        except OutsideChartError:
            return np.full(2 * RIM_POINTS, OUTSIDE_ERROR_PX)
        pairs = zip(wheels, wheel_rims(pose, side, math.exp(x[6])), strict=True)
        distances = np.concatenate([wheel.distances(rim) for wheel, rim in pairs])
        return np.nan_to_num(distances, nan=OUTSIDE_ERROR_PX)

    scale = [0.01, 0.01, 0.01, 0.01, 0.1, 0.1, 0.1]
    start = _start(chart, axle, wheels, up)
    end = least_squares(residuals, start, method="lm", x_scale=scale, max_nfev=400)
    pose, radius = chart.to_pose(end.x[:6]), math.exp(end.x[6])
    if not MIN_RADIUS <= radius / side.wheelbase <= MAX_RADIUS:
        raise OutsideChartError("not the radius of a wheel")
    towards = -pose.camera_from_model.apply(side.rear_wheel)
    if isinstance(pose.camera, Parallel):
        towards = np.array([0.0, 0.0, -1.0])
    error = math.sqrt(2.0 * end.cost / (2 * RIM_POINTS))
    return WheelFit(pose, radius, error, bool(_up_in_camera(pose, up) @ towards > 0.0))


def _up_in_camera(pose: Pose, up: FloatArray) -> FloatArray:
    """Return ``up`` (3,) in the camera.

    Raises:
        OutsideChartError: it points down.
    """
    up = pose.camera_from_model.rotation @ up
    if not up[1] < 0.0:
        raise OutsideChartError("the vehicle stands on its head")
    return up


def _start(chart: VehicleChart, axle: FloatArray, wheels: Wheels, up: FloatArray) -> FloatArray:
    """Return the chart's parameters and the logarithm of the radius (7,).

    Raises:
        OutsideChartError: the vehicle stands on its head, or a wheel reaches behind the camera.
    """
    size = np.array([chart.camera.width, chart.camera.height])
    rear, front = (np.array([wheel.cx, wheel.cy]) / size for wheel in wheels)
    parameters = np.array([*rear, *(front - rear), axle[0], axle[1]])
    pose = chart.to_pose(parameters)
    _up_in_camera(pose, up)
    px_per_unit = np.linalg.norm(wheel_rims(pose, chart.side, 1.0)[0] - rear * size, axis=1).max()
    if not 0.0 < px_per_unit < math.inf:
        raise OutsideChartError("a wheel reaches behind the camera")
    return np.append(parameters, math.log(wheels.rear.a / px_per_unit))


def wheel_rims(pose: Pose, side: SideKeypoints, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return where a pose shows the outlines of rear and front wheel, (RIM_POINTS, 2) each."""
    along = (side.front_wheel - side.rear_wheel) / side.wheelbase
    across = np.cross(side.axle, along)
    t = np.linspace(0.0, 2.0 * math.pi, RIM_POINTS, endpoint=False)[:, None]
    circle = radius * (np.cos(t) * along + np.sin(t) * across)
    return pose.project(side.rear_wheel + circle), pose.project(side.front_wheel + circle)
