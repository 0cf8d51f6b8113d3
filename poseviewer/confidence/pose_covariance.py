"""Covariance of a pose in its tangent space.

A deviation d turns the model about its centre, then shifts it, both along the camera's axes::

    x_in_camera = exp(d_rotation) R (x - centre) + R centre + t + d_shift

Under parallel projection the logarithm of the scale stands for the shift in depth. A free focal
length adds its logarithm, and so does the model's size in a set of unknown scale, where the pose in
this photo stays and the other cameras come nearer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from poseviewer.geometry.arrays import FloatArray, frozen_array
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import Chart
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import SIZE, ViewChart

REGION = 0.9
"""Share of the distribution within its region, an ellipsoid."""
STEP = 1e-5
"""Share of a number's scale for differences: above rounding, below any curvature."""
LARGEST_LOGARITHM = 20.0
"""Greatest logarithm of scale and focal length; beyond it there is no photo."""
FOCAL = ("log_focal", "width_per_focal")
"""Charts' names for a free focal length."""
ROTATIONS = ("rotation_x", "rotation_y", "rotation_z")


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """A normal distribution of poses about one."""

    pose: Pose
    centre: FloatArray
    """(3,): the point that turns are about, in the model's frame."""
    matrix: FloatArray
    """(d, d), read-only, symmetric; d is 6, or 7 with the ``seventh``. In rad, the model's unit,
    and logarithms, in the order of ``names``; 0 where a number was held."""
    px: float = 0.0
    """Root mean square distance in the photo, over the distribution and the model's outer points,
    from where the pose shows them."""
    seventh: Literal["log_focal", "log_size"] = "log_focal"
    """Meaning of the last of seven numbers: focal length, or size of the model in its set."""

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, dtype=float)
        size = len(matrix) if len(matrix) in (6, 7) else 6
        object.__setattr__(self, "centre", frozen_array(self.centre, (3,)))
        matrix = frozen_array(matrix, (size, size))
        object.__setattr__(self, "matrix", frozen_array(0.5 * (matrix + matrix.T), (size, size)))

    @classmethod
    def from_chart(
        cls, mesh: Mesh, pose: Pose, chart: Chart, covariance: FloatArray
    ) -> PoseCovariance:
        """From the covariance (n, n) of a chart's numbers at ``pose``, to first order."""
        at = chart.from_pose(pose)
        plain = cls(pose, mesh.centre, np.zeros((7, 7) if has_focal(chart) else (6, 6)))
        jacobian = _derivatives(
            lambda steps: plain.deviation(chart.to_pose(at + steps)), chart.scales(at)
        )
        return plain.with_matrix(jacobian @ covariance @ jacobian.T, mesh)

    def with_matrix(self, matrix: FloatArray, mesh: Mesh) -> PoseCovariance:
        """Another distribution about the same pose of the same model."""
        found = replace(self, matrix=matrix)
        points = hull_points(mesh)
        moved = _derivatives(lambda d: found.moved(d).project(points).ravel(), found.scales)
        # The trace of J C J^T is the mean square distance of all points, each two rows of J.
        square = np.einsum("pi,ij,pj->", moved, found.matrix, moved) / len(points)
        return replace(found, px=math.sqrt(max(square, 0.0)))

    def about(self, equal: Pose) -> PoseCovariance:
        """The distribution about an equal pose of a symmetric model, turned about one point."""
        if equal is self.pose:
            return self
        centre = self.pose.camera_from_model.apply(self.centre)
        return replace(self, pose=equal, centre=equal.camera_from_model.inverse().apply(centre))

    def seen_from(self, view_from_this: RigidTransform, pose: Pose, mesh: Mesh) -> PoseCovariance:
        """Distribution about the ``pose`` in another view, whose camera stands at
        ``view_from_this``, in the model's unit.
        """
        turn = np.eye(len(self.matrix))
        turn[:3, :3] = turn[3:6, 3:6] = view_from_this.rotation
        if self.has_size:  # a larger model is nearer to this camera
            turn[3:6, 6] = -view_from_this.translation
        return replace(self, pose=pose).with_matrix(turn @ self.matrix @ turn.T, mesh)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each number of a deviation."""
        depth = "log_scale" if isinstance(self.pose.camera, Parallel) else "shift_z"
        names = (*ROTATIONS, "shift_x", "shift_y", depth)
        return (*names, self.seventh) if len(self.matrix) > 6 else names

    @property
    def has_focal(self) -> bool:
        """Whether the focal length is one of the numbers."""
        return len(self.matrix) > 6 and self.seventh == "log_focal"

    @property
    def has_size(self) -> bool:
        """Whether the model's size in its set is."""
        return len(self.matrix) > 6 and self.seventh == SIZE

    @cached_property
    def scales(self) -> FloatArray:
        """(d,): comparable changes: a radian, shifts as large as the depth or the photo's width."""
        camera = self.pose.camera
        if isinstance(camera, Parallel):
            shift = camera.width / camera.scale
            return np.array([1.0, 1.0, 1.0, shift, shift, 1.0])
        depth = abs(float(self.pose.camera_from_model.apply(self.centre)[2]))
        return np.array([1.0, 1.0, 1.0, depth, depth, depth, 1.0])[: len(self.matrix)]

    def moved(self, deviation: FloatArray) -> Pose:
        """The pose that is off by a ``deviation`` (d,)."""
        camera, place = self.pose.camera, self.pose.camera_from_model
        numbers = np.asarray(deviation, dtype=float)
        rotation = Rotation.from_rotvec(numbers[:3]).as_matrix() @ place.rotation
        middle = place.apply(self.centre) + np.array([numbers[3], numbers[4], 0.0])
        logarithms = np.clip(numbers, -LARGEST_LOGARITHM, LARGEST_LOGARITHM)
        if isinstance(camera, Parallel):
            camera = replace(camera, scale=camera.scale * math.exp(logarithms[5]))
        else:
            middle[2] += numbers[5]
            if self.has_focal:
                zoom = math.exp(logarithms[6])
                camera = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
        return Pose(camera, RigidTransform(rotation, middle - rotation @ self.centre))

    def deviation(self, pose: Pose) -> FloatArray:
        """(d,): how far a ``pose`` of the same projection is off; 0 in size."""
        here, there = self.pose.camera_from_model, pose.camera_from_model
        turn = Rotation.from_matrix(there.rotation @ here.rotation.T).as_rotvec()
        shift = there.apply(self.centre) - here.apply(self.centre)
        own, its = self.pose.camera, pose.camera
        if isinstance(own, Parallel) and isinstance(its, Parallel):
            return np.array([*turn, *shift[:2], math.log(its.scale / own.scale)])
        if self.has_focal and isinstance(own, Perspective) and isinstance(its, Perspective):
            return np.array([*turn, *shift, math.log(its.fx / own.fx)])
        return np.array([*turn, *shift, *([0.0] * self.has_size)])

    def in_chart(self, chart: Chart) -> FloatArray:
        """(n, n): covariance of a chart's numbers, to first order; nan for an unknown size."""

        def numbers(deviation: FloatArray) -> FloatArray:
            pose = self.moved(deviation)
            if self.has_size and isinstance(chart, ViewChart):
                return chart.numbers_at(pose, chart.scale * math.exp(-deviation[6]))
            return chart.from_pose(pose)

        jacobian = _derivatives(numbers, self.scales)
        found = jacobian @ self.matrix @ jacobian.T
        if isinstance(chart, ViewChart) and chart.free_size and not self.has_size:
            found[-1] = found[:, -1] = np.nan
        return found

    @property
    def degrees(self) -> float:
        """Standard deviation of the turn about the axis that is least sure, degrees."""
        return math.degrees(_largest(self.matrix[:3, :3]))

    @property
    def depth(self) -> float | None:
        """Standard deviation along the line of sight, model units; None in parallel projection."""
        if isinstance(self.pose.camera, Parallel):
            return None
        sight = self._line_of_sight
        return math.sqrt(max(float(sight @ self.matrix[3:6, 3:6] @ sight), 0.0))

    @property
    def sideways(self) -> float:
        """Greatest standard deviation across the line of sight, model units."""
        if isinstance(self.pose.camera, Parallel):
            return _largest(self.matrix[3:5, 3:5])
        sight = self._line_of_sight
        across = np.eye(3) - np.outer(sight, sight)
        return _largest(across @ self.matrix[3:6, 3:6] @ across)

    @property
    def scale_percent(self) -> float | None:
        """Standard deviation of the scale of a parallel projection, %; None in perspective."""
        is_parallel = isinstance(self.pose.camera, Parallel)
        return 100.0 * math.sqrt(max(self.matrix[5, 5], 0.0)) if is_parallel else None

    @property
    def focal_px(self) -> float | None:
        """Standard deviation of the focal length ``fx``, px; None where it was not looked for."""
        camera = self.pose.camera
        if not self.has_focal or isinstance(camera, Parallel):
            return None
        return camera.fx * math.sqrt(max(self.matrix[6, 6], 0.0))

    @property
    def size_percent(self) -> float | None:
        """Standard deviation of the model's size in its set, %; None where that is known."""
        return 100.0 * math.sqrt(max(self.matrix[6, 6], 0.0)) if self.has_size else None

    @property
    def _line_of_sight(self) -> FloatArray:
        middle = self.pose.camera_from_model.apply(self.centre)
        return middle / max(float(np.linalg.norm(middle)), 1e-300)

    def words(self, unit: str | None = None) -> str:
        """Standard deviations, such as ``depth ±12 mm, the rest ±0.4 mm, ±0.1°, ...``."""
        unit = f" {unit}" if unit else ""
        if self.depth is not None:
            first = f"depth ±{short(self.depth)}{unit}"
        else:
            first = f"scale ±{short(self.scale_percent or 0.0)} %"
        rest = f"the rest ±{short(self.sideways)}{unit}, ±{short(self.degrees)}°"
        focal = "" if self.focal_px is None else f", focal length ±{short(self.focal_px)} px"
        size = "" if self.size_percent is None else f", its size ±{short(self.size_percent)} %"
        return f"{first}, {rest}{focal}{size}, in the photo ±{short(self.px)} px"


def region_reach(size: int) -> float:
    """Reach of the ``REGION`` of ``size`` numbers, in standard deviations."""
    return math.sqrt(float(chdtri(max(size, 1), 1.0 - REGION)))


def ellipse(covariance: FloatArray) -> FloatArray:
    """(48, 2): the border of the ``REGION`` of two numbers, about 0, by their covariance."""
    values, axes = np.linalg.eigh(covariance)
    angles = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    circle = region_reach(2) * np.column_stack([np.cos(angles), np.sin(angles)])
    return (circle * np.sqrt(np.maximum(values, 0.0))) @ axes.T


def short(value: float) -> str:
    """Two digits that count, without an exponent."""
    value = float(f"{value:.1e}")
    digits = 1 - math.floor(math.log10(value)) if 0.0 < value < math.inf else 0
    return f"{value:.{max(digits, 0)}f}"


def _largest(covariance: FloatArray) -> float:
    """The greatest standard deviation over all directions."""
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))


def has_focal(chart: Chart) -> bool:
    """Whether the focal length is a number of the chart."""
    return any(name.startswith(FOCAL) for name in chart.names)


def _derivatives(function: Callable[[FloatArray], FloatArray], scales: FloatArray) -> FloatArray:
    """(n, d): of a function's values (n,) by its numbers (d,), at 0, by central differences."""
    steps = np.diag(STEP * scales)
    return np.array([(function(s) - function(-s)) / (2.0 * s.sum()) for s in steps]).T
