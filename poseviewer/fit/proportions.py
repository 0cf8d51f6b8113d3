"""The model's proportions, freed for a moment about the pose that a search ended in.

A model of other proportions than the thing in the photo finds a minimum, too. There a stretch along
the model's axes explains the photo better than any motion does.
"""

from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from poseviewer.fit.probing import Probe
from poseviewer.fit.problem import FitProblem
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.normals import face_normals_and_areas
from poseviewer.optimise.nelder_mead import Descent
from poseviewer.render.attributes import Renderer

STRETCHES = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])
"""(2, 3): orthonormal, logarithms of stretches along x, y and z; all three alike are a distance."""
OWN = Descent(edge=0.05, evaluations=80)
"""Descent of the model as it is, to the coarse level's own minimum."""
FREE = Descent(edge=0.08, evaluations=150)
"""Descent from there with its proportions free."""
MIN_GAIN = 0.08
"""Difference of loss that tells proportions apart: right models gain less by others."""
MIN_STRETCH = 0.045
"""Logarithm of the stretch of one axis beside the others that counts as other proportions."""
GIVEN_STRETCH = 0.2
"""Logarithm of the stretch of one axis that is tried, whether the free descent takes it or not."""
GIVEN = Descent(edge=0.05, evaluations=30)
"""Descent of the model with a given stretch."""


@dataclass(frozen=True, slots=True)
class StretchedPose(Pose):
    """A pose of the model stretched along its axes about its origin, to be drawn by renderers."""

    stretches: FloatArray
    """(3,): factors along the model's x, y and z."""

    @property
    def linear(self) -> FloatArray:
        """(3, 3): the stretch, then the rotation."""
        return freeze_array(self.camera_from_model.rotation * self.stretches, (3, 3))


class StretchProbe(Probe):
    """A probe whose steps may have three more numbers: logarithms of stretches of the model."""

    def __init__(self, problem: FitProblem, renderer: Renderer, pose: Pose, threads: int) -> None:
        super().__init__(problem, renderer, pose, threads)
        self.fixed_point = self.chart.centre
        """(3,): the point of the model that a stretch leaves where it is."""

    def pose(self, step: FloatArray) -> Pose:
        """Return the pose at a step."""
        size = len(self.motions)
        pose = super().pose(step[:size])
        if len(step) == size:
            return pose
        place, fixed = pose.camera_from_model, self.fixed_point
        stretched = StretchedPose(pose.camera, place, np.exp(step[size:]))
        translation = place.apply(fixed) - stretched.linear @ fixed
        return replace(stretched, camera_from_model=replace(place, translation=translation))


@dataclass(frozen=True, slots=True)
class OtherProportions:
    """Proportions of other models that explain the photo better, or as well."""

    axis: int
    """Index of the model's axis, 0 to 2, that is longer or shorter beside the others."""
    log_stretch: float
    """Logarithm of that axis' stretch."""
    is_better: bool
    """Whether the photo is explained significantly better, not only as well."""
    is_focal_assumed: bool = False
    """Whether the focal length is a guess, which stretches what the photo shows as well."""

    def __str__(self) -> str:
        percent = abs(100.0 * np.expm1(self.log_stretch))
        how = "longer" if self.log_stretch > 0 else "shorter"
        stretch, along = f"about {percent:.0f} % {how}", f"along its {'xyz'[self.axis]}-axis"
        if self.is_better:
            cause = "another model?"
            if self.is_focal_assumed:
                cause = f"a wrong focal length, which is assumed (find it), or {cause}"
            what = f"the photo shows something {stretch} than the model {along}"
            return f"In proportion, {what}: {cause}"
        return f"A model {stretch} {along} would fit as well: this photo does not tell."


def middle_facing(mesh: Mesh, pose: Pose) -> FloatArray:
    """Return the middle (3,) of what faces the camera: stretched about it, that stays in sight."""
    normals, areas = face_normals_and_areas(mesh.vertices, mesh.faces)
    camera_from_model = pose.camera_from_model
    towards = -camera_from_model.apply(mesh.centre) @ camera_from_model.rotation
    facing = areas * np.maximum(normals @ towards, 0.0)
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    return facing @ middles / facing.sum() if facing.any() else mesh.centre


def other_proportions(
    problem: FitProblem, renderer: Renderer, pose: Pose, threads: int
) -> OtherProportions | None:
    """Find proportions with which the model explains the photo as well as it does at a pose.

    Args:
        problem: of one photo.
        renderer: of the model.
        pose: where a search ended.
        threads: on which losses are computed.

    Raises:
        PoseViewerError: the pose has no parameters in a chart.
    """
    with closing(StretchProbe(problem, renderer, pose, threads)) as probe:
        size = len(probe.motions)
        own, *_ = probe.descend([(np.zeros(size), OWN)])
        axes = np.asarray(block_diag(np.eye(size), STRETCHES.T), dtype=float)
        free = replace(FREE, edge=FREE.edge * axes)
        end, *_ = probe.descend([(np.append(own.best, np.zeros(3)), free)])
        # Logarithm of each axis' stretch, above the mean of the two others.
        longer = 1.5 * end.best[size:]
        axis = int(np.argmax(np.abs(longer)))
        if own.value - end.value >= MIN_GAIN and abs(longer[axis]) >= MIN_STRETCH:
            return OtherProportions(axis, float(longer[axis]), is_better=True)
        probe.fixed_point = middle_facing(probe.mesh, pose)
        given = GIVEN_STRETCH * np.vstack([np.eye(3), -np.eye(3)])
        kept = replace(GIVEN, edge=GIVEN.edge * np.eye(size + 3, size))  # the stretch stays
        ends = probe.descend([(np.append(own.best, stretch), kept) for stretch in given])
    losses = [end.value for end in ends]
    best = int(np.argmin(losses))
    if losses[best] - own.value > MIN_GAIN:
        return None
    return OtherProportions(best % 3, float(given[best].sum()), is_better=False)
