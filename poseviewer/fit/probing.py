"""Losses about a pose on a coarse level, along the motions that its search was free in; turns.

A can turned about its axis keeps its outline, and so, nearly, do bottles and cups. Its print tells
the turn, but only a few degrees far: a search from farther away ends beside the right turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
from scipy.linalg import orth

from poseviewer.confidence.pose_covariance import FOCAL
from poseviewer.errors import PoseViewerError
from poseviewer.fit.compared import box_near, working_factor
from poseviewer.fit.loss import registration_loss
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.stages import FEWEST_OF_STRUCTURE
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import Mesh, hull_points, principal_axes
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.geometry.transform import rotation_about
from poseviewer.optimise import nelder_mead
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import coarsest_level, covered, lighter_level, structured
from poseviewer.render.types import PhotoAttributes, Renderer

SMALL_STEP = 1e-4
"""Step of a derivative by a chart's parameter, in units of its scale."""
LEAST_MOTION = 1e-3
"""Share of the greatest motion below which one counts as none: differences are no more exact."""
TOLERANCES = nelder_mead.NelderMeadOptions(x_tolerance=2e-3, f_tolerance=1e-3)
TURNS_DEG = (15.0, 30.0, 45.0)
"""Turns to each side: a descent finds the right one from half of the way to the next."""
FREE_SHARE = 0.9
"""A turn counts where this share of it is left of what the search was free to change."""
TURN_EDGE, TURN_EVALUATIONS = 0.08, 60
"""Edge and length of descents from turned poses."""
TURN_GAIN = 0.02
"""Loss that a turned pose must gain on the coarse level, as in a search's last stage."""
OUTLINE_OVERLAP = 0.75
"""Intersection over union of two poses' pictures from which their outlines count as the same."""

Descent = tuple[FloatArray, float, int]
"""Start (k,), edge and number of evaluations of a downhill simplex."""


class Probe:
    """Losses about a pose, at steps (k,) along the motions that its search was free in.

    Steps that are asked for together are evaluated in parallel; ``close`` ends the threads.
    """

    def __init__(
        self,
        problem: FitProblem,
        mesh: Mesh,
        renderer: Renderer,
        pose: Pose,
        threads: int = 1,
        is_fine: bool = False,
    ) -> None:
        """``is_fine``: probe the photo itself, not its coarsest level.

        Raises ``PoseViewerError`` for a pose that has no parameters in a chart.
        """
        is_focal_free = any(problem.chart.names[i].startswith(FOCAL) for i in problem.free_indices)
        free_focal = is_focal_free and not isinstance(pose.camera, Parallel)
        self.chart = FreeBodyChart.near(mesh, pose, free_focal)
        motions = free_motions(problem, problem.chart.from_pose(pose), self.chart)
        self.motions = _without_equal(motions, self.chart, problem.symmetry)
        """(k, d): orthonormal, in the numbers of ``chart``; none leads along equal poses."""
        self.photo = compared_photo(problem, mesh, pose)
        if is_fine:
            self.level = lighter_level(self.photo, renderer, pose)
        else:
            self.level = coarsest_level(self.photo, renderer, pose, FEWEST_OF_STRUCTURE)
        self._symmetry, self._mesh, self._points = problem.symmetry, mesh, hull_points(mesh)
        self._pool = RendererPool(self.level.renderer, threads)
        self.close = self._pool.close

    def pose(self, step: FloatArray) -> Pose:
        """The pose at a step; raises ``OutsideChartError`` where there is none."""
        return self.chart.to_pose(step @ self.motions)

    def losses(self, steps: Sequence[FloatArray] | FloatArray) -> FloatArray:
        """(s,): losses at steps; infinite where a step leads to no pose."""
        return np.array(list(self._pool.map(self._loss, list(steps))))

    def descend(self, descents: Sequence[Descent]) -> list[tuple[FloatArray, float]]:
        """The step where each descent ends, and the loss there."""
        return list(self._pool.map(self._descend, descents, at_a_time=1))

    def _loss(self, renderer: Renderer, step: FloatArray) -> float:
        try:
            pose = self.pose(step)
        except OutsideChartError:
            return np.inf
        return registration_loss(renderer.moments(pose, self.level.photo))

    def _descend(self, renderer: Renderer, descent: Descent) -> tuple[FloatArray, float]:
        start, edge, evaluations = descent
        states = nelder_mead.minimise(
            lambda steps: map(partial(self._loss, renderer), steps),
            start,
            edge * np.eye(len(start)),
            TOLERANCES,
        )
        *_, last = islice(states, evaluations + 1)
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
        """Mean distance of the hull in the photo, as a share of its diagonal there, at most 1; of
        equal poses the nearest counts.
        """
        try:
            pose = self.pose(one)
            equal = self._symmetry.nearest_pose(self.pose(other), pose)
        except OutsideChartError:
            return 1.0
        here, there = pose.project(self._points), equal.project(self._points)
        diagonal = float(np.linalg.norm(np.ptp(here, axis=0)))
        apart = float(np.linalg.norm(here - there, axis=1).mean())
        return min(apart / diagonal, 1.0) if diagonal > 0.0 and np.isfinite(apart) else 1.0

    def overlap(self, one: FloatArray, other: FloatArray) -> float:
        """Intersection over union of the pixels that two poses cover, in [0, 1]."""
        photo, renderer = self.level.photo, self.level.renderer
        masks = [covered(photo, renderer, self.pose(step)) for step in (one, other)]
        either = np.count_nonzero(masks[0] | masks[1])
        return np.count_nonzero(masks[0] & masks[1]) / either if either else 0.0


def better_turn(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> FloatArray | None:
    """Parameters (d,) of the best pose of the same outline that descents from turned poses reach on
    a coarse level; None where a descent from the pose itself reaches no worse one.
    """
    with suppress(PoseViewerError), closing(Probe(problem, mesh, renderer, pose, threads)) as probe:
        starts = [np.zeros(len(probe.motions)), *probe.turns()]
        descents = [(start, TURN_EDGE, TURN_EVALUATIONS) for start in starts]
        (_, own), *ends = probe.descend(descents)
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
    size, motions = len(chart.names), []
    if not all(problem.free):
        each = (_motion(problem, parameters, index, chart) for index in problem.free_indices)
        motions = [motion for motion in each if motion is not None]
    return orth(np.array(motions).T, LEAST_MOTION).T if motions else np.eye(size)


def _motion(
    problem: FitProblem, parameters: FloatArray, index: int, chart: FreeBodyChart
) -> FloatArray | None:
    """(d,): derivative by a parameter, one-sided; None where no step leads to a pose."""
    step = SMALL_STEP * problem.chart.scales(parameters)[index]
    for sign in (1.0, -1.0):
        changed = parameters.copy()
        changed[index] += sign * step
        with suppress(OutsideChartError):
            return chart.from_pose(problem.chart.to_pose(changed)) * (sign / SMALL_STEP)
    return None


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
