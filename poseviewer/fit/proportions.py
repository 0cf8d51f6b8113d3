"""The model's proportions, freed for a moment about the pose that a search ended in.

A model of other proportions than the thing in the photo finds a minimum, too. There a stretch along
the model's axes explains the photo better than any motion does.
"""

from contextlib import closing
from dataclasses import replace

import numpy as np

from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import FitProblem
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.attributes import Renderer

STRETCHES = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])
"""(2, 3): orthonormal, logarithms of stretches along x, y and z; all three alike are a distance."""
OWN_EDGE, OWN_EVALUATIONS = 0.05, 80
"""Edge and length of the descent of the model as it is, to the coarse level's own minimum."""
EDGE, EVALUATIONS = 0.08, 150
"""Edge and length of the descent from there with its proportions free."""
MIN_GAIN, MIN_STRETCH = 0.08, 0.045
"""Loss that other proportions must gain, and how much longer an axis must be than the others:
right models gain less, or by less."""


class StretchProbe(Probe):
    """A probe whose steps may have two more numbers, along ``STRETCHES`` of the model."""

    def pose(self, step: FloatArray) -> Pose:
        """The pose at a step; its "rotation" stretches the model as well, about its centre."""
        size = len(self.motions)
        pose = super().pose(step[:size])
        if len(step) == size:
            return pose
        place, centre = pose.camera_from_model, self.chart.centre
        linear = place.rotation * np.exp(step[size:] @ STRETCHES)
        return replace(
            pose,
            camera_from_model=RigidTransform(linear, place.apply(centre) - linear @ centre),
        )


def other_proportions(problem: FitProblem, renderer: Renderer, pose: Pose, threads: int) -> str:
    """Sentence on the axis along which another model explains the photo significantly better than
    this one about a pose; empty where none does.

    Raises ``PoseViewerError`` for a pose that has no parameters in a chart.
    """
    with closing(StretchProbe(problem, renderer, pose, threads)) as probe:
        at = np.zeros(len(probe.motions))
        (own, least), *_ = probe.descend([(at, OWN_EDGE, OWN_EVALUATIONS)])
        start = np.append(own, np.zeros(len(STRETCHES)))
        (end, other), *_ = probe.descend([(start, EDGE, EVALUATIONS)])
    # Logarithm of each axis' stretch, above the mean of the two others.
    longer = 1.5 * (end[len(at) :] @ STRETCHES)
    axis = int(np.argmax(np.abs(longer)))
    if least - other < MIN_GAIN or abs(longer[axis]) < MIN_STRETCH:
        return ""
    percent, how = 100.0 * np.expm1(abs(longer[axis])), "longer" if longer[axis] > 0 else "shorter"
    return (
        f"In proportion, the photo shows something about {percent:.0f} % {how} than the model "
        f"along its {'xyz'[axis]}-axis: another model?"
    )
