"""Features of a pose that tell right from wrong: a few hundred evaluations on a coarse level."""

from __future__ import annotations

import math
from contextlib import closing

import numpy as np

from poseviewer.fit.outline import outline_support
from poseviewer.fit.probing import Descent, Probe, compared_photo
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.verdict import Features
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose, level_pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.types import Renderer

FEWEST_PIXELS = 50
"""Of the model, below which it counts as unseen."""
WRONG_POSES = 48
WRONG_DEG, WRONG_SHIFT, WRONG_SIZE = (15.0, 45.0), 0.2, 0.1
"""Turns of wrong poses; standard deviations of their shift, radii, and of their log size."""
RETURNS, RETURN_DISTANCE, RETURN_EDGE, RETURN_EVALUATIONS = 4, 0.15, 0.08, 60
"""Descents from near by: 8 degrees away, or that share of the radius."""
MINIMUM_EDGE, MINIMUM_EVALUATIONS = 0.03, 50
"""Descent from the pose itself: a coarse level's minimum is a little beside the photo's."""


def gather_features(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> Features | None:
    """The features of a pose of the problem; the same each time, on any number of threads.

    None where there are none: the model is not in sight, or in part behind the camera.

    Raises:
        PoseViewerError: the pose has no parameters in the problem's chart.
    """
    photo = compared_photo(problem, mesh, pose)
    covered = renderer.covers(level_pose(pose, photo.factor))
    if np.count_nonzero(covered & (photo.weights > 0.0)) < FEWEST_PIXELS:
        return None
    with closing(Probe(problem, photo, mesh, renderer, pose, threads)) as probe:
        here = float(probe.losses([np.zeros(len(probe.motions))])[0])
        if not math.isfinite(here):
            return None
        losses = probe.losses(_wrong_steps(probe))
        losses = losses[np.isfinite(losses)]
        typical = float(np.median(losses))
        scale = max(1.4826 * float(np.median(np.abs(losses - typical))), 1e-6)
        turned = probe.losses(probe.turns()) - here
        turn = float(np.min(turned[np.isfinite(turned)], initial=np.inf))
        # Without turns, a turned pose is taken for as bad as a typical wrong one.
        gain = turn if math.isfinite(turn) else max(typical - here, 0.0)
        return Features(
            turn_margin=gain / scale,
            spread_percent=100.0 * float(np.median(_distances_of_returns(probe))),
            outline=outline_support(photo.channels, photo.weights, covered),
            seen=float(np.mean(photo.weights[covered] > 0.0)),
        )


def _wrong_steps(probe: Probe) -> FloatArray:
    """(w, k): steps to wrong poses."""
    random = np.random.default_rng(0)
    size = probe.motions.shape[1]
    axes = random.normal(size=(WRONG_POSES, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.radians(random.uniform(*WRONG_DEG, (WRONG_POSES, 1)))
    rest = random.normal(size=(WRONG_POSES, 3)) * [WRONG_SHIFT, WRONG_SHIFT, WRONG_SIZE]
    motions = np.hstack([axes * angles, rest, np.zeros((WRONG_POSES, size - 6))])
    return motions @ probe.motions.T


def _distances_of_returns(probe: Probe) -> list[float]:
    """Distances of the ends of descents from near by to the coarse minimum, shares of the size."""
    size = len(probe.motions)
    random = np.random.default_rng(1)
    near = random.normal(size=(RETURNS, size))
    near *= RETURN_DISTANCE / np.linalg.norm(near, axis=1, keepdims=True) * math.sqrt(size / 3.0)
    (minimum, _), *ends = probe.descend(
        [
            Descent(np.zeros(size), MINIMUM_EDGE, MINIMUM_EVALUATIONS),
            *(Descent(step, RETURN_EDGE, RETURN_EVALUATIONS) for step in near),
        ]
    )
    return [probe.distance(minimum, end) for end, _ in ends]
