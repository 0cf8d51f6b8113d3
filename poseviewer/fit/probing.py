"""Looking around a pose: what it and others cost on a coarse level, by comparable small motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poseviewer.fit.loss import registration_loss
from poseviewer.fit.near import box_near, inside, working_factor
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.stages import FEWEST_OF_STRUCTURE
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.hull import hull_points
from poseviewer.geometry.mesh import Mesh
from poseviewer.optimise.nelder_mead import axis_simplex, downhill_simplex
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.level_pose import level_pose
from poseviewer.render.pyramid.levels import Level, coarsest_level, structured
from poseviewer.render.types import PhotoAttributes, Renderer

FOCAL = ("log_focal", "focal")
"""What charts call the number of the focal length."""
SMALL_STEP = 1e-4
"""For the derivative of one chart's numbers by another's, in units of their spans."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a pose costs: the loss, and the agreement of the edges that is a part of it."""

    loss: float
    edge_cosine: float


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """A downhill simplex with edges of this length about a step (k,), and when it ends."""

    step: FloatArray
    edge: float
    evaluations: int


class Probe:
    """The surroundings of a pose, as steps (k,) along the motions that its search was free in.

    What is asked for together is done side by side; close it in the end.
    """

    def __init__(
        self,
        photo: PhotoAttributes,
        mesh: Mesh,
        renderer: Renderer,
        chart: FreeBodyChart,
        motions: FloatArray,
        threads: int = 1,
    ) -> None:
        """``motions`` (k, d), orthonormal, of the free-body chart about the pose."""
        self.chart, self.motions, self._points = chart, motions, hull_points(mesh)
        self.level: Level = coarsest_level(photo, renderer, chart.start, FEWEST_OF_STRUCTURE)
        self._pool = RendererPool(self.level.renderer, threads)

    def close(self) -> None:
        """End the threads."""
        self._pool.close()

    def pose(self, step: FloatArray) -> Pose:
        """The pose so far away.

        Raises:
            OutsideChartError: there is none.
        """
        return self.chart.to_pose(step @ self.motions)

    def costs(self, steps: Sequence[FloatArray]) -> list[Cost | None]:
        """What each step costs; None where it leads to no pose."""
        return list(self._pool.map(self._cost, steps))

    def losses(self, steps: Sequence[FloatArray]) -> FloatArray:
        """(s,): infinite where a step leads to no pose."""
        return np.array([np.inf if cost is None else cost.loss for cost in self.costs(steps)])

    def descend(self, descents: Sequence[Descent]) -> list[tuple[FloatArray, float]]:
        """Where each comes to, and what that costs."""
        return list(self._pool.map(self._descend, descents, at_a_time=1))

    def _cost(self, renderer: Renderer, step: FloatArray) -> Cost | None:
        try:
            pose = self.pose(step)
        except OutsideChartError:
            return None
        moments = renderer.moments(pose, self.level.photo)
        return Cost(registration_loss(moments), moments.edge_cosine or 0.0)

    def _descend(self, renderer: Renderer, descent: Descent) -> tuple[FloatArray, float]:
        def loss(step: FloatArray) -> float:
            cost = self._cost(renderer, step)
            return np.inf if cost is None else cost.loss

        simplex = axis_simplex(descent.step, np.full(len(descent.step), descent.edge))
        states = downhill_simplex(loss, simplex, x_tolerance=2e-3, f_tolerance=1e-3)
        best, value = descent.step, np.inf
        for count, state in enumerate(states):
            best, value = state.vertices[0], float(state.values[0])
            if count >= descent.evaluations:
                break
        return best, value

    def distance(self, one: FloatArray, other: FloatArray) -> float:
        """Mean distance of the model's outer points in the photo, as a share of its diagonal."""
        try:
            here, there = (self.pose(step).project(self._points) for step in (one, other))
        except OutsideChartError:
            return 1.0
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


def probe_about(
    problem: FitProblem,
    photo: PhotoAttributes,
    mesh: Mesh,
    renderer: Renderer,
    pose: Pose,
    threads: int = 1,
) -> Probe:
    """The surroundings of a pose of the problem, on the ``compared_photo`` of both.

    Raises:
        PoseViewerError: the pose has no numbers in the problem's chart, or in any.
    """
    is_focal_free = any(problem.chart.names[i] in FOCAL for i in problem.free_indices)
    has_focal = not isinstance(pose.camera, Parallel)
    chart = FreeBodyChart.near(mesh, pose, is_focal_free and has_focal)
    motions = free_motions(problem, problem.chart.from_pose(pose), chart)
    return Probe(photo, mesh, renderer, chart, motions, threads)


def compared_photo(problem: FitProblem, mesh: Mesh, pose: Pose) -> PhotoAttributes:
    """What the pose is judged on: classes and edges near it, whatever its search has looked at."""
    photo = problem.photo
    if photo.structure is not None:
        return photo
    near = photo.weights * inside(photo.weights.shape, box_near(mesh, pose))
    plain = replace(photo, weights=near, clipped=False)
    return structured(plain, working_factor(mesh, pose))


def free_motions(problem: FitProblem, parameters: FloatArray, chart: FreeBodyChart) -> FloatArray:
    """(k, d): orthonormal motions that span what the search was free to change."""
    size = len(chart.names)
    if len(problem.free_indices) == size:
        return np.eye(size)
    motions = [_motion(problem, parameters, index, chart) for index in problem.free_indices]
    motions = [motion for motion in motions if motion is not None]
    if not motions:
        return np.eye(size)
    basis, _ = np.linalg.qr(np.array(motions).T)
    return basis.T


def _motion(
    problem: FitProblem, parameters: FloatArray, index: int, chart: FreeBodyChart
) -> FloatArray | None:
    """What a number's change does, per span; forwards or, at the border of the problem's chart,
    backwards. None where neither leads to a pose.
    """
    step = SMALL_STEP * problem.chart.scales(parameters)[index]
    for sign in (1.0, -1.0):
        changed = parameters.copy()
        changed[index] += sign * step
        try:
            return chart.from_pose(problem.chart.to_pose(changed)) * (sign / SMALL_STEP)
        except OutsideChartError:
            continue
    return None
