"""Covariance of a pose in its tangent space; ``fit/covariance.py`` computes it from the loss.

A deviation d rotates the model about its centre, then translates it, both in the camera's axes::

    x_in_camera = exp(d_rotation) R (x - centre) + R centre + t + d_translation

Under parallel projection the logarithm of the scale stands for the translation in depth. A free
focal length adds its logarithm, and so does the model's size in a set of unknown scale, where the
pose in this photo stays and the other cameras come nearer. A free principal point adds its offset
over the photo's width and height, as the last two components.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import (
    Parallel,
    Perspective,
    Pose,
    offset_principal,
    principal_offset,
)
from poseviewer.geometry.charts import (
    LOG_FOCAL,
    PRINCIPAL_POINT,
    Chart,
    has_focal,
    has_principal_point,
)
from poseviewer.geometry.free_body_chart import MAX_LOGARITHM
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.transform import RigidTransform
from poseviewer.geometry.view_chart import SIZE, ViewChart

REGION = 0.9
"""Share of the distribution within its region, an ellipsoid."""
STEP = 1e-5
"""Share of a parameter's scale for differences: above rounding, below any curvature."""
PINV = 1e-12
"""Share of the largest variance, or inverse of one, below which it stands for none."""
TEXTS = {
    "depth": "along the line of sight ±{} {unit}",
    "scale_percent": "scale ±{} %",
    "sideways": "across the line of sight ±{} {unit}",
    "degrees": "rotation ±{}°",
    "size_percent": "its size ±{} %",
    "focal_px": "focal length ±{} px",
    "principal_px": "principal point ±{} px",
    "px": "in the photo ±{} px",
}
"""Text of each of ``PoseCovariance.deviations``."""


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """A normal distribution of poses about one."""

    pose: Pose
    centre: FloatArray
    """(3,): the point that rotations are about, in the model's frame."""
    matrix: FloatArray
    """(d, d), read-only, symmetric; d is 6, or 7 with the ``seventh``, and 2 more with a principal
    point. In rad, the model's unit, logarithms and shares of the photo, in the order of ``names``;
    0 for fixed parameters."""
    px: float = 0.0
    """Root mean square distance in the photo, over the distribution and the model's outer points,
    from where the pose shows them."""
    seventh: Literal["log_focal", "log_size"] = LOG_FOCAL
    """Meaning of the seventh of 7 or 9 parameters: focal length, or the model's size in its set."""

    def __post_init__(self) -> None:
        size = len(self.matrix) if len(self.matrix) in (7, 8, 9) else 6
        matrix = freeze_array(self.matrix, (size, size))
        object.__setattr__(self, "centre", freeze_array(self.centre, (3,)))
        object.__setattr__(self, "matrix", freeze_array(0.5 * (matrix + matrix.T), (size, size)))

    @classmethod
    def from_chart(
        cls, mesh: Mesh, pose: Pose, chart: Chart, covariance: FloatArray
    ) -> PoseCovariance:
        """Propagate the covariance of a chart's parameters, to first order.

        Args:
            mesh: the model.
            pose: mean of the distribution.
            chart: chart of the parameters.
            covariance: (n, n), of the parameters.
        """
        at = chart.from_pose(pose)
        size = 6 + has_focal(chart) + 2 * has_principal_point(chart)
        zero = cls(pose, mesh.centre, np.zeros((size, size)))
        scales = chart.scales(at)
        jacobian = _derivatives(lambda steps: zero.deviation(chart.to_pose(at + steps)), scales)
        return zero.with_matrix(jacobian @ covariance @ jacobian.T, mesh)

    @classmethod
    def from_points(
        cls, mesh: Mesh, pose: Pose, points: FloatArray, px: float
    ) -> PoseCovariance | None:
        """Propagate the deviation of points in the photo, by least squares to first order.

        Args:
            mesh: the model.
            pose: mean of the distribution.
            points: (n, 3), in the model's frame.
            px: standard deviation of each coordinate of a point in the photo.

        Returns:
            The distribution; None where the points do not tell the pose.
        """
        zero = cls(pose, mesh.centre, np.zeros((6, 6)))
        scales = zero.scales
        jacobian = _derivatives(lambda d: zero.pose_at(d).project(points).ravel(), scales) * scales
        information = jacobian.T @ jacobian / px**2
        if not np.linalg.cond(information) < 1.0 / PINV:
            return None
        return zero.with_matrix(np.outer(scales, scales) * np.linalg.inv(information), mesh)

    def with_matrix(self, matrix: FloatArray, mesh: Mesh) -> PoseCovariance:
        """Return another distribution about the same pose of the same model."""
        other = replace(self, matrix=matrix)
        points = hull_points(mesh)
        j = _derivatives(lambda d: other.pose_at(d).project(points).ravel(), other.scales)
        # The trace of J C J^T is the mean square distance of all points, each two rows of J.
        square = np.einsum("pi,ij,pj->", j, other.matrix, j) / len(points)
        return replace(other, px=math.sqrt(max(square, 0.0)))

    def at_equal_pose(self, equal: Pose) -> PoseCovariance:
        """Return the distribution about an equal pose of a symmetric model."""
        if equal is self.pose:
            return self
        centre = self.pose.camera_from_model.apply(self.centre)
        return replace(self, pose=equal, centre=equal.camera_from_model.inverse().apply(centre))

    def in_view_of(self, view_from_this: RigidTransform, pose: Pose, mesh: Mesh) -> PoseCovariance:
        """Return the distribution in another view, with the ``pose`` there, in the model's unit."""
        jacobian = np.eye(len(self.matrix))
        jacobian[:3, :3] = jacobian[3:6, 3:6] = view_from_this.rotation
        if self.extra == SIZE:  # a larger model is nearer to this camera
            jacobian[3:6, 6] = -view_from_this.translation
        return replace(self, pose=pose).with_matrix(jacobian @ self.matrix @ jacobian.T, mesh)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each component of a deviation."""
        depth = "log_scale" if isinstance(self.pose.camera, Parallel) else "shift_z"
        names = ("rotation_x", "rotation_y", "rotation_z", "shift_x", "shift_y", depth)
        names = (*names, self.extra) if self.extra else names
        return (*names, *PRINCIPAL_POINT) if self.has_principal_point else names

    @property
    def extra(self) -> str:
        """Name of the seventh component; "" where there is none."""
        return self.seventh if len(self.matrix) in (7, 9) else ""

    @property
    def has_principal_point(self) -> bool:
        """Whether the last two components are the principal point."""
        return len(self.matrix) > 7

    @cached_property
    def scales(self) -> FloatArray:
        """(d,): comparable changes: a radian, translations by the depth or the photo's width."""
        camera = self.pose.camera
        if isinstance(camera, Parallel):
            width = camera.width / camera.scale
            return np.array([1.0, 1.0, 1.0, width, width, 1.0])
        depth = abs(float(self.pose.camera_from_model.apply(self.centre)[2]))
        return np.array([1.0, 1.0, 1.0, depth, depth, depth, 1.0, 1.0, 1.0])[: len(self.matrix)]

    def pose_at(self, deviation: FloatArray) -> Pose:
        """Return the pose that is off by a ``deviation`` (d,)."""
        camera, transform = self.pose.camera, self.pose.camera_from_model
        d = np.asarray(deviation, dtype=float)
        rotation = Rotation.from_rotvec(d[:3]).as_matrix() @ transform.rotation
        centre = transform.apply(self.centre) + np.array([d[3], d[4], 0.0])
        logarithms = np.clip(d, -MAX_LOGARITHM, MAX_LOGARITHM)
        if isinstance(camera, Parallel):
            camera = replace(camera, scale=camera.scale * math.exp(logarithms[5]))
        else:
            centre[2] += d[5]
            if self.extra == LOG_FOCAL:
                zoom = math.exp(logarithms[6])
                camera = replace(camera, fx=camera.fx * zoom, fy=camera.fy * zoom)
            if self.has_principal_point:
                camera = offset_principal(camera, *d[-2:].tolist())
        return Pose(camera, RigidTransform(rotation, centre - rotation @ self.centre))

    def deviation(self, pose: Pose) -> FloatArray:
        """Return how far (d,) a ``pose`` of the same projection is off; 0 in size."""
        mean, other = self.pose.camera_from_model, pose.camera_from_model
        rotation = Rotation.from_matrix(other.rotation @ mean.rotation.T).as_rotvec()
        translation = other.apply(self.centre) - mean.apply(self.centre)
        camera, camera_off = self.pose.camera, pose.camera
        if isinstance(camera, Parallel) and isinstance(camera_off, Parallel):
            return np.array(
                [*rotation, *translation[:2], math.log(camera_off.scale / camera.scale)]
            )
        rest = []
        if self.extra and isinstance(camera, Perspective) and isinstance(camera_off, Perspective):
            zoom = camera_off.fx / camera.fx if self.extra == LOG_FOCAL else 1.0
            rest = [math.log(zoom)]
        if self.has_principal_point:
            rest += principal_offset(camera, camera_off)
        return np.array([*rotation, *translation, *rest])

    def in_chart(self, chart: Chart) -> FloatArray:
        """Return the covariance (n, n) of a chart's parameters; nan for an unknown size."""
        jacobian = self.jacobian_in(chart)
        covariance = jacobian @ self.matrix @ jacobian.T
        if isinstance(chart, ViewChart) and chart.free_size and self.extra != SIZE:
            covariance[-1] = covariance[:, -1] = np.nan
        return covariance

    def jacobian_in(self, chart: Chart) -> FloatArray:
        """Return the derivatives (n, d) of a chart's parameters by deviations."""

        def parameters(deviation: FloatArray) -> FloatArray:
            pose = self.pose_at(deviation)
            if self.extra == SIZE and isinstance(chart, ViewChart):
                return chart.parameters_at(pose, chart.scale * math.exp(-deviation[6]))
            return chart.from_pose(pose)

        return _derivatives(parameters, self.scales)

    def deviations_of(self, function: Callable[[Pose], FloatArray]) -> FloatArray:
        """Return the standard deviations (n,) of a function of the pose, to first order."""
        jacobian = _derivatives(lambda steps: function(self.pose_at(steps)), self.scales)
        return np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", jacobian, self.matrix, jacobian), 0.0))

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations by name: ``depth`` of the centre along its viewing ray, or under
        parallel projection ``scale_percent``; ``sideways`` across it and ``degrees``, where least
        sure; ``focal_px`` or ``size_percent``, and ``principal_px`` where least sure, if free;
        ``px`` of the outer points in the photo.
        """
        camera, translations = self.pose.camera, self.matrix[3:6, 3:6]
        if isinstance(camera, Parallel):
            deviations = {"scale_percent": 100.0 * math.sqrt(max(self.matrix[5, 5], 0.0))}
            translations = translations[:2, :2]
        else:
            centre = self.pose.camera_from_model.apply(self.centre)
            ray = centre / max(float(np.linalg.norm(centre)), 1e-300)
            deviations = {"depth": math.sqrt(max(float(ray @ translations @ ray), 0.0))}
            across = np.eye(3) - np.outer(ray, ray)
            translations = across @ translations @ across
        deviations["sideways"] = _max_deviation(translations)
        deviations["degrees"] = math.degrees(_max_deviation(self.matrix[:3, :3]))
        share = math.sqrt(max(self.matrix[6, 6], 0.0)) if self.extra else 0.0
        if self.extra == SIZE:
            deviations["size_percent"] = 100.0 * share
        elif self.extra and isinstance(camera, Perspective):
            deviations["focal_px"] = camera.fx * share
        if self.has_principal_point:
            size = np.array([camera.width, camera.height])
            in_px = self.matrix[-2:, -2:] * np.outer(size, size)
            deviations["principal_px"] = _max_deviation(in_px)
        return {**deviations, "px": self.px}

    def words(self, unit: str | None = None, without: Collection[str] = ()) -> str:
        """Return text such as ``along the line of sight ±12 mm, ..., rotation ±0.1°, ...``.

        Args:
            unit: the model's; None: "units".
            without: names of ``deviations`` to leave out.
        """
        known = [pair for pair in self.deviations.items() if pair[0] not in without]
        texts = (TEXTS[name].format(short(value), unit=unit or "units") for name, value in known)
        return ", ".join(texts)


def joint_covariance(
    charts: Sequence[Chart],
    covariances: Sequence[PoseCovariance | None],
    parameters: FloatArray,
    mesh: Mesh,
) -> PoseCovariance | None:
    """Join the covariances of several views by adding their inverses; None where no view has one.

    The joint one is in the first view. Its seventh component is the focal length of that view's
    camera where that was free, else the model's size; a principal point is that camera's, too.

    Args:
        charts: charts of each view.
        covariances: covariances of the pose in each view.
        parameters: (d,), of the pose in ``charts``.
        mesh: the model.
    """
    total, first = np.zeros((len(parameters), len(parameters))), None
    for chart, known in zip(charts, covariances, strict=True):
        if known is None or not isinstance(chart, ViewChart):
            continue
        # Deviations in the view by the chart's parameters.
        jacobian, motion = np.zeros((9, len(parameters))), chart.view_from_reference
        jacobian[:3, :3] = jacobian[3:6, 3:6] = motion.rotation
        if chart.free_focals:
            jacobian[6, 6 + chart.focal_index] = 1.0
        if chart.free_size:
            jacobian[3:6, -1] = -chart.distance_factor(parameters) * motion.translation
        if chart.free_principal_points:
            jacobian[[7, 8], [chart.principal_index, chart.principal_index + 1]] = 1.0
        kept = [*range(7 if known.extra else 6), *([7, 8] if known.has_principal_point else [])]
        jacobian = jacobian[kept]
        units = np.outer(known.scales, known.scales)
        inverse = np.linalg.pinv(known.matrix / units, PINV) / units  # 0 for fixed parameters
        total += jacobian.T @ inverse @ jacobian
        if first is None:
            pose = charts[0].to_pose(parameters)
            first = PoseCovariance(pose, known.centre, np.zeros((6, 6)))
    if first is None:
        return None
    scales = np.append(first.scales, np.ones(len(parameters) - 6))
    units = np.outer(scales, scales)
    inverse = np.asarray(np.linalg.pinv(total * units, PINV), float)
    # A single view's covariance tells nothing of the size.
    is_told = np.diag(inverse @ (total * units)) > 1.0 - PINV**0.5
    seventh, kept = LOG_FOCAL if has_focal(charts[0]) else SIZE, list(range(6))
    for group in ((seventh,), PRINCIPAL_POINT):
        indices = [charts[0].names.index(name) for name in group if name in charts[0].names]
        kept += indices if is_told[indices].any() else []
    joint = (inverse * units)[np.ix_(kept, kept)]
    return replace(first, seventh=seventh).with_matrix(joint, mesh)


def region_reach(size: int) -> float:
    """Return the reach of the ``REGION`` of ``size`` parameters, in standard deviations."""
    return math.sqrt(float(chdtri(max(size, 1), 1.0 - REGION)))


def ellipse(covariance: FloatArray) -> FloatArray:
    """Return the border (48, 2) of the ``REGION`` of two parameters, about 0."""
    values, axes = np.linalg.eigh(covariance)
    angles = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    circle = region_reach(2) * np.column_stack([np.cos(angles), np.sin(angles)])
    return (circle * np.sqrt(np.maximum(values, 0.0))) @ axes.T


def short(value: float) -> str:
    """Format with two significant digits, without an exponent."""
    value = float(f"{value:.1e}")
    digits = 1 - math.floor(math.log10(value)) if 0.0 < value < math.inf else 0
    return f"{value:.{max(digits, 0)}f}"


def _max_deviation(covariance: FloatArray) -> float:
    """Return the largest standard deviation over all directions."""
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))


def _derivatives(function: Callable[[FloatArray], FloatArray], scales: FloatArray) -> FloatArray:
    """Return the Jacobian (n, d) of a function at 0, by central differences."""
    steps = np.diag(STEP * scales)
    return np.array([(function(s) - function(-s)) / (2.0 * s.sum()) for s in steps]).T
