"""A search and, at its end, the verdict on the pose that it ended in."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from poseviewer.errors import PoseViewerError
from poseviewer.fit.evidence import Evidence
from poseviewer.fit.gathering import gather_evidence
from poseviewer.fit.pose_fit import FitProblem, FitProgress, Limits, Status, fit_pose
from poseviewer.fit.verdict import judge
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.attributes import Renderer

AGAIN_BELOW = 0.6
"""Poses that are right with less probability are looked for again. Of 150 fits on real photos this
was said of 70, 30 of which were off by more than 5 per cent; of the other 80, 7 were."""

CLEARLY = 0.1
"""So much more probable the other pose must be."""


def judged_fit(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, threads: int = 1
) -> Iterator[FitProgress]:
    """As ``fit_pose``; the last progress bears a verdict. If that is a bad one, a second search
    looks farther about the start: its pose is kept if it has less loss and is clearly likelier.

    Gathering the evidence takes a few hundred evaluations more, which are not counted.
    """
    began = time.perf_counter()
    for progress in fit_pose(problem, renderer, threads):
        if progress.status is Status.RUNNING:
            yield progress
            continue
        first = with_verdict(progress, problem, mesh, renderer, threads)
        wider = _wider(problem, first, time.perf_counter() - began)
        if wider is None:
            yield first
        else:
            yield replace(progress, status=Status.RUNNING)
            for second in fit_pose(wider, renderer, threads):
                both = _together(first, second)
                if second.status is not Status.RUNNING and second.loss < first.loss:
                    both = _better(both, with_verdict(second, problem, mesh, renderer, threads))
                yield both


def _wider(problem: FitProblem, first: FitProgress, seconds: float) -> FitProblem | None:
    """A second search within what is left of the limits; None where there is to be none."""
    limits = problem.limits
    evaluations, seconds = limits.evaluations - first.evaluations, limits.seconds - seconds
    has_a_cloud = problem.method == "default" and not problem.photo.clipped
    is_trusted = first.verdict is not None and first.verdict.probability >= AGAIN_BELOW
    if first.status is not Status.CONVERGED or is_trusted or not has_a_cloud:
        return None
    if evaluations <= 0 or seconds <= 0.0:
        return None
    rest = Limits(evaluations, seconds)
    return replace(problem, is_wide=True, seed=problem.seed + 1, limits=rest)


def _together(first: FitProgress, second: FitProgress) -> FitProgress:
    """The progress of both searches, with the pose of the first one; at the end, its verdict."""
    is_running = second.status is Status.RUNNING
    return replace(
        second,
        numbers=first.numbers,
        pose=first.pose,
        loss=first.loss,
        start_loss=first.start_loss,
        evaluations=first.evaluations + second.evaluations,
        restart=first.restart + 1 + second.restart,
        seconds=first.seconds + second.seconds,
        status=first.status if second.status is Status.NOTHING_SEEN else second.status,
        verdict=None if is_running else first.verdict,
    )


def _better(both: FitProgress, second: FitProgress) -> FitProgress:
    """With the second one's pose, if that is clearly likelier: a wrong pose can have less loss than
    the right one.
    """
    before = 0.0 if both.verdict is None else both.verdict.probability
    if second.verdict is None or second.verdict.probability < before + CLEARLY:
        return both
    return replace(
        both, numbers=second.numbers, pose=second.pose, loss=second.loss, verdict=second.verdict
    )


def with_verdict(
    progress: FitProgress, problem: FitProblem, mesh: Mesh, renderer: Renderer, threads: int = 1
) -> FitProgress:
    """The same with the verdict on its pose; ``lost`` where that does not show the model."""
    evidence: Evidence | None = None
    if progress.status is not Status.NOTHING_SEEN:
        with suppress(PoseViewerError):  # in part behind the camera, or on the edge of its chart
            evidence = gather_evidence(problem, mesh, renderer, progress.pose, threads)
    return replace(progress, verdict=judge(evidence))
