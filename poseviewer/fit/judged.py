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
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.attributes import Renderer

AGAIN_BELOW = 0.6
"""Poses that are right with less probability are looked for again. Of 150 fits on real photos this
was said of 70, 30 of which were off by more than 5 per cent; of the other 80, 7 were."""

FOCAL_MOVED, MOST_SEARCHES = 0.02, 4
"""Where a search has moved the focal length by a greater share, another one goes on from its end,
up to so many in all."""

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
    for progress in _searched(problem, renderer, threads):
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


def _searched(problem: FitProblem, renderer: Renderer, threads: int) -> Iterator[FitProgress]:
    """As ``fit_pose``. Along the focal length the loss is all but flat, and a search that has gone
    far along it has often stopped on its way: it goes on from there until the focal length stays.
    """
    if problem.method == "paper":
        yield from fit_pose(problem, renderer, threads)
        return
    limits = problem.limits
    done: FitProgress | None = None
    for number in range(1, MOST_SEARCHES + 1):
        progress: FitProgress | None = None
        for progress in fit_pose(problem, renderer, threads):
            progress = progress if done is None else _after(done, progress)
            if progress.status is Status.RUNNING:
                yield progress
        assert progress is not None  # a search yields at least once
        rest = _rest(limits, progress, progress.seconds) if number < MOST_SEARCHES else None
        is_settled = _focal_moved(problem, progress) <= FOCAL_MOVED
        if progress.status is not Status.CONVERGED or rest is None or is_settled:
            yield progress
            return
        yield replace(progress, status=Status.RUNNING)
        done, problem = progress, replace(problem, start=progress.numbers, limits=rest)


def _focal_moved(problem: FitProblem, progress: FitProgress) -> float:
    """By what share the focal length is another one than at the search's start."""
    cameras = [pose.camera for pose in (problem.chart.to_pose(problem.start), progress.pose)]
    focals = [camera.fx for camera in cameras if isinstance(camera, Perspective)]
    return abs(focals[1] / focals[0] - 1.0) if len(focals) == 2 else 0.0


def _after(done: FitProgress, progress: FitProgress) -> FitProgress:
    """The progress of both searches, the second of which began where the first one ended."""
    return replace(
        progress,
        start_loss=done.start_loss,
        evaluations=done.evaluations + progress.evaluations,
        restart=done.restart + 1 + progress.restart,
        seconds=done.seconds + progress.seconds,
    )


def _wider(problem: FitProblem, first: FitProgress, seconds: float) -> FitProblem | None:
    """A second search within what is left of the limits; None where there is to be none."""
    rest = _rest(problem.limits, first, seconds)
    has_a_cloud = problem.method == "default" and not problem.photo.clipped
    is_trusted = first.verdict is not None and first.verdict.probability >= AGAIN_BELOW
    if first.status is not Status.CONVERGED or is_trusted or not has_a_cloud or rest is None:
        return None
    return replace(problem, is_wide=True, seed=problem.seed + 1, limits=rest)


def _rest(limits: Limits, done: FitProgress, seconds: float) -> Limits | None:
    """What is left of the limits after a search; None for nothing."""
    evaluations, seconds = limits.evaluations - done.evaluations, limits.seconds - seconds
    return Limits(evaluations, seconds) if evaluations > 0 and seconds > 0.0 else None


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
