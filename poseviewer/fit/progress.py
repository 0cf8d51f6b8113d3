"""Progress of a run for one object, and of a search for objects of a scene."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import Verdict
from poseviewer.errors import PoseViewerError
from poseviewer.fit.problem import FitProblem, with_params
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.losses.loss import LossScale
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

if TYPE_CHECKING:
    from poseviewer.fit.survey import SurveyedView


class Status(enum.Enum):
    """The state of a search; the value is a sentence for the user, with what to try."""

    RUNNING = "Searching."
    CONVERGED = "Converged: no pose nearby has a lower loss."
    EVALUATIONS_SPENT = (
        "Stopped at the limit of evaluations: the best pose so far is kept; "
        "fit again from it, or raise `Limits.evaluations`."
    )
    SECONDS_SPENT = (
        "Stopped at the time limit: the best pose so far is kept; "
        "fit again from it, or raise `Limits.seconds`."
    )
    STOPPED = "Stopped by the user: the best pose so far is kept; fit again from it to go on."
    KEPT = (
        "Kept the start: where the search ended is not sure to be better; "
        "fit without `keep_start` to see it."
    )
    NOTHING_SEEN = (
        "No pose near the start shows enough of the model in the region: "
        "bring the start closer, or widen the region."
    )


@dataclass(frozen=True, slots=True, eq=False)
class FitProgress:
    """A search after one more evaluation: the best pose so far, and the candidates.

    Losses are on the photo itself, but those of the candidates are on a pyramid level. Evaluations,
    restarts and seconds count all runs since the start.
    """

    problem: FitProblem
    """Problem, without the pixels that were found to be occluded."""
    parameters: FloatArray
    """(d,): parameters of the best pose, in the problem's chart."""
    pose: Pose
    loss: float
    start_loss: float
    candidates: FloatArray
    """(n, d): parameters that are compared now, the best first: a simplex, part of a population, or
    samples of a quadratic model."""
    candidate_losses: FloatArray
    """(n,): losses of the candidates; infinite where not yet evaluated."""
    evaluations: int
    """Evaluations on all levels."""
    restart: int
    seconds: float
    status: Status
    factor: int = 1
    """Factor by which the candidates' photo is reduced."""
    verdict: Verdict | None = None
    """Verdict on the pose; in the last progress of a search alone."""
    covariance: PoseCovariance | None = None
    """Covariance of the pose, if it is right; in the last progress, None for a lost pose."""
    rival: Pose | None = None
    """Pose of less loss that the verdict came upon."""
    surveyed: tuple[SurveyedView, ...] = ()
    """All views that show the model, where the search has compared some of them, the problem's
    first one first; in the last progress of a search alone."""

    @classmethod
    def at_start(cls, problem: FitProblem) -> FitProgress:
        """Make the progress before the first evaluation."""
        start, pose = problem.start, problem.chart.to_pose(problem.start)
        nothing = np.inf, np.inf, start[None], np.full(1, np.inf)
        return cls(problem, start, pose, *nothing, 0, -1, 0.0, Status.RUNNING)

    @property
    def scale(self) -> LossScale:
        """Scale of the losses."""
        return self.problem.scale

    @property
    def may_continue(self) -> bool:
        """Whether the search has converged within its limits."""
        limits = self.problem.settings.limits
        is_left = self.evaluations < limits.evaluations and self.seconds < limits.seconds
        return is_left and self.status is Status.CONVERGED

    @property
    def rival_parameters(self) -> FloatArray | None:
        """(d,): parameters of the rival, with what is held at its start; None: it has none."""
        problem = self.problem
        if self.rival is None:
            return None
        with suppress(PoseViewerError):  # a chart has no parameters at some poses
            return problem.complete(problem.chart.from_pose(self.rival)[problem.free_indices])
        return None

    @property
    def unexplained(self) -> float:
        """The loss on the scale from 0, all of the photo is explained, to 1, nothing."""
        return self.scale.as_unexplained(self.loss)

    @property
    def start_unexplained(self) -> float:
        """The start's loss on the scale of ``unexplained``."""
        return self.scale.as_unexplained(self.start_loss)

    @property
    def loss_text(self) -> str:
        """Text such as ``unexplained 0.170``; see ``LossScale.text``."""
        return self.scale.text(self.loss)

    def keeping(self, other: FitProgress) -> FitProgress:
        """Return the progress with the pose of another one and, at the end, its verdict."""
        judged = self if self.status is Status.RUNNING else other
        return replace(
            self,
            parameters=other.parameters,
            pose=other.pose,
            loss=other.loss,
            verdict=judged.verdict,
            covariance=judged.covariance,
            rival=judged.rival,
            surveyed=judged.surveyed,
        )


@dataclass(frozen=True, slots=True, eq=False)
class SearchProgress:
    """Progress of a search for objects of a scene, after one more evaluation."""

    scene: Scene
    """Scene with poses and results of the objects whose last search has ended."""
    object_index: int
    """Index of the object that is searched for."""
    progress_by_object: Mapping[int, FitProgress]
    """The last progress for each object that had its turn."""
    improvements: tuple[FitProgress, ...]
    """The object's progress at the first evaluation, and at each that found a better pose."""
    restarts: tuple[FitProgress, ...] = ()
    """The object's progress at the first evaluation of each restart."""
    is_over: bool = False
    """Whether the search has ended, or was stopped: no progress follows."""

    @property
    def progress(self) -> FitProgress:
        """The object's last progress."""
        return self.progress_by_object[self.object_index]

    @property
    def problem(self) -> FitProblem:
        """The object's problem."""
        return self.progress.problem

    @property
    def settings(self) -> FitSettings:
        """The object's settings."""
        return self.scene.objects[self.object_index].settings

    @property
    def best(self) -> Scene:
        """The scene at the best poses so far; the object that is searched for has no result."""
        if self.progress.status is not Status.RUNNING:
            return self.scene
        return with_params(self.scene, self.object_index, self.problem, self.progress.parameters)
