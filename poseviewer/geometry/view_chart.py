"""The pose of a model in each view of a set, by the same numbers.

The free-body chart of one view, the reference, moves the model. Each camera of unknown focal length
adds its logarithm, which changes all photos of that camera and no place. Where the set's scale is
not known, one number more makes the model larger about its centre, which stays where it is among
the cameras; as poses are in the model's unit, it is all cameras that then come nearer.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.charts import Chart, OutsideChartError
from poseviewer.geometry.free_body_chart import MAX_LOGARITHM, FreeBodyChart
from poseviewer.geometry.transform import RigidTransform

SIZE: Literal["log_size"] = "log_size"


@dataclass(frozen=True, slots=True)
class ViewChart(Chart):
    """Six numbers, those of focal lengths, and the model's size, for its poses in one view."""

    name = "view-set"
    reference: FreeBodyChart
    """About the start, in the view that the numbers are of."""
    camera: Perspective
    """This view's."""
    view_from_reference: RigidTransform
    """Motion between the cameras, in the model's unit, as large as it is at the start."""
    free_size: bool = False
    scale: float = 1.0
    """At the start: how many lengths of the model's unit one of the set's is."""
    free_focals: int = 0
    """Number of cameras whose focal length is searched for; 0: all are known."""
    focal_index: int = 0
    """Which of them is this view's."""

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter."""
        focals = (f"log_focal_{number}" for number in range(2, self.free_focals + 1))
        focals = ("log_focal", *focals) if self.free_focals else ()
        return (*self.reference.names, *focals, *((SIZE,) if self.free_size else ()))

    def distance_factor(self, parameters: FloatArray) -> float:
        """Distance of all cameras over that at the start; raises ``OutsideChartError``."""
        log_size = float(parameters[-1]) if self.free_size else 0.0
        return _exp(-log_size)

    def scale_at(self, parameters: FloatArray) -> float:
        """The scale of the set by these numbers; raises as ``nearness``."""
        return self.scale * self.distance_factor(parameters)

    def parameters_at(self, pose: Pose, scale: float) -> FloatArray:
        """The numbers of a pose in this view at a scale of the set; raises as ``from_pose``."""
        factor, place = scale / self.scale, pose.camera_from_model
        middle = place.apply(self.reference.centre) / factor
        start = RigidTransform(place.rotation, middle - place.rotation @ self.reference.centre)
        numbers = self.from_pose(Pose(pose.camera, start))
        if self.free_size:
            numbers[-1] = -math.log(factor)
        return numbers

    def to_pose(self, parameters: FloatArray) -> Pose:
        """The pose in this view."""
        factor, camera = self.distance_factor(parameters), self.camera
        if self.free_focals:
            zoom = _exp(float(parameters[6 + self.focal_index]))
            camera = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
        own = self.reference.to_pose(parameters[:6]).camera_from_model
        turn, shift = self.view_from_reference.rotation, self.view_from_reference.translation
        middle = turn @ own.apply(self.reference.centre) * factor + factor * shift
        if middle[2] <= 0.0:
            raise OutsideChartError("the model's centre is behind the camera of a view")
        rotation = turn @ own.rotation
        place = RigidTransform(rotation, middle - rotation @ self.reference.centre)
        return Pose(camera, place)

    def from_pose(self, pose: Pose) -> FloatArray:
        """The numbers of a pose in this view, with size and other focal lengths as at the start."""
        place = self.view_from_reference.inverse() @ pose.camera_from_model
        numbers = np.zeros(len(self.names))
        numbers[:6] = self.reference.from_pose(Pose(self.reference.start.camera, place))
        if self.free_focals and isinstance(pose.camera, Perspective):
            numbers[6 + self.focal_index] = math.log(pose.camera.fx / self.camera.fx)
        return numbers


def _exp(logarithm: float) -> float:
    """Raises ``OutsideChartError``: out of all proportion."""
    if not abs(logarithm) <= MAX_LOGARITHM:
        raise OutsideChartError(f"a factor of e^{logarithm:g} is out of all proportion")
    return math.exp(logarithm)
