"""The paper's pose of a vehicle: two wheel centres in the photo and the direction of the axle.

``theta = (mu_x, mu_y, delta_x, delta_y, psi_x, psi_y)``: mu is the visible rear wheel centre,
delta the vector from it to the front wheel centre, both divided by the photo's width and height;
psi is the unit axle direction, outwards on the visible side, in the camera frame, with
``psi_z = -sqrt(1 - psi_x^2 - psi_y^2)``. The wheelbase w is perpendicular to psi, so

- *parallel*: with delta in px, ``w_z = -(psi_x d_x + psi_y d_y) / psi_z``, and the scale is
  ``|(d_x, d_y, w_z)|`` over the wheelbase;
- *perspective*: with wheel rays r_1, r_2, ``z_2 (r_2 . psi) = z_1 (r_1 . psi)``, and the known
  wheelbase ``|z_2 r_2 - z_1 r_1|`` fixes both depths.

A seventh number frees the focal length (the paper's distance from the camera to the projection
plane): ``width / focal length``, which at 0 is the parallel projection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.errors import SingularChartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.vehicle import SideKeypoints, VehicleKeypoints

LEAST_AXLE_COMPONENT = 0.05
"""Where less of the unit axle than this lies along the line of sight, the chart is singular: the
car is seen within about 3 degrees of head-on, and two wheels and an axle no longer fix its pose."""
PARALLEL_BELOW = 1e-5
"""``width / focal length`` below this is parallel projection: 64 m of lens for 640 px of 1 um."""

_NUMBERS = ("mu_x", "mu_y", "delta_x", "delta_y", "psi_x", "psi_y")


@dataclass(frozen=True, slots=True)
class VehicleChart:
    """Six numbers, or seven with the focal length, for one side of a vehicle."""

    side: SideKeypoints
    camera: Camera
    """Known intrinsics; parallel cameras give the picture size and the principal point only."""
    free_focal: bool = False
    depth: float = 0.0
    """Depth given to the rear wheel under parallel projection, where no photo can tell it."""

    @classmethod
    def near(
        cls, keypoints: VehicleKeypoints, pose: Pose, free_focal: bool = False
    ) -> VehicleChart:
        """The chart for poses near ``pose``: of the side that the camera sees there.

        Raises:
            SingularChartError: the vehicle is seen (nearly) head-on or from straight behind.
        """
        side = visible_side(keypoints, pose)
        depth = 4.0 * side.wheelbase
        if isinstance(pose.camera, Parallel):
            depth = float(pose.camera_from_model.apply(side.rear_wheel)[2])
        chart = cls(side, pose.camera, free_focal, depth)
        chart.from_pose(pose)
        return chart

    @property
    def name(self) -> str:
        """The chart's name in pose files."""
        return "vehicle"

    @property
    def names(self) -> tuple[str, ...]:
        """The paper's symbols, and the seventh number."""
        return (*_NUMBERS, "width_per_focal") if self.free_focal else _NUMBERS

    def spans(self, numbers: FloatArray) -> FloatArray:
        """100 % is the wheelbase's length in the photo for mu and delta, 1 for psi and focal."""
        size = np.array([self.camera.width, self.camera.height])
        length = np.linalg.norm(numbers[2:4] * size) / size
        return np.concatenate([length, length, np.ones(len(numbers) - 4)])

    def to_pose(self, numbers: FloatArray) -> Pose:
        """The pose of six or seven numbers, in closed form."""
        numbers = np.asarray(numbers, dtype=float)
        in_plane = float(numbers[4] ** 2 + numbers[5] ** 2)
        if not np.all(np.isfinite(numbers)) or in_plane > 1.0 - LEAST_AXLE_COMPONENT**2:
            raise OutsideChartError(f"psi {numbers[4:6]} leaves no axle towards the camera")
        axle = np.array([numbers[4], numbers[5], -math.sqrt(1.0 - in_plane)])
        size = np.array([self.camera.width, self.camera.height])
        rear = numbers[0:2] * size
        front = rear + numbers[2:4] * size
        camera = self._camera_at(numbers)
        if isinstance(camera, Perspective):
            return self._perspective_pose(camera, rear, front, axle)
        return self._parallel_pose(camera, rear, front, axle)

    def from_pose(self, pose: Pose) -> FloatArray:
        """The numbers of a pose; its camera's focal length counts only where that is free."""
        camera_from_model = pose.camera_from_model
        rear, front = camera_from_model.apply([self.side.rear_wheel, self.side.front_wheel])
        axle = camera_from_model.rotation @ self.side.axle
        _require_regular(pose.camera, rear, front, axle)
        size = np.array([pose.camera.width, pose.camera.height])
        rear_px, front_px = pose.camera.project([rear, front])
        numbers = [*rear_px / size, *(front_px - rear_px) / size, axle[0], axle[1]]
        if self.free_focal:
            camera = pose.camera
            perspective = isinstance(camera, Perspective)
            numbers.append(camera.width / camera.fx if perspective else 0.0)
        return np.array(numbers)

    def _camera_at(self, numbers: FloatArray) -> Camera:
        if not self.free_focal:
            return self.camera
        width_per_focal, camera = float(numbers[6]), self.camera
        if width_per_focal < PARALLEL_BELOW:
            return Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
        fx = camera.width / width_per_focal
        if isinstance(camera, Perspective):
            return replace(camera, fx=fx, fy=fx * camera.fy / camera.fx)
        return Perspective(fx, fx, camera.cx, camera.cy, camera.width, camera.height)

    def _parallel_pose(
        self, camera: Parallel, rear: FloatArray, front: FloatArray, axle: FloatArray
    ) -> Pose:
        along = np.append(front - rear, -(axle[:2] @ (front - rear)) / axle[2])
        scale = float(np.linalg.norm(along)) / self.side.wheelbase
        if not scale > 0.0:
            raise OutsideChartError("both wheels at the same place")
        rotation = self._rotation(along, axle)
        xy = (rear - np.array([camera.cx, camera.cy])) / scale
        translation = np.append(xy, self.depth) - rotation @ self.side.rear_wheel
        return Pose(replace(camera, scale=scale), RigidTransform(rotation, translation))

    def _perspective_pose(
        self, camera: Perspective, rear: FloatArray, front: FloatArray, axle: FloatArray
    ) -> Pose:
        rays = camera.rays([rear, front])
        towards = rays @ axle
        if np.any(towards > -LEAST_AXLE_COMPONENT * np.linalg.norm(rays, axis=1)):
            raise OutsideChartError("a wheel is seen edge-on or from inside")
        along = rays[1] * (towards[0] / towards[1]) - rays[0]
        depth = self.side.wheelbase / max(float(np.linalg.norm(along)), 1e-300)
        if not depth < 1e100:
            raise OutsideChartError("both wheels at the same place")
        rotation = self._rotation(along, axle)
        translation = depth * rays[0] - rotation @ self.side.rear_wheel
        return Pose(camera, RigidTransform(rotation, translation))

    def _rotation(self, along: FloatArray, axle: FloatArray) -> FloatArray:
        """The rotation that takes the model's wheelbase and axle to these directions."""
        wheelbase = self.side.front_wheel - self.side.rear_wheel
        in_camera = _orthonormal(along / np.linalg.norm(along), axle)
        in_model = _orthonormal(wheelbase / self.side.wheelbase, self.side.axle)
        return in_camera @ in_model.T


def visible_side(keypoints: VehicleKeypoints, pose: Pose) -> SideKeypoints:
    """The side whose outward axle points more towards the camera."""

    def away(side: SideKeypoints) -> float:
        axle = pose.camera_from_model.rotation @ side.axle
        if isinstance(pose.camera, Parallel):
            return float(axle[2])
        wheels = pose.camera_from_model.apply([side.rear_wheel, side.front_wheel])
        return float(np.mean(wheels @ axle / np.linalg.norm(wheels, axis=1)))

    return min((keypoints.left, keypoints.right), key=away)


def _require_regular(camera: Camera, rear: FloatArray, front: FloatArray, axle: FloatArray) -> None:
    """The chart's numbers are well defined: the axle leans towards the camera, enough of it."""
    towards = [-float(axle[2])]
    if isinstance(camera, Perspective):
        if min(rear[2], front[2]) <= 0.0:
            raise SingularChartError("the vehicle's wheels are not both in front of the camera")
        towards += [-float(point @ axle / np.linalg.norm(point)) for point in (rear, front)]
    if min(towards) < LEAST_AXLE_COMPONENT:
        raise SingularChartError(
            f"the vehicle is seen almost head-on or from straight behind (axle component "
            f"{min(towards):.3f} along the view, at least {LEAST_AXLE_COMPONENT} wanted), where "
            f"the vehicle chart is singular"
        )


def _orthonormal(first: FloatArray, second: FloatArray) -> FloatArray:
    """(3, 3) with columns ``first``, ``second``, and their cross product; both are unit and
    perpendicular up to rounding.
    """
    return np.column_stack([first, second, np.cross(first, second)])
