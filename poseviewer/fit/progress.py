"""The progress of a search, and of several searches one after another as one."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.confidence.verdict import Verdict
from poseviewer.fit.unexplained import LossScale
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose


class Status(enum.Enum):
    """The state of a search; the value is a sentence for the user, with what to try."""

    RUNNING = "Searching."
    CONVERGED = "Converged: restarting the search at its minimum no longer improves it."
    EVALUATIONS_SPENT = (
        "Stopped at the limit of evaluations: the best pose so far is kept; "
        'fit again from it, or raise "Max evaluations" (--evaluations).'
    )
    SECONDS_SPENT = (
        "Stopped at the time limit: the best pose so far is kept; "
        'fit again from it, or raise "Time limit (s)" (--seconds).'
    )
    STOPPED = "Stopped by the user: the best pose so far is kept; fit again from it to go on."
    KEPT = (
        "Kept the start: where the search ended is not sure to be better "
        "(fit without --keep-start to see it)."
    )
    NOTHING_SEEN = (
        "No pose near the start shows enough of the model in the region: "
        "bring the start closer, or widen the region."
    )


@dataclass(frozen=True, slots=True, eq=False)
class FitProgress:
    """A search after one more evaluation: the best pose so far, and where it is looking.

    ``parameters``, ``pose`` and the losses are on the photo itself, the candidates on a pyramid
    level.
    """

    parameters: FloatArray
    """(d,): the best pose, in the problem's chart."""
    pose: Pose
    loss: float
    start_loss: float
    scale: LossScale
    """Scale of the losses."""
    candidates: FloatArray
    """(n, d): parameters that are compared now, the best first: a simplex, or the best of a
    population or of a model's samples."""
    candidate_losses: FloatArray
    """(n,): on the candidates' level; infinite where not yet evaluated."""
    evaluations: int
    """On all levels."""
    restart: int
    seconds: float
    status: Status
    factor: int = 1
    """Times by which the candidates' photo is smaller."""
    verdict: Verdict | None = None
    """Whether the pose is right; given with the last progress of a ``search``."""
    hidden: tuple[NDArray[np.bool_] | None, ...] = ()
    """For each view, the pixels of the compared photo that were taken for something in front of the
    model, and do not count; empty where there was nothing."""

    @property
    def unexplained(self) -> float:
        """The loss on the scale from 0, all of the photo is explained, to 1, nothing."""
        return self.scale.unexplained(self.loss)

    @property
    def start_unexplained(self) -> float:
        """The start's loss on that scale."""
        return self.scale.unexplained(self.start_loss)

    @property
    def loss_text(self) -> str:
        """Text such as ``unexplained 0.170``; see ``LossScale.text``."""
        return self.scale.text(self.loss)


def merge(
    first: FitProgress | None, second: FitProgress, kept: FitProgress | None = None
) -> FitProgress:
    """The progress of two searches, one after the other, on the pixels of the first, with the pose
    and, at the end, the verdict of the one that is ``kept``, by default the second.
    """
    if first is None:
        return second
    kept = second if kept is None else kept
    return replace(
        second,
        parameters=kept.parameters,
        pose=kept.pose,
        loss=kept.loss,
        start_loss=first.start_loss,
        evaluations=first.evaluations + second.evaluations,
        restart=first.restart + 1 + second.restart,
        seconds=first.seconds + second.seconds,
        status=first.status if second.status is Status.NOTHING_SEEN else second.status,
        verdict=None if second.status is Status.RUNNING else kept.verdict,
        hidden=first.hidden,
    )
