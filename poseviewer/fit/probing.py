"""The loss around a pose, on a coarse level, by comparable small motions; and symmetric turns.

A can turned about its axis keeps its outline, and so, nearly, do bottles, cups and many a machine.
What is printed on it tells, but only a few degrees far: a search from farther away ends beside the
right turn, with all else right.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from poseviewer.errors import PoseViewerError
from poseviewer.fit.compared import box_near, working_factor
from poseviewer.fit.loss import registration_loss
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.stages import FEWEST_OF_STRUCTURE
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose, level_pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh, hull_points, principal_axes
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.geometry.transform import rotation_about
from poseviewer.optimise import nelder_mead
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import Level, coarsest_level, structured
from poseviewer.render.types import PhotoAttributes, Renderer

FOCAL = "log_focal"
"""Name of the focal length's number in the charts that it is probed with."""
SMALL_STEP = 1e-4
"""For the derivative of one chart's parameters by another's, in units of their scales."""
TOLERANCES = nelder_mead.NelderMeadOptions(x_tolerance=2e-3, f_tolerance=1e-3)
"""Of descents."""
TURNS_DEG = (15.0, 30.0, 45.0)
"""To each side: a descent finds the right turn from half of the way to the next one."""
FREE_SHARE = 0.9
"""A turn counts where this share of it is left of what the search was free to change."""
TURN_EDGE, TURN_EVALUATIONS = 0.08, 60
"""Of the descents from turned poses."""
TURN_GAIN = 0.02
"""Loss that a turned pose must gain on the coarse level, as in a search's last stage."""
OUTLINE_OVERLAP = 0.75
"""Intersection over union of two poses' pictures from which their outlines count as the same."""


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """A downhill simplex with edges of this length about a step (k,), and when it ends."""

    step: FloatArray
    edge: float
    evaluations: int


class Probe:
    """The surroundings of a pose, as steps (k,) along the motions that its search was free in.

    What is asked for together is evaluated in parallel; close it in the end.
    """

    def __init__(
        self,
        problem: FitProblem,
        photo: PhotoAttributes,
        mesh: Mesh,
        renderer: Renderer,
        pose: Pose,
        threads: int = 1,
        chart: FreeBodyChart | None = None,
        level: Level | None = None,
    ) -> None:
        """``photo``: the ``compared_photo`` of problem and pose; ``chart``: about the pose;
        ``level``: of the photo, by default the coarsest.

        Raises ``PoseViewerError`` for a pose that has no parameters in a chart.
        """
        is_focal_free = any(problem.chart.names[i] == FOCAL for i in problem.free_indices)
        has_focal = not isinstance(pose.camera, Parallel)
        self.chart = chart or FreeBodyChart.near(mesh, pose, is_focal_free and has_focal)
        motions = free_motions(problem, problem.chart.from_pose(pose), self.chart)
        self.motions = _without_equal(motions, self.chart, problem.symmetry)
        """(k, d): orthonormal, of the free-body chart about the pose; none that leads along equal
        ones."""
        self._symmetry = problem.symmetry
        self.level = level or coarsest_level(photo, renderer, pose, FEWEST_OF_STRUCTURE)
        self._mesh, self._points = mesh, hull_points(mesh)
        self._pool = RendererPool(self.level.renderer, threads)

    def close(self) -> None:
        """End the threads."""
        self._pool.close()

    def pose(self, step: FloatArray) -> Pose:
        """The pose so far away; raises ``OutsideChartError`` where there is none."""
        return self.chart.to_pose(step @ self.motions)

    def losses(self, steps: Sequence[FloatArray] | FloatArray) -> FloatArray:
        """(s,): infinite where a step leads to no pose."""
        return np.array(list(self._pool.map(self._loss, list(steps))))

    def descend(self, descents: Sequence[Descent]) -> list[tuple[FloatArray, float]]:
        """Where each comes to, and the loss there."""
        return list(self._pool.map(self._descend, descents, at_a_time=1))

    def _loss(self, renderer: Renderer, step: FloatArray) -> float:
        try:
            pose = self.pose(step)
        except OutsideChartError:
            return np.inf
        return registration_loss(renderer.moments(pose, self.level.photo))

    def _descend(self, renderer: Renderer, descent: Descent) -> tuple[FloatArray, float]:
        edges = descent.edge * np.eye(len(descent.step))
        states = nelder_mead.minimise(
            lambda steps: map(partial(self._loss, renderer), steps), descent.step, edges, TOLERANCES
        )
        *_, last = islice(states, descent.evaluations + 1)
        return last.best, last.value

    def turns(self) -> FloatArray:
        """(t, k): steps that turn the model about those principal axes that are free."""
        axes = principal_axes(self._mesh) @ self.chart.start.camera_from_model.rotation.T
        angles = np.radians([*TURNS_DEG, *(-angle for angle in TURNS_DEG)])
        turns = np.zeros((3 * len(angles), self.motions.shape[1]))
        turns[:, :3] = np.einsum("a,kx->akx", angles, axes).reshape(-1, 3)
        steps = turns @ self.motions.T
        kept = np.linalg.norm(steps, axis=1) >= FREE_SHARE * np.linalg.norm(turns, axis=1)
        return steps[kept]

    def distance(self, one: FloatArray, other: FloatArray) -> float:
        """Mean distance of the hull in the photo, as a share of its diagonal; of equal poses the
        nearest counts.
        """
        try:
            pose = self.pose(one)
            equal = self._symmetry.nearest_pose(self.pose(other), pose)
        except OutsideChartError:
            return 1.0
        here, there = (place.project(self._points) for place in (pose, equal))
        diagonal = float(np.linalg.norm(np.ptp(here, axis=0)))
        apart = float(np.linalg.norm(here - there, axis=1).mean())
        return min(apart / diagonal, 1.0) if diagonal > 0.0 and np.isfinite(apart) else 1.0

    def overlap(self, one: FloatArray, other: FloatArray) -> float:
        """Intersection over union of what two poses cover, in [0, 1]."""
        level = self.level
        poses = [level_pose(self.pose(step), level.photo.factor) for step in (one, other)]
        masks = [level.renderer.covers(pose) for pose in poses]
        either = np.count_nonzero(masks[0] | masks[1])
        return np.count_nonzero(masks[0] & masks[1]) / either if either else 0.0


def better_turn(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> FloatArray | None:
    """Parameters (d,) of the best pose of the same outline that descents from turned poses reach on
    a coarse level; None where a descent from the pose itself reaches no worse one.
    """
    photo = compared_photo(problem, mesh, pose)
    with (
        suppress(PoseViewerError),
        closing(Probe(problem, photo, mesh, renderer, pose, threads)) as probe,
    ):
        starts = [np.zeros(len(probe.motions)), *probe.turns()]
        (_, own), *ends = probe.descend(
            [Descent(start, TURN_EDGE, TURN_EVALUATIONS) for start in starts]
        )
        for step, loss in sorted(ends, key=lambda end: end[1]):
            if loss > own - TURN_GAIN:
                break
            if probe.overlap(starts[0], step) >= OUTLINE_OVERLAP:
                parameters = problem.chart.from_pose(probe.pose(step))
                return problem.complete(parameters[problem.free_indices])
    return None


def compared_photo(problem: FitProblem, mesh: Mesh, pose: Pose) -> PhotoAttributes:
    """Classes and edges near the pose, whatever its search has compared."""
    photo = problem.photo
    if photo.structure is not None:
        return photo
    near = photo.weights * box_near(mesh, pose).mask(*photo.weights.shape)
    plain = replace(photo, weights=near, clipped=False)
    return structured(plain, working_factor(mesh, pose))


def free_motions(problem: FitProblem, parameters: FloatArray, chart: FreeBodyChart) -> FloatArray:
    """(k, d): orthonormal motions that span what the search was free to change."""
    size = len(chart.names)
    if len(problem.free_indices) == size:
        return np.eye(size)
    each = (_motion(problem, parameters, index, chart) for index in problem.free_indices)
    motions = [motion for motion in each if motion is not None]
    if not motions:
        return np.eye(size)
    basis, _ = np.linalg.qr(np.array(motions).T)
    return basis.T


def _without_equal(motions: FloatArray, chart: FreeBodyChart, symmetry: Symmetry) -> FloatArray:
    """The motions (k, d) but for turns of continuous symmetries; all if nothing would be left."""
    place, equal = chart.start.camera_from_model, []
    for axis in symmetry.free_axes:
        turn = symmetry.about(rotation_about(*(SMALL_STEP * axis)))
        pose = replace(chart.start, camera_from_model=place @ turn)
        equal.append(chart.from_pose(pose) / SMALL_STEP)
    if not equal:
        return motions
    along, sizes, _ = np.linalg.svd(motions @ np.array(equal).T)
    rest = along[:, np.count_nonzero(sizes > FREE_SHARE) :].T @ motions
    return rest if len(rest) else motions


def _motion(
    problem: FitProblem, parameters: FloatArray, index: int, chart: FreeBodyChart
) -> FloatArray | None:
    """(d,): derivative by a parameter, one-sided; None where no step leads to a pose."""
    step = SMALL_STEP * problem.chart.scales(parameters)[index]
    for sign in (1.0, -1.0):
        changed = parameters.copy()
        changed[index] += sign * step
        try:
            return chart.from_pose(problem.chart.to_pose(changed)) * (sign / SMALL_STEP)
        except OutsideChartError:
            continue
    return None
