"""The paper's pose of a vehicle: two wheel centres in the photo and the direction of the axle.

``theta = (mu_x, mu_y, delta_x, delta_y, psi_x, psi_y)``: mu is the visible rear wheel centre,
delta the vector from it to the front wheel centre, both divided by the photo's width and height;
psi is the unit axle direction, outwards on the visible side, in the camera frame, with
``psi_z = -sqrt(1 - psi_x^2 - psi_y^2)``. The wheelbase w is perpendicular to psi, so

- *parallel*: with delta in px, ``w_z = -(psi_x d_x + psi_y d_y) / psi_z``, and the scale is
  ``|(d_x, d_y, w_z)|`` over the wheelbase;
- *perspective*: with wheel rays r_1, r_2, ``z_2 (r_2 . psi) = z_1 (r_1 . psi)``, and the known
  wheelbase ``|z_2 r_2 - z_1 r_1|`` fixes both depths.

A seventh parameter frees the focal length (the paper's distance from the camera to the projection
plane): ``width / focal length``, which at 0 is the parallel projection. Two more free the principal
point: its offset from the start's, over the photo's width and height; the wheels stay in the photo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from poseviewer.errors import SingularChartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import (
    Camera,
    Parallel,
    Perspective,
    Pose,
    offset_principal,
    principal_offset,
)
from poseviewer.geometry.charts import PRINCIPAL_POINT, Chart, OutsideChartError
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.vehicle_keypoints import SideKeypoints, VehicleKeypoints

MIN_AXLE_COMPONENT = 0.05
"""Smallest part of the unit axle along the viewing ray: the chart is singular below, as two wheels
and an axle do not fix the pose of a car seen within 3 degrees of head-on."""
PARALLEL_BELOW = 1e-5
"""``width / focal length`` below which the projection is parallel: 64 m for 640 px of 1 um."""

Vector = tuple[float, float, float]
"""A direction or a point as plain numbers: quicker than NumPy with three."""

_SYMBOLS = ("mu_x", "mu_y", "delta_x", "delta_y", "psi_x", "psi_y")


@dataclass(frozen=True, slots=True)
class VehicleChart(Chart):
    """Six parameters, those of focal length and principal point, for one side of a vehicle."""

    name = "vehicle"
    side: SideKeypoints
    camera: Camera
    """Known intrinsics; parallel cameras give the picture size and the principal point only."""
    free_focal: bool = False
    depth: float = 0.0
    """Depth given to the rear wheel under parallel projection, where no photo can tell it."""
    free_principal_point: bool = False
    _wheelbase: float = field(init=False, repr=False, compare=False)
    _side_from_model: FloatArray = field(init=False, repr=False, compare=False)
    """(3, 3): rows along the wheelbase, along the axle, and across both."""

    def __post_init__(self) -> None:
        along = (self.side.front_wheel - self.side.rear_wheel) / self.side.wheelbase
        side = np.stack([along, self.side.axle, np.cross(along, self.side.axle)])
        object.__setattr__(self, "_wheelbase", self.side.wheelbase)
        object.__setattr__(self, "_side_from_model", side)

    @classmethod
    def near(
        cls,
        keypoints: VehicleKeypoints,
        pose: Pose,
        free_focal: bool = False,
        free_principal_point: bool = False,
    ) -> VehicleChart:
        """Make the chart of the side that the camera sees.

        Args:
            keypoints: the wheels of both sides.
            pose: a pose near those that are looked for.
            free_focal: whether the focal length is a parameter.
            free_principal_point: whether the principal point adds two.

        Raises:
            SingularChartError: the vehicle is seen head-on.
        """
        side = visible_side(keypoints, pose)
        depth = 4.0 * side.wheelbase
        if isinstance(pose.camera, Parallel):
            depth = float(pose.camera_from_model.apply(side.rear_wheel)[2])
        chart = cls(side, pose.camera, free_focal, depth, free_principal_point)
        chart.from_pose(pose)
        return chart

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the paper's symbols, and of the camera's parameters."""
        names = (*_SYMBOLS, "width_per_focal") if self.free_focal else _SYMBOLS
        return (*names, *PRINCIPAL_POINT) if self.free_principal_point else names

    def scales(self, parameters: FloatArray) -> FloatArray:
        """Return the wheelbase's length in the photo for mu and delta, 1 for the others."""
        size = np.array([self.camera.width, self.camera.height])
        length = np.linalg.norm(parameters[2:4] * size) / size
        return np.concatenate([length, length, np.ones(len(parameters) - 4)])

    def to_pose(self, parameters: FloatArray) -> Pose:
        """Return the pose of the parameters (d,), in closed form."""
        values = np.asarray(parameters, dtype=float).tolist()
        psi_x, psi_y = values[4], values[5]
        in_plane = psi_x * psi_x + psi_y * psi_y
        is_outside = in_plane > 1.0 - MIN_AXLE_COMPONENT**2
        if is_outside or not all(map(math.isfinite, values)):
            raise OutsideChartError(f"psi {parameters[4:6]} leaves no axle towards the camera")
        axle = (psi_x, psi_y, -math.sqrt(1.0 - in_plane))
        camera = self._camera_at(values)
        width, height = camera.width, camera.height
        u, v = values[0] * width - camera.cx, values[1] * height - camera.cy
        x, y = values[2] * width, values[3] * height
        if isinstance(camera, Perspective):
            rear_xy, delta_xy = (u / camera.fx, v / camera.fy), (x / camera.fx, y / camera.fy)
            return Pose(camera, self._transform(*self._wheels_on(rear_xy, delta_xy, axle), axle))
        along = (x, y, -(psi_x * x + psi_y * y) / axle[2])
        scale = math.hypot(*along) / self._wheelbase
        if not scale > 0.0:
            raise OutsideChartError("both wheels at the same point")
        rear = u / scale, v / scale, self.depth
        return Pose(replace(camera, scale=scale), self._transform(along, rear, axle))

    def from_pose(self, pose: Pose) -> FloatArray:
        """Return the parameters of a pose; its focal length counts only where that is free."""
        camera_from_model = pose.camera_from_model
        rear, front = camera_from_model.apply([self.side.rear_wheel, self.side.front_wheel])
        axle = camera_from_model.rotation @ self.side.axle
        if isinstance(pose.camera, Perspective) and min(rear[2], front[2]) <= 0.0:
            raise SingularChartError("the vehicle's wheels are not both in front of the camera")
        towards = -max(axle[2], *_along_rays(self.side, pose))
        if towards < MIN_AXLE_COMPONENT:
            raise SingularChartError(
                f"the vehicle is seen almost head-on or from straight behind (axle component "
                f"{towards:.3f} along the view, at least {MIN_AXLE_COMPONENT} wanted), where "
                f"the vehicle chart is singular"
            )
        size = np.array([pose.camera.width, pose.camera.height])
        rear_px, front_px = pose.camera.project([rear, front])
        parameters = [*rear_px / size, *(front_px - rear_px) / size, axle[0], axle[1]]
        if self.free_focal:
            focal = pose.camera.fx if isinstance(pose.camera, Perspective) else math.inf
            parameters.append(pose.camera.width / focal)
        if self.free_principal_point:
            parameters += principal_offset(self.camera, pose.camera)
        return np.array(parameters)

    def _camera_at(self, values: list[float]) -> Camera:
        camera = self.camera
        if self.free_principal_point:
            camera = offset_principal(camera, *values[-2:])
        if not self.free_focal:
            return camera
        width_per_focal = values[6]
        if width_per_focal < PARALLEL_BELOW:
            return Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        fx = camera.width / width_per_focal
        if isinstance(camera, Perspective):
            return replace(camera, fx=fx, fy=fx * camera.fy / camera.fx)
        return Perspective(fx, fx, camera.cx, camera.cy, camera.width, camera.height)

    def _wheels_on(
        self, rear: tuple[float, float], delta: tuple[float, float], axle: Vector
    ) -> tuple[Vector, Vector]:
        """Return the wheelbase's direction, and the rear wheel, on viewing rays at z = 1."""
        (x1, y1), (dx, dy) = rear, delta
        x2, y2 = x1 + dx, y1 + dy
        towards = x1 * axle[0] + y1 * axle[1] + axle[2], x2 * axle[0] + y2 * axle[1] + axle[2]
        lengths = math.hypot(x1, y1, 1.0), math.hypot(x2, y2, 1.0)
        if max(towards[0] / lengths[0], towards[1] / lengths[1]) > -MIN_AXLE_COMPONENT:
            raise OutsideChartError("a wheel is seen edge-on or from inside")
        ratio = towards[0] / towards[1]
        along = (x2 * ratio - x1, y2 * ratio - y1, ratio - 1.0)
        depth = self._wheelbase / max(math.hypot(*along), 1e-300)
        if not depth < 1e100:
            raise OutsideChartError("both wheels at the same point")
        return along, (depth * x1, depth * y1, depth)

    def _transform(self, along: Vector, rear: Vector, axle: Vector) -> RigidTransform:
        """Return the transform of wheelbase and axle to directions, and of a wheel to ``rear``."""
        length = math.hypot(*along)
        x, y, z = (component / length for component in along)
        a, b, c = axle
        columns = np.array([[x, a, y * c - z * b], [y, b, z * a - x * c], [z, c, x * b - y * a]])
        rotation = columns @ self._side_from_model
        return RigidTransform(rotation, np.array(rear) - rotation @ self.side.rear_wheel)


def visible_side(keypoints: VehicleKeypoints, pose: Pose) -> SideKeypoints:
    """Return the side whose outward axle points more towards the camera."""
    sides = keypoints.left, keypoints.right
    return min(sides, key=lambda side: float(np.mean(_along_rays(side, pose))))


def _along_rays(side: SideKeypoints, pose: Pose) -> FloatArray:
    """Return the axle's components (k,) along the viewing rays of both wheels, or of all points."""
    axle = pose.camera_from_model.rotation @ side.axle
    if isinstance(pose.camera, Parallel):
        return axle[2:]
    wheels = pose.camera_from_model.apply([side.rear_wheel, side.front_wheel])
    return wheels @ axle / np.linalg.norm(wheels, axis=1)
