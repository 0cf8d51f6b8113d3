"""Chart of the poses of a model in all views of a set, by the same parameters.

The free-body chart of one view, the reference, moves the model. Each camera of unknown focal length
adds its logarithm, and each of unknown principal point its offset, which change all photos of that
camera and no pose. Where the set's scale is
not known, one more parameter makes the model larger about its centre, which stays where it is among
the cameras; as poses are in the model's unit, all cameras then come nearer.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose, offset_principal, principal_offset
from poseviewer.geometry.charts import PRINCIPAL_POINT, Chart, OutsideChartError
from poseviewer.geometry.free_body_chart import MAX_LOGARITHM, FreeBodyChart
from poseviewer.geometry.transform import RigidTransform

SIZE: Literal["log_size"] = "log_size"
"""Name of the logarithm of the model's size in a set of unknown scale."""


@dataclass(frozen=True, slots=True)
class ViewChart(Chart):
    """Six parameters, those of focal lengths, and the model's size, for its poses in one view."""

    name = "view-set"
    reference: FreeBodyChart
    """Chart about the start, in the reference view."""
    camera: Perspective
    """Camera of this view."""
    view_from_reference: RigidTransform
    """Motion between the cameras, in the model's unit, as large as it is at the start."""
    free_size: bool = False
    scale: float = 1.0
    """Lengths of the model's unit in one of the set's, at the start."""
    free_focals: int = 0
    """Number of cameras whose focal length is searched for; 0: all are known."""
    focal_index: int = 0
    """Index of this view's camera among them, and those of free principal points."""
    free_principal_points: int = 0
    """Number of cameras whose principal point is searched for; 0: all are known."""

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter."""
        focals = (f"log_focal_{number}" for number in range(2, self.free_focals + 1))
        focals = ("log_focal", *focals) if self.free_focals else ()
        ends = ("", *(f"_{number}" for number in range(2, self.free_principal_points + 1)))
        ends = ends[: self.free_principal_points]
        principals = (name + end for end in ends for name in PRINCIPAL_POINT)
        return (*self.reference.names, *focals, *principals, *((SIZE,) if self.free_size else ()))

    @property
    def principal_index(self) -> int:
        """Index of the principal point's x among the parameters; its y follows."""
        return 6 + self.free_focals + 2 * self.focal_index

    def scales(self, parameters: FloatArray) -> FloatArray:
        """Return the model's radius in the photo for principal points, 1 for the others."""
        scales, first = np.ones(len(parameters)), self.reference.start.camera
        if self.free_principal_points and isinstance(first, Perspective):
            radius = 1.0 / self.reference.focal_gain
            scales[6 + self.free_focals :][: 2 * self.free_principal_points] = np.tile(
                [radius * first.fx / first.width, radius * first.fy / first.height],
                self.free_principal_points,
            )
        return scales

    def distance_factor(self, parameters: FloatArray) -> float:
        """Return the distance of all cameras over that at the start.

        Raises:
            OutsideChartError: it is out of all proportion.
        """
        log_size = float(parameters[-1]) if self.free_size else 0.0
        return _exp(-log_size)

    def scale_at(self, parameters: FloatArray) -> float:
        """Return the scale of the set by these parameters.

        Raises:
            OutsideChartError: it is out of all proportion.
        """
        return self.scale * self.distance_factor(parameters)

    def parameters_at(self, pose: Pose, scale: float) -> FloatArray:
        """Return the parameters of a pose at a scale of the set.

        Raises:
            SingularChartError: there are none.
        """
        factor, transform = scale / self.scale, pose.camera_from_model
        centre = transform.apply(self.reference.centre) / factor
        translation = centre - transform.rotation @ self.reference.centre
        at_start_size = RigidTransform(transform.rotation, translation)
        parameters = self.from_pose(Pose(pose.camera, at_start_size))
        if self.free_size:
            parameters[-1] = -math.log(factor)
        return parameters

    def to_pose(self, parameters: FloatArray) -> Pose:
        """Return the pose in this view."""
        factor, camera = self.distance_factor(parameters), self.camera
        if self.free_focals:
            zoom = _exp(float(parameters[6 + self.focal_index]))
            camera = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
        if self.free_principal_points:
            camera = offset_principal(camera, *parameters[self.principal_index :][:2].tolist())
        in_reference = self.reference.to_pose(parameters[:6]).camera_from_model
        motion, centre = self.view_from_reference, in_reference.apply(self.reference.centre)
        centre = motion.rotation @ centre * factor + factor * motion.translation
        if centre[2] <= 0.0:
            raise OutsideChartError("the model's centre is behind the camera of a view")
        rotation = motion.rotation @ in_reference.rotation
        return Pose(camera, RigidTransform(rotation, centre - rotation @ self.reference.centre))

    def from_pose(self, pose: Pose) -> FloatArray:
        """Return the parameters of a pose; size and other cameras as at the start."""
        in_reference = self.view_from_reference.inverse() @ pose.camera_from_model
        parameters = np.zeros(len(self.names))
        parameters[:6] = self.reference.from_pose(Pose(self.reference.start.camera, in_reference))
        if self.free_focals and isinstance(pose.camera, Perspective):
            parameters[6 + self.focal_index] = math.log(pose.camera.fx / self.camera.fx)
        if self.free_principal_points:
            parameters[self.principal_index :][:2] = principal_offset(self.camera, pose.camera)
        return parameters


def _exp(logarithm: float) -> float:
    """Exponentiate.

    Raises:
        OutsideChartError: the factor is out of all proportion.
    """
    if not abs(logarithm) <= MAX_LOGARITHM:
        raise OutsideChartError(f"a factor of e^{logarithm:g} is out of all proportion")
    return math.exp(logarithm)
