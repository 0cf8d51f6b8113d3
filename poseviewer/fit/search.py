"""When to restart a search, and whether to trust where it ended.

Where a search has ended, what stands in front of the model there (``fit.occlusion``) counts no
more, and the search goes on. It ends with a verdict on its pose. Unless that is trusted, the search
is continued from there, and at last from the pose turned about an axis of the model's own; the pose
of such a search is taken where the verdict allows it. A start that is an estimate is given back
where the end is not sure to be better.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace

import numpy as np

from poseviewer.fit.occlusion import Hidden, behind, find_hidden
from poseviewer.fit.probing import better_turn
from poseviewer.fit.problem import FitProblem, Strategy, pose_loss
from poseviewer.fit.progress import FitProgress, Status, merge
from poseviewer.fit.settings import Limits
from poseviewer.fit.stages import fit_pose
from poseviewer.fit.verdict import Verdict
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.types import PhotoAttributes, Renderer

Judge = Callable[[FitProgress, FitProblem, Mesh, Renderer, int], Verdict]
"""What gives the verdict on the pose that a search ended in: ``confidence.model.judge_end``."""

MOST_CONTINUED = 3
"""Number of searches continued from the end of the one before, until the pose is trusted."""
SURE_FROM = 0.93
"""Probability below which a search is continued even where the pose is ``found``, and a start that
is an estimate is kept; from here on no other search follows, as none would be taken."""
SURE_AMONG_OTHERS = 0.8
"""Probability from which on no other search follows among other models: the verdict compares poses
where these hide something else of the model, which makes it less sure of right ones too."""
GAIN_THRESHOLD = 0.1
"""Loss that the last search must have gained to be continued."""
PROBABILITY_MARGIN = 0.1
"""A turned pose must be more probable by this than the one before; one that was found by continuing
may be less probable by as much."""
TURNED_THRESHOLD = 0.75
"""Probability that a turned pose must have: what no pose explains is not to be looked for far from
where the user put it."""
OCCLUSION_PASSES, NEW_SHARE = 2, 0.03
"""How often a search looks for what is in front: the second time the pose is a better one. Share of
P by which what it sees then must differ, to search again."""
FOCAL_THRESHOLD, MOST_SEARCHES = 0.02, 4
"""Share of the focal length by which a search must move it to be continued from its end, and the
number of searches in all: along the focal length the loss is nearly flat, and they stop early."""


def search(
    problem: FitProblem, mesh: Mesh, renderer: Renderer, judge: Judge, threads: int = 1
) -> Iterator[FitProgress]:
    """Run ``fit_pose`` with restarts; the last progress bears a verdict.

    Gathering the verdict's features takes a few hundred evaluations more, which are not counted.
    """
    for progress in until_focal_settles(problem, renderer, threads):
        if progress.status is Status.RUNNING:
            yield progress
            continue
        for end in finish(problem, progress, mesh, renderer, judge, threads):
            is_kept = is_start_kept(problem, end)
            yield start_kept(problem, end, mesh, renderer, judge, threads) if is_kept else end


def finish(
    problem: FitProblem,
    end: FitProgress,
    mesh: Mesh,
    renderer: Renderer,
    judge: Judge,
    threads: int = 1,
    among_others: bool = False,
    gain: float = math.inf,
) -> Iterator[FitProgress]:
    """What follows where a first search has ended: without what is in front there, the verdict, and
    restarts unless that is sure. ``among_others``: other models may hide something of it.
    ``gain``: the loss that the first search has gained, if it continued another one of the same
    problem.
    """
    began = time.perf_counter() - end.seconds
    whole = problem
    problem, best = yield from _behind(whole, end, renderer, threads)
    if problem is not whole:
        gain = math.inf
    best = replace(best, verdict=judge(best, problem, mesh, renderer, threads))
    sure_from = SURE_AMONG_OTHERS if among_others else SURE_FROM
    for is_turned in (*(False,) * MOST_CONTINUED, True):
        again = restarted(problem, best, is_turned, time.perf_counter() - began, sure_from)
        if again is None:
            break
        if not is_turned and gain < GAIN_THRESHOLD:
            continue
        yield replace(best, status=Status.RUNNING, verdict=None)
        if is_turned:
            turned = better_turn(problem, mesh, renderer, best.pose, threads)
            if turned is None:
                break
            again = replace(again, start=turned)
        before, after = best, best
        for after in fit_pose(again, renderer, threads):
            after = replace(after, hidden=best.hidden, hidden_beside=best.hidden_beside)
            if after.status is Status.RUNNING:
                yield merge(before, after, before)
        if after.loss < before.loss:
            after = replace(after, verdict=judge(after, again, mesh, renderer, threads))
        best = merge(before, after, after if is_taken(after, before, is_turned) else before)
        gain = before.loss - best.loss
    yield best


def is_start_kept(problem: FitProblem, end: FitProgress) -> bool:
    """Whether a problem's start is to be given back, as the ``end`` of its search is not sure to be
    better; never before there is a verdict.
    """
    return problem.keep_start and end.verdict is not None and end.verdict.probability < SURE_FROM


def start_kept(
    problem: FitProblem,
    end: FitProgress,
    mesh: Mesh,
    renderer: Renderer,
    judge: Judge,
    threads: int = 1,
) -> FitProgress:
    """The start in place of the ``end`` of a search from it, with its own loss and verdict, which
    says where the search ended.
    """
    start, loss = problem.chart.to_pose(problem.start), pose_loss(problem, renderer, problem.start)
    kept = replace(
        end,
        parameters=problem.start,
        pose=start,
        loss=loss,
        start_loss=loss,
        status=Status.KEPT,
        hidden=None,
        hidden_beside=(),
    )
    verdict = judge(kept, problem, mesh, renderer, threads)
    assert end.verdict is not None  # by it the start is kept
    away = pose_error(mesh, end.pose, start, problem.symmetry).percent
    said = (
        f"The start was kept: the search ended {away:.0f} % of the model's size away, and of such "
        f"fits {end.verdict.probability:.0%} are right."
    )
    return replace(kept, verdict=replace(verdict, reasons=(said, *verdict.reasons)))


def _behind(
    problem: FitProblem, best: FitProgress, renderer: Renderer, threads: int
) -> Generator[FitProgress, None, tuple[FitProblem, FitProgress]]:
    """The search continued without what is in front of the model where it ended: the problem and
    the end of that; the same as given where nothing is.
    """
    whole = problem
    for _ in range(OCCLUSION_PASSES):
        rest = rest_of(problem.limits, best, best.seconds)
        if best.status is not Status.CONVERGED or whole.photo.structure is None or rest is None:
            break
        views, known = whole.views, (best.hidden, *best.hidden_beside)
        known += (None,) * (len(views) - len(known))
        found = [find_hidden(v.photo, renderer, v.chart.to_pose(best.parameters)) for v in views]
        now = [new if new is not None else old for old, new in zip(known, found, strict=True)]
        each = zip(known, now, views, strict=True)
        if all(_is_same(old, new, view.photo) for old, new, view in each):
            break
        hidden, beside = now[0], tuple(now[1:])
        seen = behind(whole, hidden, beside)
        loss, start_loss = (
            pose_loss(seen, renderer, point) for point in (best.parameters, seen.start)
        )
        of_pixels = {"hidden": hidden, "hidden_beside": beside}
        before = replace(best, loss=loss, start_loss=start_loss, **of_pixels)
        again = replace(seen, strategy=Strategy.CONTINUE, start=best.parameters, limits=rest)
        after = before
        for after in fit_pose(again, renderer, threads):
            after = replace(after, **of_pixels)
            if after.status is Status.RUNNING:
                yield merge(before, after, before)
        problem, best = seen, merge(before, after, after)
    return problem, best


def _is_same(one: Hidden, other: Hidden, photo: PhotoAttributes) -> bool:
    """Whether two masks differ on hardly any of the pixels that count."""
    if one is None or other is None:
        return one is other
    counted = photo.weights > 0.0
    return bool(np.sum((one ^ other) & counted) < NEW_SHARE * np.sum(counted))


def restarted(
    problem: FitProblem,
    best: FitProgress,
    is_turned: bool,
    seconds: float,
    sure_from: float = SURE_FROM,
) -> FitProblem | None:
    """The problem of a further search within what is left of the limits after ``seconds``, from the
    end of the search before (``is_turned``: that the caller is to turn); None where there is to be
    none.
    """
    rest = rest_of(problem.limits, best, seconds)
    has_population = problem.method == "default" and not problem.photo.clipped
    if best.status is not Status.CONVERGED or not has_population or rest is None:
        return None
    if best.verdict is not None:
        is_found, is_sure = best.verdict.word == "found", best.verdict.probability >= sure_from
        if is_sure or (is_found and is_turned):
            return None
    seed = problem.seed + 2 + best.restart
    continued = Strategy.CONTINUE
    return replace(problem, strategy=continued, start=best.parameters, seed=seed, limits=rest)


def is_taken(after: FitProgress, before: FitProgress, is_turned: bool) -> bool:
    """Whether the pose of a further search replaces that of the one ``before``: it needs less loss,
    and to be probable enough, since a wrong pose can have less loss than the right one.
    """
    if after.verdict is None or after.loss >= before.loss:
        return False
    known = 0.0 if before.verdict is None else before.verdict.probability
    if not is_turned:
        return after.verdict.probability >= known - PROBABILITY_MARGIN
    return after.verdict.probability >= max(known + PROBABILITY_MARGIN, TURNED_THRESHOLD)


def until_focal_settles(
    problem: FitProblem, renderer: Renderer, threads: int
) -> Iterator[FitProgress]:
    """As ``fit_pose``, continued while the focal length moves far, without the coarsest level: a
    search but for what follows its end.
    """
    limits = problem.limits
    done: FitProgress | None = None
    for number in range(1, MOST_SEARCHES + 1):
        progress: FitProgress | None = None
        for progress in fit_pose(problem, renderer, threads):
            progress = progress if done is None else merge(done, progress, progress)
            if progress.status is Status.RUNNING:
                yield progress
        assert progress is not None  # a search yields at least once
        rest = rest_of(limits, progress, progress.seconds) if number < MOST_SEARCHES else None
        is_settled = _focal_moved(problem, progress) <= FOCAL_THRESHOLD
        if progress.status is not Status.CONVERGED or rest is None or is_settled:
            yield progress
            return
        yield replace(progress, status=Status.RUNNING)
        done, problem = progress, replace(problem, start=progress.parameters, limits=rest)
        if problem.strategy is not Strategy.COARSE:
            problem = replace(problem, strategy=Strategy.CONTINUE)


def _focal_moved(problem: FitProblem, progress: FitProgress) -> float:
    """The share of the focal length by which a search has moved it; 0 for the paper's method, which
    is not continued.
    """
    cameras = [pose.camera for pose in (problem.chart.to_pose(problem.start), progress.pose)]
    focals = [camera.fx for camera in cameras if isinstance(camera, Perspective)]
    is_searched = len(focals) == 2 and problem.method != "paper"
    return abs(focals[1] / focals[0] - 1.0) if is_searched else 0.0


def rest_of(limits: Limits, done: FitProgress, seconds: float) -> Limits | None:
    """What is left of the ``limits`` after searches that ended in ``done`` and took ``seconds``;
    None for nothing.
    """
    evaluations, seconds = limits.evaluations - done.evaluations, limits.seconds - seconds
    return Limits(evaluations, seconds) if evaluations > 0 and seconds > 0.0 else None
