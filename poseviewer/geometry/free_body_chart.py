"""A chart for any object: small motions about a start pose, in comparable units.

Numbers: a rotation vector about the model's centre in camera axes (rad), a shift of that centre in
the picture (in units of the model's radius there), a logarithm of depth or scale, and optionally
one of the focal length. A change of 0.01 in any of them moves the picture of the model's rim by
about 1 % of the model's radius in the picture; the focal number is stretched to do the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.errors import SettingsError, SingularChartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform

LARGEST_LOGARITHM = 20.0
"""Numbers beyond it stand for no pose: e^20 is any photo's whole range of scales."""

_NUMBERS = ("rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y")


@dataclass(frozen=True, slots=True)
class FreeBodyChart:
    """Six numbers, or seven with the focal length, that are all 0 at the start pose."""

    start: Pose
    centre: FloatArray
    """(3,): the model's centre, in its frame."""
    radius: float
    """Of the model about its centre, in its unit."""
    free_focal: bool = False

    @classmethod
    def near(cls, mesh: Mesh, pose: Pose, free_focal: bool = False) -> FreeBodyChart:
        """The chart of the poses of ``mesh`` about ``pose``.

        Raises:
            SingularChartError: the model's centre is behind the camera.
            SettingsError: a focal length is to be found under parallel projection.
        """
        if free_focal and isinstance(pose.camera, Parallel):
            raise SettingsError(
                "a parallel projection has no focal length to find; start from a perspective pose"
            )
        if isinstance(pose.camera, Perspective) and _centre_depth(pose, mesh.centre) <= 0.0:
            raise SingularChartError(
                "the model's centre is behind the camera; a start pose must show the model"
            )
        return cls(pose, mesh.centre, mesh.diameter / 2.0, free_focal)

    @property
    def name(self) -> str:
        """The chart's name in pose files."""
        return "free-body"

    @property
    def names(self) -> tuple[str, ...]:
        """What each number is called."""
        size = "log_scale" if isinstance(self.start.camera, Parallel) else "log_depth"
        return (*_NUMBERS, size, *(("log_focal",) if self.free_focal else ()))

    def spans(self, numbers: FloatArray) -> FloatArray:
        """100 % is 1: a radian, a radius, a factor e."""
        return np.ones(len(numbers))

    def to_pose(self, numbers: FloatArray) -> Pose:
        """The pose that lies ``numbers`` away from the start."""
        numbers = np.array(numbers, dtype=float)  # scipy takes no read-only rotation vector
        logarithms = numbers[5:] * np.array([1.0, self._focal_gain()])[: len(numbers) - 5]
        if not (np.all(np.isfinite(numbers)) and np.all(np.abs(logarithms) <= LARGEST_LOGARITHM)):
            raise OutsideChartError(f"numbers {numbers} out of all proportion")
        camera, start = self.start.camera, self.start.camera_from_model
        rotation = Rotation.from_rotvec(numbers[:3]).as_matrix() @ start.rotation
        centre = start.apply(self.centre)
        shift = numbers[3:5] * self._radius_px()
        if isinstance(camera, Parallel):
            camera = replace(camera, scale=camera.scale * float(np.exp(numbers[5])))
            origin = np.array([camera.cx, camera.cy])
            place = self.start.camera.project(centre) + shift
            centre = np.append((place - origin) / camera.scale, centre[2])
        else:
            pixel = camera.project(centre) + shift
            zoom = float(np.exp(numbers[6] * self._focal_gain())) if self.free_focal else 1.0
            camera = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
            centre = camera.rays(pixel) * (centre[2] * zoom * np.exp(numbers[5]))
        return Pose(camera, RigidTransform(rotation, centre - rotation @ self.centre))

    def from_pose(self, pose: Pose) -> FloatArray:
        """How far a pose lies from the start."""
        start, now = self.start.camera_from_model, pose.camera_from_model
        turn = Rotation.from_matrix(now.rotation @ start.rotation.T).as_rotvec()
        centre, was = now.apply(self.centre), start.apply(self.centre)
        if isinstance(pose.camera, Perspective) and centre[2] <= 0.0:
            raise SingularChartError("the model's centre is behind the camera")
        camera, first = pose.camera, self.start.camera
        shift = (camera.project(centre) - first.project(was)) / self._radius_px()
        if isinstance(camera, Parallel) and isinstance(first, Parallel):
            return np.array([*turn, *shift, np.log(camera.scale / first.scale)])
        if not (isinstance(camera, Perspective) and isinstance(first, Perspective)):
            raise SettingsError("a free-body chart does not change the projection")
        zoom = camera.fx / first.fx if self.free_focal else 1.0
        numbers = [*turn, *shift, np.log(centre[2] / was[2] / zoom)]
        if self.free_focal:
            numbers.append(np.log(zoom) / self._focal_gain())
        return np.array(numbers)

    def _radius_px(self) -> FloatArray:
        """(2,): the model's radius in the picture at the start, along u and v."""
        camera = self.start.camera
        if isinstance(camera, Parallel):
            return np.full(2, camera.scale * self.radius)
        depth = _centre_depth(self.start, self.centre)
        return np.array([camera.fx, camera.fy]) * self.radius / depth

    def _focal_gain(self) -> float:
        """Depth over radius: a change of the focal length, with the depth to match, moves the
        picture by so many times less than a change of scale does.
        """
        if isinstance(self.start.camera, Parallel):
            return 1.0
        return max(_centre_depth(self.start, self.centre) / self.radius, 1.0)


def _centre_depth(pose: Pose, centre: FloatArray) -> float:
    return float(pose.camera_from_model.apply(centre)[2])
