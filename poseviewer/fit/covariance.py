"""Covariance of a search's final pose, by the curvature of its loss."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.fit.probing import Probe
from poseviewer.geometry.arrays import FloatArray
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.optimise import quadratic

MODELS = quadratic.QuadraticOptions(0.1, 0.3, rounds=3, min_gain=-math.inf)
"""Quadratic models from 5 % of the model's size at its rim down to a search's last contour."""
LEAST_MODELS = quadratic.QuadraticOptions(0.04, 0.15, rounds=3, growth=2.0)
"""``MODELS`` where the minimum is wanted, too, from a pose that is hardly farther from it."""
FOCAL_MODELS = replace(MODELS, rounds=4, growth=2.0)
"""``MODELS`` with a free camera: beside focal length and depth the loss is flat for long."""
FOCAL_SPREAD = 1.4
"""Factor of the standard deviations with a free camera, for the region to hold as often: measured
with free focal lengths alone."""
SPREAD = 0.031
"""Standard deviation at curvature, unexplained and visible fraction 1 (``tests.measure.real``)."""
VISIBLE_POWER = 2.0
"""Exponent of the visible fraction: the less of the model is visible, the larger the error."""


def find_covariance(probe: Probe, visible: float, is_at_minimum: bool = False) -> PoseCovariance:
    """Find the covariance of a pose at which a fraction ``visible`` of the model is visible.

    The loss sums logarithms of the unexplained share u, so its curvature is that of u over u.

    Args:
        probe: probe of the pose.
        visible: visible fraction of the model, in (0, 1].
        is_at_minimum: whether the distribution is about the minimum beside the pose, not about it.

    Raises:
        PoseViewerError, OutsideChartError, LinAlgError: no loss is known beside the pose.
    """
    is_free = probe.chart.free_focal or probe.chart.free_principal_point
    options = FOCAL_MODELS if is_free else MODELS
    options = LEAST_MODELS if is_at_minimum else options
    least, inverse, step = inverse_curvature(probe.losses, len(probe.motions), options)
    unexplained = DEFAULT.scale(probe.photo).as_unexplained(least)
    factor = SPREAD / (unexplained * visible**VISIBLE_POWER) * (FOCAL_SPREAD if is_free else 1.0)
    covariance = factor**2 * probe.motions.T @ inverse @ probe.motions
    chart = probe.chart
    pose = probe.pose(step) if is_at_minimum else chart.start
    return PoseCovariance.from_chart(probe.mesh, pose, chart, covariance)


def inverse_curvature(
    losses: Callable[[Sequence[FloatArray]], FloatArray],
    size: int,
    options: quadratic.QuadraticOptions = MODELS,
) -> tuple[float, FloatArray, FloatArray]:
    """Return the least loss about 0, the inverse (k, k) of its second derivatives there, and where
    (k,) it is.

    Raises:
        LinAlgError: ``losses``, of points (``size``,), are not finite.
    """
    at, scale = np.zeros(size), np.eye(size)
    *_, last = quadratic.minimise(lambda steps: iter(losses(steps)), at, scale, options)
    if last.axes is None or not np.isfinite([last.value, *last.axes.ravel()]).all():
        raise np.linalg.LinAlgError
    # Along each axis a, the quadratic model rises to the contour: a^T H a = 2 contour_level.
    return last.value, last.axes @ last.axes.T / (2.0 * options.contour_level), last.best
