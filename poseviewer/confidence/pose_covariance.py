"""Covariance of a pose in its tangent space.

A deviation d turns the model about its centre, then shifts it, both along the camera's axes::

    x_in_camera = exp(d_rotation) R (x - centre) + R centre + t + d_shift

Under parallel projection the logarithm of the scale stands for the shift in depth. A free focal
length adds its logarithm, and so does the model's size in a set of unknown scale, where the pose in
this photo stays and the other cameras come nearer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Parallel, Perspective, Pose
from poseviewer.geometry.charts import LOG_FOCAL, Chart, has_focal
from poseviewer.geometry.free_body_chart import MAX_LOGARITHM
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import SIZE, ViewChart

REGION = 0.9
"""Share of the distribution within its region, an ellipsoid."""
STEP = 1e-5
"""Share of a number's scale for differences: above rounding, below any curvature."""
SPREAD = 0.031
"""Standard deviation at curvature, unexplained and seen share 1, by ``tests.measure.real``."""
SEEN_POWER = 2.0
"""The more of the model is hidden, the farther what hides it draws the fit."""
PINV = 1e-12
"""Share of the greatest variance, or inverse of one, below which it stands for none."""
WORDS = {
    "depth": "depth ±{}{unit}",
    "scale_percent": "scale ±{} %",
    "sideways": "the rest ±{}{unit}",
    "degrees": "±{}°",
    "size_percent": "its size ±{} %",
    "focal_px": "focal length ±{} px",
    "px": "in the photo ±{} px",
}
"""Text of each of ``PoseCovariance.deviations``."""


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
    seventh: Literal["log_focal", "log_size"] = LOG_FOCAL
    """Meaning of the last of seven numbers: focal length, or size of the model in its set."""

    def __post_init__(self) -> None:
        size = 7 if len(self.matrix) == 7 else 6
        matrix = freeze_array(self.matrix, (size, size))
        object.__setattr__(self, "centre", freeze_array(self.centre, (3,)))
        object.__setattr__(self, "matrix", freeze_array(0.5 * (matrix + matrix.T), (size, size)))

    @classmethod
    def from_chart(
        cls, mesh: Mesh, pose: Pose, chart: Chart, covariance: FloatArray
    ) -> PoseCovariance:
        """From the covariance (n, n) of a chart's numbers at ``pose``, to first order."""
        at = chart.from_pose(pose)
        plain = cls(pose, mesh.centre, np.zeros((7, 7) if has_focal(chart) else (6, 6)))
        scales = chart.scales(at)
        jacobian = _derivatives(lambda steps: plain.deviation(chart.to_pose(at + steps)), scales)
        return plain.with_matrix(jacobian @ covariance @ jacobian.T, mesh)

    def with_matrix(self, matrix: FloatArray, mesh: Mesh) -> PoseCovariance:
        """Another distribution about the same pose of the same model."""
        other = replace(self, matrix=matrix)
        points = hull_points(mesh)
        moved = _derivatives(lambda d: other.pose_at(d).project(points).ravel(), other.scales)
        # The trace of J C J^T is the mean square distance of all points, each two rows of J.
        square = np.einsum("pi,ij,pj->", moved, other.matrix, moved) / len(points)
        return replace(other, px=math.sqrt(max(square, 0.0)))

    def at_equal_pose(self, equal: Pose) -> PoseCovariance:
        """The distribution about an equal pose of a symmetric model, turned about one point."""
        if equal is self.pose:
            return self
        centre = self.pose.camera_from_model.apply(self.centre)
        return replace(self, pose=equal, centre=equal.camera_from_model.inverse().apply(centre))

    def in_view_of(self, view_from_this: RigidTransform, pose: Pose, mesh: Mesh) -> PoseCovariance:
        """Distribution about the ``pose`` in another view, whose camera stands at
        ``view_from_this``, in the model's unit.
        """
        turn = np.eye(len(self.matrix))
        turn[:3, :3] = turn[3:6, 3:6] = view_from_this.rotation
        if self.extra == SIZE:  # a larger model is nearer to this camera
            turn[3:6, 6] = -view_from_this.translation
        return replace(self, pose=pose).with_matrix(turn @ self.matrix @ turn.T, mesh)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each number of a deviation."""
        depth = "log_scale" if isinstance(self.pose.camera, Parallel) else "shift_z"
        names = ("rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y", depth)
        return (*names, self.extra) if self.extra else names

    @property
    def extra(self) -> str:
        """Name of the seventh number; "" where there is none."""
        return self.seventh if len(self.matrix) > 6 else ""

    @cached_property
    def scales(self) -> FloatArray:
        """(d,): comparable changes: a radian, shifts as large as the depth or the photo's width."""
        camera = self.pose.camera
        if isinstance(camera, Parallel):
            shift = camera.width / camera.scale
            return np.array([1.0, 1.0, 1.0, shift, shift, 1.0])
        depth = abs(float(self.pose.camera_from_model.apply(self.centre)[2]))
        return np.array([1.0, 1.0, 1.0, depth, depth, depth, 1.0])[: len(self.matrix)]

    def pose_at(self, deviation: FloatArray) -> Pose:
        """The pose that is off by a ``deviation`` (d,)."""
        camera, place = self.pose.camera, self.pose.camera_from_model
        numbers = np.asarray(deviation, dtype=float)
        rotation = Rotation.from_rotvec(numbers[:3]).as_matrix() @ place.rotation
        middle = place.apply(self.centre) + np.array([numbers[3], numbers[4], 0.0])
        logarithms = np.clip(numbers, -MAX_LOGARITHM, MAX_LOGARITHM)
        if isinstance(camera, Parallel):
            camera = replace(camera, scale=camera.scale * math.exp(logarithms[5]))
        else:
            middle[2] += numbers[5]
            if self.extra == LOG_FOCAL:
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
        if self.extra and isinstance(own, Perspective) and isinstance(its, Perspective):
            zoom = its.fx / own.fx if self.extra == LOG_FOCAL else 1.0
            return np.array([*turn, *shift, math.log(zoom)])
        return np.array([*turn, *shift])

    def in_chart(self, chart: Chart) -> FloatArray:
        """(n, n): covariance of a chart's numbers, to first order; nan for an unknown size."""

        def numbers(deviation: FloatArray) -> FloatArray:
            pose = self.pose_at(deviation)
            if self.extra == SIZE and isinstance(chart, ViewChart):
                return chart.parameters_at(pose, chart.scale * math.exp(-deviation[6]))
            return chart.from_pose(pose)

        jacobian = _derivatives(numbers, self.scales)
        covariance = jacobian @ self.matrix @ jacobian.T
        if isinstance(chart, ViewChart) and chart.free_size and self.extra != SIZE:
            covariance[-1] = covariance[:, -1] = np.nan
        return covariance

    def deviations_of(self, function: Callable[[Pose], FloatArray]) -> FloatArray:
        """(n,): standard deviations of a function of the pose (n,), to first order."""
        jacobian = _derivatives(lambda steps: function(self.pose_at(steps)), self.scales)
        return np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", jacobian, self.matrix, jacobian), 0.0))

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations by name: ``depth`` of the centre along its line of sight, or under
        parallel projection ``scale_percent``; ``sideways`` across it and ``degrees``, where least
        sure; ``focal_px``; ``size_percent`` in its set; ``px`` of the outer points in the photo.
        """
        camera, shifts = self.pose.camera, self.matrix[3:6, 3:6]
        if isinstance(camera, Parallel):
            said = {"scale_percent": 100.0 * math.sqrt(max(self.matrix[5, 5], 0.0))}
            shifts = shifts[:2, :2]
        else:
            middle = self.pose.camera_from_model.apply(self.centre)
            sight = middle / max(float(np.linalg.norm(middle)), 1e-300)
            said = {"depth": math.sqrt(max(float(sight @ shifts @ sight), 0.0))}
            across = np.eye(3) - np.outer(sight, sight)
            shifts = across @ shifts @ across
        said["sideways"] = _largest(shifts)
        said["degrees"] = math.degrees(_largest(self.matrix[:3, :3]))
        share = math.sqrt(max(self.matrix[-1, -1], 0.0))
        if self.extra == SIZE:
            said["size_percent"] = 100.0 * share
        elif self.extra and isinstance(camera, Perspective):
            said["focal_px"] = camera.fx * share
        return {**said, "px": self.px}

    def words(self, unit: str | None = None) -> str:
        """Standard deviations, such as ``depth ±12 mm, the rest ±0.4 mm, ±0.1°, ...``."""
        unit = f" {unit}" if unit else ""
        said = self.deviations.items()
        return ", ".join(WORDS[name].format(short(value), unit=unit) for name, value in said)


def spread(unexplained: float, seen: float) -> float:
    """Standard deviations of a pose over those by the curvature of its loss, calibrated, where a
    share ``seen`` of the model is. The loss sums logarithms of what is unexplained u, so its
    curvature is u's divided by u.
    """
    return SPREAD / (unexplained * seen**SEEN_POWER)


def joint_covariance(
    charts: Sequence[Chart],
    covariances: Sequence[PoseCovariance | None],
    parameters: FloatArray,
    mesh: Mesh,
) -> PoseCovariance | None:
    """Covariance of a pose in the first of several views, by adding the inverses of those in each;
    None where no view has one. Its seventh number is the focal length of the first view's camera
    where that was free, else the model's size. ``parameters`` (d,): of the pose in ``charts``.
    """
    total, own = np.zeros((len(parameters), len(parameters))), None
    for chart, one in zip(charts, covariances, strict=True):
        if one is None or not isinstance(chart, ViewChart):
            continue
        # Turns, shifts and log focal length in the view, from the chart's numbers.
        from_first, turn = np.zeros((7, len(parameters))), chart.view_from_reference
        from_first[:3, :3] = from_first[3:6, 3:6] = turn.rotation
        if chart.free_focals:
            from_first[6, 6 + chart.focal_index] = 1.0
        if chart.free_size:
            from_first[3:6, -1] = -chart.distance_factor(parameters) * turn.translation
        from_first = from_first[: len(one.matrix)]
        units = np.outer(one.scales, one.scales)
        inverse = np.linalg.pinv(one.matrix / units, PINV) / units  # 0 where a number was held
        total += from_first.T @ inverse @ from_first
        own = own or PoseCovariance(charts[0].to_pose(parameters), one.centre, np.zeros((6, 6)))
    if own is None:
        return None
    scales = np.append(own.scales, np.ones(len(parameters) - 6))
    units = np.outer(scales, scales)
    inverse = np.asarray(np.linalg.pinv(total * units, PINV), float)
    # Where one view alone has a covariance, nothing is said of the size.
    is_told = np.diag(inverse @ total * units)[6:7] > 1.0 - PINV**0.5
    size = 7 if is_told.any() else 6
    joint = (inverse * units)[:size, :size]
    seventh = LOG_FOCAL if has_focal(charts[0]) else SIZE
    return replace(own, seventh=seventh).with_matrix(joint, mesh)


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


def _derivatives(function: Callable[[FloatArray], FloatArray], scales: FloatArray) -> FloatArray:
    """(n, d): of a function's values (n,) by its numbers (d,), at 0, by central differences."""
    steps = np.diag(STEP * scales)
    return np.array([(function(s) - function(-s)) / (2.0 * s.sum()) for s in steps]).T
