"""Turns of a model about its own axes: of all wrong poses those that a photo tells worst.

A can keeps its outline when it is turned about its axis, and so, nearly, do bottles, cups and many
a machine. What is printed on it tells, but only a few degrees far: a search that began farther away
ends beside the right turn, with all else right.
"""

from __future__ import annotations

from contextlib import closing, suppress

import numpy as np

from poseviewer.errors import PoseViewerError
from poseviewer.fit.probing import Descent, Probe, compared_photo, probe_about
from poseviewer.fit.problem import FitProblem
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.hull import principal_axes
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.types import Renderer

TURNS_DEG = (15.0, 30.0, 45.0)
"""To each side. A start is seldom farther off, and a descent finds the right turn from half of the
way to the next one."""
FREE = 0.9
"""A turn counts where this share of it is left of what the search was free to change."""
STEP, EVALUATIONS = 0.08, 60
"""Of the descents from turned poses."""
LEAST_GAIN = 0.02
"""What a turned pose has to be better by on the coarse level, as in a search's last steps."""
SAME_OUTLINE = 0.75
"""Intersection over union of what two poses cover, from which on their outlines are taken for the
same. All of eight wrong ends of a can had a turn to less loss, nearer the truth, that overlapped by
0.77 and more; of 24 wrong ends of other things the best turn did in one (0.78; else 0.74 at most),
and turns led astray from most.
"""


def turning_steps(probe: Probe, mesh: Mesh) -> FloatArray:
    """(t, k): steps of the probe that turn the model about its principal axes, as far as its search
    was free to; t is 0 where it was not.
    """
    axes = principal_axes(mesh) @ probe.chart.start.camera_from_model.rotation.T
    angles = np.radians([*TURNS_DEG, *(-angle for angle in TURNS_DEG)])
    turns = np.zeros((3 * len(angles), probe.motions.shape[1]))
    turns[:, :3] = np.einsum("a,kx->akx", angles, axes).reshape(-1, 3)
    steps = turns @ probe.motions.T
    kept = np.linalg.norm(steps, axis=1) >= FREE * np.linalg.norm(turns, axis=1)
    return steps[kept]


def better_turn(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, pose: Pose, threads: int = 1
) -> FloatArray | None:
    """The problem's numbers (d,) of the best pose of the same outline that descents from turned
    ones come to on a coarse level; None where that is no better than what the pose itself comes to.
    """
    photo = compared_photo(problem, mesh, pose)
    with (
        suppress(PoseViewerError),
        closing(probe_about(problem, photo, mesh, renderer, pose, threads)) as probe,
    ):
        starts = [np.zeros(len(probe.motions)), *turning_steps(probe, mesh)]
        (_, own), *ends = probe.descend([Descent(start, STEP, EVALUATIONS) for start in starts])
        for step, loss in sorted(ends, key=lambda end: end[1]):
            if loss > own - LEAST_GAIN:
                break
            if probe.overlap(starts[0], step) >= SAME_OUTLINE:
                parameters = problem.chart.from_pose(probe.pose(step))
                return problem.complete(parameters[problem.free_indices])
    return None
