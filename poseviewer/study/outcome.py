"""One fit from one start, and all that is written down of it."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from poseviewer.confidence.model import judge_end
from poseviewer.errors import PoseViewerError
from poseviewer.fit.problem import FitProgress, make_problem, pose_loss
from poseviewer.fit.registration import Registration
from poseviewer.fit.search import judged_fit
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.types import Renderer
from poseviewer.study.features_text import evidence_as_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Errors as in ``PoseError``, losses on the photo itself."""

    error_percent_start: float
    error_percent_end: float
    error_px_start: float
    error_px_end: float
    rotation_deg_start: float
    rotation_deg_end: float
    add_start: float
    add_end: float
    loss_start: float
    loss_end: float
    loss_truth: float
    evaluations: int
    seconds: float
    status: str
    """Name of the ``Status``, or of the error that kept the fit from beginning."""
    verdict: str
    """What the fit itself thinks of where it ended; empty where it says nothing."""
    evidence: str
    """The numbers that the verdict comes from: ``name=value``, with blanks between them."""


def fit_from(
    registration: Registration, settings: FitSettings, renderer: Renderer, truth: Pose
) -> tuple[FloatArray, Outcome]:
    """Fit from the registration's start: where it ended, in the chart's numbers, and the outcome.

    A start that no fit can begin from is also where it ends, with no numbers (0,).

    ``truth`` may be of a camera that the start's chart does not have; its loss is then that of the
    chart's nearest pose.
    """
    mesh, start = registration.mesh, registration.start
    began = perf_counter()
    try:
        problem, _ = make_problem(registration, settings)
        *_, end = judged_fit(problem, mesh, renderer, judge_end)
    except PoseViewerError as error:
        seconds = perf_counter() - began
        return np.zeros(0), _refused(mesh, start, truth, type(error).__name__, seconds)
    seconds = perf_counter() - began
    return end.parameters, Outcome(
        **_errors(mesh, start, end.pose, truth),
        loss_start=end.start_loss,
        loss_end=end.loss,
        loss_truth=pose_loss(problem, renderer, problem.chart.from_pose(truth)),
        evaluations=end.evaluations,
        seconds=round(seconds, 3),
        status=end.status.name,
        verdict=verdict_of(end),
        evidence=evidence_as_text(None if end.verdict is None else end.verdict.features),
    )


def verdict_of(end: FitProgress) -> str:
    """The fit's own judgement of the pose it ended in, or "" if it gives none."""
    return "" if end.verdict is None else end.verdict.word


def _refused(mesh: Mesh, start: Pose, truth: Pose, why: str, seconds: float) -> Outcome:
    nan = float("nan")
    return Outcome(
        **_errors(mesh, start, start, truth),
        loss_start=nan,
        loss_end=nan,
        loss_truth=nan,
        evaluations=0,
        seconds=round(seconds, 3),
        status=why,
        verdict="",
        evidence="",
    )


def _errors(mesh: Mesh, start: Pose, end: Pose, truth: Pose) -> dict[str, float]:
    found = {}
    for name, pose in (("start", start), ("end", end)):
        error = pose_error(mesh, pose, truth)
        found[f"error_percent_{name}"] = error.percent
        found[f"error_px_{name}"] = error.reprojection_px
        found[f"rotation_deg_{name}"] = float(error.rotation_deg)
        found[f"add_{name}"] = error.add
    return found
