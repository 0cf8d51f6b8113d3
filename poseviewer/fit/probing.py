"""Default losses about a pose, along the motions that its search left free."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from scipy.linalg import orth

from poseviewer.fit.compared_pixels import box_near, working_factor
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.stages import MIN_STRUCTURE_PIXELS
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.charts import OutsideChartError, has_focal, has_principal_point
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.mesh import hull_points, principal_axes
from poseviewer.geometry.symmetry_group import Symmetry
from poseviewer.geometry.transform import RigidTransform, rotation_about
from poseviewer.losses.default_loss import DEFAULT
from poseviewer.optimise.nelder_mead import Descent
from poseviewer.optimise.protocol import State
from poseviewer.render.attributes import PhotoAttributes, Renderer
from poseviewer.render.pool import RendererPool
from poseviewer.render.pyramid.levels import (
    Level,
    coarsest_level,
    lighter_level,
    with_structure,
)

SMALL_STEP = 1e-4
"""Step of a derivative by a chart's parameter, in units of its scale."""
MIN_MOTION = 1e-3
"""Least motion, as a fraction of the greatest: differences are no more exact than this."""
FREE_FRACTION = 0.9
"""Fraction of a rotation that must lie in the free motions for the rotation to be tried."""


class Probe:
    """Losses about a pose, at steps (k,) along the motions that its search left free.

    The steps of one call are evaluated in parallel; ``close`` ends the threads.
    """

    def __init__(
        self,
        problem: FitProblem,
        renderer: Renderer,
        pose: Pose,
        threads: int = 1,
        is_fine: bool = False,
        in_others: Sequence[Pose] = (),
    ) -> None:
        """Prepare to probe a pose, on the photo itself (``is_fine``) or its coarsest level.

        Args:
            problem: problem whose first view the pose is in.
            renderer: renderer of the model.
            pose: the pose.
            threads: number of threads.
            is_fine: whether losses are on the photo itself.
            in_others: the same pose in the problem's further views, whose losses count as much.

        Raises:
            PoseViewerError: a chart has no parameters at the pose.
        """
        self.mesh = problem.mesh
        self.symmetry = problem.symmetry
        self.renderer = renderer
        free_focal = has_focal(problem.chart, problem.free_indices)
        free_principal = has_principal_point(problem.chart, problem.free_indices)
        if isinstance(pose.camera, Parallel):
            free_focal = free_principal = False
        self.chart = FreeBodyChart.near(self.mesh, pose, free_focal, free_principal)
        motions = free_motions(problem, problem.chart.from_pose(pose), self.chart)
        self.motions = _without_equal(motions, self.chart, self.symmetry)
        """(k, d): orthonormal, in the parameters of ``chart``; none leads along equal poses."""
        self._poses = (pose, *in_others)
        pairs = zip(problem.views, self._poses, strict=False)
        self._photos = [self._with_structure(view.photo, own) for view, own in pairs]
        self._is_fine, self._threads = is_fine, threads

    def _with_structure(self, photo: PhotoAttributes, pose: Pose) -> PhotoAttributes:
        """The photo by classes and edges near a pose, whatever was compared."""
        if photo.structure is not None:
            return photo
        near = photo.weights * box_near(self.mesh, pose).mask(*photo.weights.shape)
        plain = replace(photo, weights=near, clipped=False)
        return with_structure(plain, working_factor(self.mesh, pose))

    @property
    def photo(self) -> PhotoAttributes:
        """Attributes of the first view's photo."""
        return self._photos[0]

    @cached_property
    def _levels(self) -> tuple[Level, ...]:
        """The level of each photo on which losses are evaluated."""
        pairs = zip(self._photos, self._poses, strict=True)
        return tuple(
            lighter_level(photo, self.renderer, pose)
            if self._is_fine
            else coarsest_level(photo, self.renderer, pose, MIN_STRUCTURE_PIXELS)
            for photo, pose in pairs
        )

    @cached_property
    def _motions_to_others(self) -> list[RigidTransform]:
        back = self._poses[0].camera_from_model.inverse()
        return [pose.camera_from_model @ back for pose in self._poses[1:]]

    @cached_property
    def _pool(self) -> RendererPool:
        return RendererPool(tuple(level.renderer for level in self._levels), self._threads)

    def close(self) -> None:
        """End the threads."""
        if "_pool" in self.__dict__:
            self._pool.close()

    def pose(self, step: FloatArray) -> Pose:
        """Return the pose at a step.

        Raises:
            OutsideChartError: there is none.
        """
        return self.chart.to_pose(step @ self.motions)

    def losses(self, steps: Sequence[FloatArray] | FloatArray) -> FloatArray:
        """(s,): losses at steps; infinite where a step leads to no pose."""
        return np.array(list(self._pool.map(self._loss, list(steps))))

    def descend(self, descents: Sequence[tuple[FloatArray, Descent]]) -> list[State]:
        """Descend from steps (k,), and return the last state of each descent."""

        def run(renderers: tuple[Renderer, ...], one: tuple[FloatArray, Descent]) -> State:
            start, descent = one
            return descent.run(partial(self._loss, renderers), start)

        return list(self._pool.map(run, descents, at_a_time=1))

    def _loss(self, renderers: tuple[Renderer, ...], step: FloatArray) -> float:
        """The mean loss over the views; infinite where a step leads to no pose."""
        try:
            first = self.pose(step)
        except OutsideChartError:
            return np.inf
        poses, own = [first], first.camera_from_model
        for motion, pose in zip(self._motions_to_others, self._poses[1:], strict=True):
            poses.append(replace(pose, camera_from_model=motion @ own))
        each = zip(renderers, poses, self._levels, strict=True)
        losses = [DEFAULT.of_moments(r.moments(pose, level.photo)) for r, pose, level in each]
        return sum(losses) / len(losses)

    def turns(self, *degrees: float) -> FloatArray:
        """(t, k): steps that rotate the model by ``degrees`` about each of its principal axes, as
        far as they are free.
        """
        axes = principal_axes(self.mesh) @ self.chart.start.camera_from_model.rotation.T
        angles = np.radians(degrees)
        turns = np.zeros((3 * len(angles), self.motions.shape[1]))
        turns[:, :3] = np.einsum("a,kx->akx", angles, axes).reshape(-1, 3)
        steps = turns @ self.motions.T
        kept = np.linalg.norm(steps, axis=1) >= FREE_FRACTION * np.linalg.norm(turns, axis=1)
        return steps[kept]

    def distance(self, one: FloatArray, other: FloatArray) -> float:
        """Mean distance of the hull in the photo, as a fraction of its diagonal there, at most 1.

        Of poses that the symmetry makes equal, the nearest counts.
        """
        try:
            pose = self.pose(one)
            equal = self.symmetry.nearest_pose(self.pose(other), pose)
        except OutsideChartError:
            return 1.0
        here, there = (each.project(hull_points(self.mesh)) for each in (pose, equal))
        diagonal = float(np.linalg.norm(np.ptp(here, axis=0)))
        apart = float(np.linalg.norm(here - there, axis=1).mean())
        return min(apart / diagonal, 1.0) if diagonal > 0.0 and np.isfinite(apart) else 1.0


def free_motions(problem: FitProblem, parameters: FloatArray, chart: FreeBodyChart) -> FloatArray:
    """(k, d): orthonormal motions that span the free parameters of a search."""
    if len(problem.free_indices) == len(parameters):
        return np.eye(len(chart.names))
    steps, motions = SMALL_STEP * np.diag(problem.chart.scales(parameters)), []
    for step in steps[problem.free_indices]:
        for sign in (1.0, -1.0):  # at the border of a chart, one sign leads to no pose
            with suppress(OutsideChartError):
                pose = problem.chart.to_pose(parameters + sign * step)
                motions.append(chart.from_pose(pose) * (sign / SMALL_STEP))
                break
    return orth(np.array(motions).T, MIN_MOTION).T


def _without_equal(motions: FloatArray, chart: FreeBodyChart, symmetry: Symmetry) -> FloatArray:
    """Motions (k, d) without rotations of continuous symmetries; all if none would be left."""
    start, equal = chart.start.camera_from_model, []
    for axis in symmetry.free_axes:
        turn = symmetry.as_transform(rotation_about(*(SMALL_STEP * axis)))
        pose = replace(chart.start, camera_from_model=start @ turn)
        equal.append(chart.from_pose(pose) / SMALL_STEP)
    if not equal:
        return motions
    along, sizes, _ = np.linalg.svd(motions @ np.array(equal).T)
    rest = along[:, np.count_nonzero(sizes > FREE_FRACTION) :].T @ motions
    return rest if len(rest) else motions
