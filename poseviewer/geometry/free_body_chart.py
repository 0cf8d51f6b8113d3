"""A chart for any object: small motions about a start pose, in comparable units.

Parameters: a rotation vector about the model's centre in camera axes (rad), a translation of that
centre in the picture (in units of the model's radius there), a logarithm of depth or scale, and
optionally one of the focal length, and an offset of the principal point (in focal lengths), with
which the model turns to face the camera as before. A change of 0.01 moves the picture of the
model's rim by about 1 % of its radius there; the camera's parameters are stretched to do the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import PRINCIPAL_POINT, Chart, OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform, rotation_about

MAX_LOGARITHM = 20.0
"""Largest logarithm of depth, scale or focal length: e^20 is any photo's whole range of scales."""
MAX_PARAMETER = 1e9
"""Largest value of the others: beyond it rotations lose their direction, translations digits."""

_MOTIONS = ("rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y")


@dataclass(frozen=True, slots=True)
class FreeBodyChart(Chart):
    """Six parameters, those of focal length and principal point, all 0 at the start pose."""

    name = "free-body"
    start: Pose
    centre: FloatArray
    """(3,): the model's centre, in its frame."""
    radius: float
    """Radius of the model about its centre, in its unit."""
    free_focal: bool = False
    free_principal_point: bool = False
    _centre_px: tuple[float, float] = field(init=False, repr=False, compare=False)
    _depth: float = field(init=False, repr=False, compare=False)
    _radius_px: tuple[float, float] = field(init=False, repr=False, compare=False)
    """Centre (px), its depth, and the model's radius (px along u and v) at the start."""
    focal_gain: float = field(init=False, repr=False, compare=False)
    """Depth over radius: a focal length, with depth to match, moves the picture so much less."""

    def __post_init__(self) -> None:
        camera, centre = self.start.camera, self.start.camera_from_model.apply(self.centre)
        depth, gain = float(centre[2]), 1.0
        if isinstance(camera, Parallel):
            radius_px = (camera.scale * self.radius, camera.scale * self.radius)
        else:
            radius_px = (camera.fx * self.radius / depth, camera.fy * self.radius / depth)
            gain = max(depth / self.radius, 1.0)
        object.__setattr__(self, "_centre_px", tuple(camera.project(centre).tolist()))
        object.__setattr__(self, "_depth", depth)
        object.__setattr__(self, "_radius_px", radius_px)
        object.__setattr__(self, "focal_gain", gain)

    @classmethod
    def near(
        cls, mesh: Mesh, pose: Pose, free_focal: bool = False, free_principal_point: bool = False
    ) -> FreeBodyChart:
        """Make the chart about a pose.

        Args:
            mesh: the model.
            pose: the start, at which all parameters are 0.
            free_focal: whether the focal length is a parameter.
            free_principal_point: whether the principal point adds two.

        Raises:
            SingularChartError: the pose does not show the model.
            SettingsError: a focal length is wanted under parallel projection.
        """
        if free_focal and isinstance(pose.camera, Parallel):
            raise SettingsError(
                "a parallel projection has no focal length to find; start from a perspective pose"
            )
        centre = pose.camera_from_model.apply(mesh.centre)
        if not np.isfinite(centre * mesh.diameter).all():
            raise SingularChartError("the model's place or size is out of all proportion")
        if isinstance(pose.camera, Perspective) and centre[2] <= 0.0:
            raise SingularChartError(
                "the model's centre is behind the camera; a start pose must show the model"
            )
        return cls(pose, mesh.centre, mesh.diameter / 2.0, free_focal, free_principal_point)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter."""
        size = "log_scale" if isinstance(self.start.camera, Parallel) else "log_depth"
        focal = ("log_focal",) if self.free_focal else ()
        return (*_MOTIONS, size, *focal, *(PRINCIPAL_POINT if self.free_principal_point else ()))

    def to_pose(self, parameters: FloatArray) -> Pose:
        """Return the pose that is ``parameters`` (d,) off the start."""
        values = np.asarray(parameters, dtype=float).tolist()
        log_zoom = values[6] * self.focal_gain if self.free_focal else 0.0
        is_sound = all(abs(value) <= MAX_PARAMETER for value in values)  # False for nan, too
        if not (is_sound and max(abs(values[5]), abs(log_zoom)) <= MAX_LOGARITHM):
            raise OutsideChartError(f"parameters {parameters} out of all proportion")
        camera = self.start.camera
        offset = [value * self.focal_gain for value in values[-2:]]
        rotation = rotation_about(*values[:3]) @ self._rotation_at(*offset)
        u = self._centre_px[0] + values[3] * self._radius_px[0]
        v = self._centre_px[1] + values[4] * self._radius_px[1]
        if isinstance(camera, Parallel):
            scale = camera.scale * math.exp(values[5])
            camera = Parallel(scale, camera.cx, camera.cy, camera.width, camera.height)
            centre = ((u - camera.cx) / scale, (v - camera.cy) / scale, self._depth)
        else:
            zoom = math.exp(log_zoom)
            if self.free_principal_point:
                cx, cy = camera.cx + offset[0] * camera.fx, camera.cy + offset[1] * camera.fy
                camera = replace(camera, cx=cx, cy=cy)
            if self.free_focal:
                camera = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
            depth = self._depth * zoom * math.exp(values[5])
            x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
            centre = (x * depth, y * depth, depth)
        return Pose(camera, RigidTransform(rotation, np.array(centre) - rotation @ self.centre))

    def from_pose(self, pose: Pose) -> FloatArray:
        """Return the parameters (d,) of a pose, its motion from the start."""
        start, end = self.start.camera_from_model, pose.camera_from_model
        centre, centre_at_start = end.apply(self.centre), start.apply(self.centre)
        if isinstance(pose.camera, Perspective) and centre[2] <= 0.0:
            raise SingularChartError("the model's centre is behind the camera")
        camera, first = pose.camera, self.start.camera
        offset = [0.0, 0.0]
        if isinstance(first, Perspective):
            offset = [(camera.cx - first.cx) / first.fx, (camera.cy - first.cy) / first.fy]
        seen = self._rotation_at(*offset)
        rotation = Rotation.from_matrix(end.rotation @ seen.T).as_rotvec()
        translation = (camera.project(centre) - first.project(centre_at_start)) / self._radius_px
        if isinstance(camera, Parallel) and isinstance(first, Parallel):
            return np.array([*rotation, *translation, np.log(camera.scale / first.scale)])
        if not (isinstance(camera, Perspective) and isinstance(first, Perspective)):
            raise SettingsError("a free-body chart does not change the projection")
        zoom = camera.fx / first.fx if self.free_focal else 1.0
        log_depth = np.log(centre[2] / centre_at_start[2] / zoom)
        focal = [np.log(zoom) / self.focal_gain] if self.free_focal else []
        principal = np.divide(offset, self.focal_gain) if self.free_principal_point else []
        return np.array([*rotation, *translation, log_depth, *focal, *principal])

    def _rotation_at(self, x: float, y: float) -> FloatArray:
        """Return the start's rotation, seen as before by a principal point off by focal lengths."""
        rotation = self.start.camera_from_model.rotation
        if not self.free_principal_point:
            return rotation
        return rotation_about(math.atan(y), -math.atan(x), 0.0) @ rotation
