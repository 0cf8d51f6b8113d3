"""A search and, at its end, the verdict on the pose that it ended in."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from typing import Literal

from poseviewer.fit.problem import FitProblem, FitProgress, Status, fit_pose
from poseviewer.fit.settings import Limits
from poseviewer.fit.stages import Scope
from poseviewer.fit.turns import better_turn
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.types import Renderer

Judge = Callable[[FitProgress, FitProblem, Mesh, Renderer, int], Verdict]
"""What gives the verdict on the pose that a search ended in: ``confidence.model.judge_end``."""

FOCAL_MOVED, MOST_SEARCHES = 0.02, 4
"""Where a search has moved the focal length by a greater share, another one goes on from its end,
up to so many in all."""

Way = Literal["on", "turned", "wide"]
"""Where a further search begins: where the last one ended; from the best of the poses that have the
model turned there about its own axes; or at the start, and then it looks farther about it."""
WAYS: tuple[Way, ...] = ("on", "on", "on", "turned", "wide")
"""Of the searches that follow where the pose is not ``found``, until it is. Of 31 fits of a black
car in front of black that had ended up to 26 px off, 25 ended within 1 px after going on. Of eight
fits of a can that had ended 6 to 15 % off, five of them called ``found``, four ended within 2 %
after a search from a turned pose, and none of the others is called so any more."""
SURE = 0.93
"""A pose that is ``found``, but less probably, is gone on from as well: of 40 fits of path-traced
cars from 10 degrees off one more then ended within 1 %, and none was worse."""
WORTH_IT = 0.1
"""It goes on another time only if the last one gained so much loss."""

CLEARLY = 0.1
"""So much more probable the pose must be that a search came to from elsewhere, and so much less
that of one that went on may."""
LIKELY_ENOUGH = 0.75
"""And so probable must be what was found elsewhere. In 300 fits on real photos, by the verdict
before it knew of turns, 29 such poses were clearly likelier than the one before: of 16 above this
three were farther from the truth, of the others seven. What no pose explains is not to be looked
for far from where the user put it.
"""


def judged_fit(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, judge: Judge, threads: int = 1
) -> Iterator[FitProgress]:
    """As ``fit_pose``; the last progress bears a verdict. Unless that is ``SURE`` the search goes
    on from where it ended, as long as that is worth it. If the pose is not ``found`` then, one
    begins with the model turned, and another one looks farther about the start: their poses are
    kept if they have less loss and are likely enough (``is_taken``).

    Gathering the evidence takes a few hundred evaluations more, which are not counted.
    """
    began = time.perf_counter()
    for progress in _searched(problem, renderer, threads):
        if progress.status is Status.RUNNING:
            yield progress
            continue
        best = with_verdict(progress, problem, mesh, renderer, judge, threads)
        gain = math.inf
        for way in WAYS:
            again = further_search(problem, best, way, time.perf_counter() - began)
            if again is None:
                break
            if way == "on" and gain < WORTH_IT:
                continue
            yield replace(best, status=Status.RUNNING, verdict=None)
            if way == "turned":
                turned = better_turn(problem, mesh, renderer, best.pose, threads)
                if turned is None:
                    continue
                again = replace(again, start=turned)
            before = best.loss
            best = yield from _also(best, again, way, mesh, renderer, judge, threads)
            gain = before - best.loss
        yield best


def _also(
    first: FitProgress,
    again: FitProblem,
    way: Way,
    mesh: Mesh,
    renderer: Renderer,
    judge: Judge,
    threads: int,
) -> Generator[FitProgress, None, FitProgress]:
    """A further search while it runs; returns the end of both."""
    for second in fit_pose(again, renderer, threads):
        both = _together(first, second)
        if second.status is Status.RUNNING:
            yield both
            continue
        if second.loss < first.loss:
            judged = with_verdict(second, again, mesh, renderer, judge, threads)
            return _better(both, judged, way)
        return both
    raise AssertionError("a search yields at least once")


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
        done, problem = progress, replace(problem, start=progress.parameters, limits=rest)


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


def further_search(
    problem: FitProblem, best: FitProgress, way: Way, seconds: float
) -> FitProblem | None:
    """A further search within what is left of the limits; None where there is to be none. One
    with the model turned begins where ``better_turn`` says, and until then as one that goes on.
    """
    rest = _rest(problem.limits, best, seconds)
    has_a_cloud = problem.method == "default" and not problem.photo.clipped
    is_trusted = _is_trusted(best.verdict, way)
    if best.status is not Status.CONVERGED or is_trusted or not has_a_cloud or rest is None:
        return None
    scope: Scope = "wide" if way == "wide" else "near"
    start = problem.start if way == "wide" else best.parameters
    seed = problem.seed + (1 if way == "wide" else 2 + best.restart)
    return replace(problem, scope=scope, start=start, seed=seed, limits=rest)


def _is_trusted(verdict: Verdict | None, way: Way) -> bool:
    """Whether a pose with this verdict needs no further search of that kind."""
    if verdict is None or verdict.word != "found":
        return False
    return way != "on" or verdict.probability >= SURE


def _rest(limits: Limits, done: FitProgress, seconds: float) -> Limits | None:
    """What is left of the limits after a search; None for nothing."""
    evaluations, seconds = limits.evaluations - done.evaluations, limits.seconds - seconds
    return Limits(evaluations, seconds) if evaluations > 0 and seconds > 0.0 else None


def _together(first: FitProgress, second: FitProgress) -> FitProgress:
    """The progress of both searches, with the pose of the first one; at the end, its verdict."""
    is_running = second.status is Status.RUNNING
    return replace(
        second,
        parameters=first.parameters,
        pose=first.pose,
        loss=first.loss,
        start_loss=first.start_loss,
        evaluations=first.evaluations + second.evaluations,
        restart=first.restart + 1 + second.restart,
        seconds=first.seconds + second.seconds,
        status=first.status if second.status is Status.NOTHING_SEEN else second.status,
        verdict=None if is_running else first.verdict,
    )


def _better(both: FitProgress, second: FitProgress, way: Way) -> FitProgress:
    """With the second one's pose, where that is to be taken; it has less loss."""
    before = 0.0 if both.verdict is None else both.verdict.probability
    if second.verdict is None or not is_taken(second.verdict.probability, before, way):
        return both
    return replace(
        both,
        parameters=second.parameters,
        pose=second.pose,
        loss=second.loss,
        verdict=second.verdict,
    )


def is_taken(probability: float, before: float, way: Way) -> bool:
    """Whether the pose of a further search, which has less loss, is taken for the one ``before``,
    by how probably each is right: a wrong pose can have less loss than the right one.
    """
    if way == "on":
        return probability >= before - CLEARLY
    return probability >= max(before + CLEARLY, LIKELY_ENOUGH)


def with_verdict(
    progress: FitProgress,
    problem: FitProblem,
    mesh: Mesh,
    renderer: Renderer,
    judge: Judge,
    threads: int = 1,
) -> FitProgress:
    """The same with the verdict on its pose."""
    return replace(progress, verdict=judge(progress, problem, mesh, renderer, threads))
