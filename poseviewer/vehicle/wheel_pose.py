"""A vehicle's pose from the ellipses of its two visible wheels (Hutter and Brewer, *Matching 2-D
ellipses to 3-D circles with application to vehicle pose estimation*, 2009).

One wheel leaves two directions of the axle. Least squares over the pose and the wheels' radius,
from each of them, fits both circles to their ellipses: well near the true one alone, as the nearer
wheel looks larger. From far away the two are mirror images: then the car is taken to be seen from
above its axles.
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
MAX_RIM_ERROR = 0.1
"""Greatest distance of a rim's points from their ellipse, as a share of its longer half axis."""
MIN_FLATNESS = 0.02
"""Shorter over longer half axis: what is below it is a line."""


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
            raise QuickStartError(
                f"An ellipse with half axes {self.a:g} and {self.b:g} px is none; both must be "
                "above 0 px."
            )
        if self.b > self.a:
            turned = {"a": self.b, "b": self.a, "angle": self.angle + math.pi / 2.0}
            for name, value in turned.items():
                object.__setattr__(self, name, value)
        if self.b < MIN_FLATNESS * self.a:
            raise QuickStartError(
                f"An ellipse of {self.a:.0f} by {self.b:.2g} px is a wheel seen edge-on, which "
                "gives no pose; use point pairs."
            )

    def outline(self, count: int = 48) -> FloatArray:
        """(count, 2): points on it, all around."""
        t = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
        return np.column_stack([np.cos(t), np.sin(t)]) @ self._axes().T + [self.cx, self.cy]

    def distances(self, points: ArrayLike) -> FloatArray:
        """(n,): Sampson's distance of photo points (n, 2), about px outside (inside: below 0)."""
        # Where the ellipse is the unit circle.
        away = np.asarray(points, dtype=float) - [self.cx, self.cy]
        unit = away @ np.linalg.inv(self._axes()).T
        value = np.sum(unit**2, axis=1) - 1.0
        gradient = 2.0 * np.linalg.norm(unit / [self.a, self.b], axis=1)
        return value / np.maximum(gradient, 1e-9)

    def _axes(self) -> FloatArray:
        """(2, 2): half axes as columns."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[self.a * c, -self.b * s], [self.a * s, self.b * c]])


def ellipse_through(points: ArrayLike) -> Ellipse:
    """The ellipse through or near points (n, 2) on a rim, n at least 5.

    A. Fitzgibbon, M. Pilu, R. Fisher, *Direct least square fitting of ellipses*, 1999 (OpenCV's).

    Raises ``QuickStartError``: too few points, or no ellipse is near all of them.
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
    place = middle + size * np.array([x, y])
    half = 0.5 * size * width, 0.5 * size * height
    ellipse = Ellipse(float(place[0]), float(place[1]), *half, math.radians(degrees))
    error = float(np.abs(ellipse.distances(points)).max())
    if not error <= MAX_RIM_ERROR * ellipse.a:
        raise QuickStartError(
            f"No ellipse runs near all of these {len(points)} points ({error:.0f} px off at best); "
            "click points of one rim, all around it."
        )
    return ellipse


RIM_POINTS = 24
MAX_WHEEL_ERROR = 0.15
"""Largest error of two wheels of this car, by the smaller one's radius (of a disk of its area)."""
MIN_RADIUS, MAX_RADIUS = 0.04, 0.4
"""Bounds of a wheel's radius, in wheelbases: from a hub cap to a tractor's tyre."""
AS_GOOD, AS_GOOD_PX = 1.5, 0.5
"""An answer is as good as the best one within this factor, or these px, of its error."""
SAME_TURN = 0.02
"""Answers whose rotations differ by less in every entry are one."""
OUT_OF_REACH_PX = 1e4  # the error of numbers that are no pose


class Wheels(NamedTuple):
    """The outlines of a vehicle's visible wheels: of both tyres, or of both rims."""

    rear: Ellipse
    front: Ellipse


@dataclass(frozen=True, slots=True, eq=False)
class WheelFit:
    """A pose, and how well it shows the wheels."""

    pose: Pose
    radius: float
    """Radius of the wheels' outlines, in the model's unit."""
    error_px: float
    """Root of the mean squared distance of the wheels' circles from their ellipses."""
    from_above: bool
    """Whether the camera stands above the plane of the axles."""


def poses_from_wheels(
    wheels: Wheels, keypoints: VehicleKeypoints, camera: Camera
) -> tuple[WheelFit, ...]:
    """The upright poses that show the wheels best, the likeliest first; of a parallel ``camera``
    the scale is found. Raises ``QuickStartError``: no pose shows the wheels as these ellipses.
    """
    fits, up = [], model_axes(keypoints)[2]
    for side, axle in product((keypoints.left, keypoints.right), _axles(wheels, camera)):
        with suppress(OutsideChartError):
            fits.append(_fitted(side, axle, wheels, up, camera))
    fits.sort(key=lambda fit: fit.error_px)
    limit = MAX_WHEEL_ERROR * min(math.sqrt(wheel.a * wheel.b) for wheel in wheels)
    if not fits or not fits[0].error_px <= limit:
        best = f"{fits[0].error_px:.0f} px off at best" if fits else "no upright car"
        raise QuickStartError(
            f"No pose of this model shows its wheels as these two ellipses ({best}); check which "
            "is the rear wheel, and that both outline the same part of a wheel."
        )
    turn = attrgetter("pose.camera_from_model.rotation")
    worst = max(AS_GOOD * fits[0].error_px, fits[0].error_px + AS_GOOD_PX)
    good = non_maximum_suppression(
        (fit for fit in fits if fit.error_px <= worst),
        lambda a, b: np.abs(turn(a) - turn(b)).max() <= SAME_TURN,
    )
    return tuple(sorted(good, key=lambda fit: not fit.from_above))  # stable: then by error


def _axles(wheels: Wheels, camera: Camera) -> list[FloatArray]:
    """(3,) each: two axles for each wheel, by its flatness, about the cosine of the tilt."""
    axles = []
    for wheel in wheels:
        flatness, turn = wheel.b / wheel.a, np.eye(3)
        if isinstance(camera, Perspective):
            sight = camera.rays((wheel.cx, wheel.cy))
            turn = Rotation.align_vectors([sight], [(0.0, 0.0, 1.0)])[0].as_matrix()
        across = math.sqrt(1.0 - flatness**2) * np.array(
            [-math.sin(wheel.angle), math.cos(wheel.angle), 0.0]
        )
        axles += [turn @ (tilt - [0.0, 0.0, flatness]) for tilt in (across, -across)]
    return axles


def _fitted(
    side: SideKeypoints, axle: FloatArray, wheels: Wheels, up: FloatArray, camera: Camera
) -> WheelFit:
    """The best upright pose of one side near an axle; raises ``OutsideChartError``: none is."""
    chart = VehicleChart(side, camera, depth=4.0 * side.wheelbase)

    def residuals(x: FloatArray) -> FloatArray:
        try:
            pose = chart.to_pose(x[:6])
        except OutsideChartError:
            return np.full(2 * RIM_POINTS, OUT_OF_REACH_PX)
        pairs = zip(wheels, wheel_rims(pose, side, math.exp(x[6])), strict=True)
        away = np.concatenate([wheel.distances(rim) for wheel, rim in pairs])
        return np.nan_to_num(away, nan=OUT_OF_REACH_PX)

    scale, start = [0.01, 0.01, 0.01, 0.01, 0.1, 0.1, 0.1], _start(chart, axle, wheels, up)
    end = least_squares(residuals, start, method="lm", x_scale=scale, max_nfev=400)
    pose, radius = chart.to_pose(end.x[:6]), math.exp(end.x[6])
    if not MIN_RADIUS <= radius / side.wheelbase <= MAX_RADIUS:
        raise OutsideChartError("not the radius of a wheel")
    towards = -pose.camera_from_model.apply(side.rear_wheel)
    if isinstance(pose.camera, Parallel):
        towards = np.array([0.0, 0.0, -1.0])
    error = math.sqrt(2.0 * end.cost / (2 * RIM_POINTS))
    return WheelFit(pose, radius, error, bool(_upright(pose, up) @ towards > 0.0))


def _upright(pose: Pose, up: FloatArray) -> FloatArray:
    """``up`` (3,) in the camera; raises ``OutsideChartError``: it points down."""
    up = pose.camera_from_model.rotation @ up
    if not up[1] < 0.0:
        raise OutsideChartError("the vehicle stands on its head")
    return up


def _start(chart: VehicleChart, axle: FloatArray, wheels: Wheels, up: FloatArray) -> FloatArray:
    """(7,): the chart's numbers, and the logarithm of the wheels' radius; raises as ``_fitted``."""
    size = np.array([chart.camera.width, chart.camera.height])
    rear, front = (np.array([wheel.cx, wheel.cy]) / size for wheel in wheels)
    parameters = np.array([*rear, *(front - rear), axle[0], axle[1]])
    pose = chart.to_pose(parameters)
    _upright(pose, up)
    px_per_unit = np.linalg.norm(wheel_rims(pose, chart.side, 1.0)[0] - rear * size, axis=1).max()
    if not 0.0 < px_per_unit < math.inf:
        raise OutsideChartError("a wheel reaches behind the camera")
    return np.append(parameters, math.log(wheels.rear.a / px_per_unit))


def wheel_rims(pose: Pose, side: SideKeypoints, radius: float) -> tuple[FloatArray, FloatArray]:
    """(RIM_POINTS, 2) each: where a pose shows the rear and the front wheel's outline."""
    along = (side.front_wheel - side.rear_wheel) / side.wheelbase
    across = np.cross(side.axle, along)
    t = np.linspace(0.0, 2.0 * math.pi, RIM_POINTS, endpoint=False)[:, None]
    circle = radius * (np.cos(t) * along + np.sin(t) * across)
    return pose.project(side.rear_wheel + circle), pose.project(side.front_wheel + circle)
