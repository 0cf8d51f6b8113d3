"""A search and, at its end, the verdict on the pose that it ended in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from poseviewer.errors import PoseViewerError
from poseviewer.fit.gathering import gather_evidence
from poseviewer.fit.pose_fit import FitProblem, FitProgress, Status, fit_pose
from poseviewer.fit.verdict import Verdict, judge
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.attributes import Renderer


def judged_fit(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, threads: int = 1
) -> Iterator[FitProgress]:
    """As ``fit_pose``; the last progress bears a verdict.

    Gathering its evidence takes a few hundred evaluations more, which are not counted in it.
    """
    for progress in fit_pose(problem, renderer, threads):
        if progress.status is Status.RUNNING:
            yield progress
        else:
            yield with_verdict(progress, problem, mesh, renderer)


def with_verdict(
    progress: FitProgress, problem: FitProblem, mesh: Mesh, renderer: Renderer
) -> FitProgress:
    """The same with the verdict on its pose."""
    return replace(progress, verdict=verdict_on(progress, problem, mesh, renderer))


def verdict_on(
    progress: FitProgress, problem: FitProblem, mesh: Mesh, renderer: Renderer
) -> Verdict:
    """The verdict on the pose of a progress; ``lost`` where it does not show the model."""
    if progress.status is Status.NOTHING_SEEN:
        return judge(None)
    try:
        return judge(gather_evidence(problem, mesh, renderer, progress.pose))
    except PoseViewerError:  # in part behind the camera, or on the edge of its chart
        return judge(None)
