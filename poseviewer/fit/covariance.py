"""Covariance of the pose that a search ended in, from the loss about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import replace

import numpy as np

from poseviewer.confidence.pose_covariance import PoseCovariance, has_focal
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError
from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.unexplained import LossScale
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.optimise import quadratic
from poseviewer.optimise.quadratic import QuadraticOptions
from poseviewer.render.types import Renderer

MODELS = QuadraticOptions(reach=0.1, rise=0.3, rounds=3, least_gain=-math.inf)
"""Models of the loss about the end: from 5 % of the model's size at its rim down to where the loss
has risen as far as the last models of a search look; always so many rounds."""
SPREAD = 0.031
"""Standard deviation at curvature, unexplained and seen share 1, by ``tests.measure.real``."""
PINV = 1e-12
"""Share of the greatest variance, or inverse of one, below which it stands for none."""
SEEN_POWER = 2.0
"""The more of the model is hidden, the farther what hides it draws the fit."""


def find_covariance(
    problem: FitProblem,
    mesh: Mesh,
    renderer: Renderer,
    pose: Pose,
    seen: float,
    threads: int = 1,
) -> PoseCovariance | None:
    """Covariance of the pose that a search ended in; None where poses beside it are in no photo.

    The curvature of the loss says which way the pose is sure. The loss sums logarithms of what is
    unexplained u, so its curvature is u's divided by u. The scale is calibrated: gloss,
    surroundings and other colours are no noise of known size. ``seen``: the share of the model that
    is, above 0.
    """
    with (
        suppress(PoseViewerError, OutsideChartError, np.linalg.LinAlgError),
        closing(Probe(problem, mesh, renderer, pose, threads, is_fine=True)) as probe,
    ):
        least, inverse = inverse_curvature(probe.losses, len(probe.motions))
        unexplained = LossScale.of(probe.photo).unexplained(least)
        factor = SPREAD / (unexplained * seen**SEEN_POWER)
        covariance = factor**2 * probe.motions.T @ inverse @ probe.motions
        return PoseCovariance.from_chart(mesh, pose, probe.chart, covariance)
    return None


def joint_covariance(
    problem: FitProblem,
    mesh: Mesh,
    parameters: FloatArray,
    views: Sequence[Verdict],
) -> PoseCovariance | None:
    """Covariance of a pose in the first of several photos, by adding the inverses of ``views``;
    None where no photo has one. Its seventh number is the focal length of the first photo's camera
    where that was free, else the model's size.
    """
    count = len(problem.start)
    total, own = np.zeros((count, count)), None
    for view, verdict in zip(problem.views, views, strict=True):
        if verdict.covariance is None or not isinstance(view.chart, ViewChart):
            continue
        from_first = _from_first(view.chart, parameters)[: len(verdict.covariance.matrix)]
        total += from_first.T @ _inverse(verdict.covariance) @ from_first
        own = own or PoseCovariance(
            problem.chart.to_pose(parameters), verdict.covariance.centre, np.zeros((6, 6))
        )
    if own is None:
        return None
    scales = np.append(own.scales, np.ones(count - 6))
    units = np.outer(scales, scales)
    inverse = np.asarray(np.linalg.pinv(total * units, PINV), float)
    # Where one photo alone has a covariance, nothing is said of the size.
    is_told = np.diag(inverse @ total * units)[6:7] > 1.0 - PINV**0.5
    size = 7 if is_told.any() else 6
    seventh = "log_focal" if has_focal(problem.chart) else "log_size"
    joint = (inverse * units)[:size, :size]
    return replace(own, seventh=seventh).with_matrix(joint, mesh)


def _from_first(chart: ViewChart, parameters: FloatArray) -> FloatArray:
    """(7, d): turns, shifts and log focal length in a view from turns and shifts in the first one,
    and the chart's other numbers.
    """
    turn = chart.view_from_reference
    from_first = np.zeros((7, len(parameters)))
    from_first[:3, :3] = from_first[3:6, 3:6] = turn.rotation
    if chart.free_focals:
        from_first[6, 6 + chart.focal_index] = 1.0
    if chart.free_size:
        from_first[3:6, -1] = -chart.nearness(parameters) * turn.translation
    return from_first


def _inverse(covariance: PoseCovariance) -> FloatArray:
    """0 where a number was held."""
    units = np.outer(covariance.scales, covariance.scales)
    return np.linalg.pinv(covariance.matrix / units, PINV) / units


def inverse_curvature(
    losses: Callable[[Sequence[FloatArray]], FloatArray], size: int
) -> tuple[float, FloatArray]:
    """Least loss about 0, and the inverse (k, k) of its second derivatives there.

    Raises ``LinAlgError`` where ``losses``, of points (``size``,), are not finite.
    """
    at, scale = np.zeros(size), np.eye(size)
    *_, last = quadratic.minimise(lambda steps: iter(losses(steps)), at, scale, MODELS)
    if last.axes is None or not np.isfinite([last.value, *last.axes.ravel()]).all():
        raise np.linalg.LinAlgError
    # Along each of its axes a the model rises by the options' rise: a^T H a = 2 rise.
    return last.value, last.axes @ last.axes.T / (2.0 * MODELS.rise)
