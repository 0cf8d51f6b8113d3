"""Search for objects of a scene: first searches, occlusion, verdicts, restarts, and turns.

A search runs the stages (``fit.stages``) from the start, and again while the focal length moves
far. It goes on without the pixels on which something else stands in front (``fit.occlusion``), and
ends with a verdict on its pose. Unless that is trusted, it is continued from there, and at last
from the pose turned about an axis of the model's own; such a pose is taken where the verdict allows
it. A start that is an estimate is given back where the end is not sure to be better.

Which pixels objects hide of one another depends on all their poses, so their searches take turns:
the object seen most goes first, and each is compared where those that stand firm leave it to be
seen. An object is searched for again where this has changed since.
"""

from __future__ import annotations

import math
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from poseviewer.confidence.verdict import (
    PROBABILITY_MARGIN,
    SURE_AMONG_OTHERS,
    SURE_FROM,
    TURNED_THRESHOLD,
    Verdict,
)
from poseviewer.fit.judge import better_turn, judge_end
from poseviewer.fit.occlusion import Hidden, behind, enlarged, find_hidden
from poseviewer.fit.problem import (
    ComparedView,
    FitProblem,
    Hidings,
    Strategy,
    hidings,
    make_problem,
    numbers_of,
    pose_loss,
)
from poseviewer.fit.progress import FitProgress, Status, merge
from poseviewer.fit.scene import Scene, SearchResult
from poseviewer.fit.settings import Limits, settings_as_json
from poseviewer.fit.stages import fit_pose
from poseviewer.fit.visibility import Hiding, visibility
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.pyramid.levels import seen_share
from poseviewer.render.types import Renderer

MOST_CONTINUED = 3
"""Number of searches continued from the end of the one before, until the pose is trusted."""
GAIN_THRESHOLD = 0.1
"""Loss that the last search must have gained to be continued."""
OCCLUSION_PASSES, NEW_SHARE = 2, 0.03
"""Number of times that a search looks for what is in front (the second time from a better pose),
and share of P by which that must differ to search again."""
FOCAL_THRESHOLD, MOST_SEARCHES = 0.02, 4
"""Share of the focal length by which a search must move it to be continued, and number of searches
in all: along the focal length the loss is nearly flat, and they stop early."""
CHANGED = 0.05
"""Share of an object's pixels that others must hide or give free for another search: less moves its
minimum by less than such a search can tell."""
LEAST_LEFT = 0.5
"""Share of what is seen of an object at its start that must lie beside all others, to be searched
for first as if they all stood in front: with less there is little to go by."""
LOOKS = 3
"""Number of times that a search looks again at what others hide of its object, before its verdict:
after two most have settled."""
MOST_ROUNDS = 4
"""Searches of one object at most: two that slide along each other would take turns for ever."""


@dataclass(frozen=True, slots=True, eq=False)
class Placing:
    """The last search for an object."""

    problem: FitProblem
    """The problem with all pixels, those in front of the object too."""
    progress: FitProgress


@dataclass(frozen=True, slots=True, eq=False)
class SearchProgress:
    """A search of a scene after one more evaluation."""

    index: int
    """The object that is searched for."""
    placings: Mapping[int, Placing]
    """The last search for each object that had its turn."""

    @property
    def problem(self) -> FitProblem:
        """The problem of the search under way."""
        return self.placings[self.index].problem

    @property
    def progress(self) -> FitProgress:
        """The search under way."""
        return self.placings[self.index].progress


class _Leg(NamedTuple):
    """One run of the stages."""

    problem: FitProblem
    before: FitProgress | None = None
    """The end of what it continues."""
    keeps_pose: bool = False
    """Whether the pose of ``before`` is shown until the run has ended."""


Outcome = TypeVar("Outcome")
Plan = Generator[_Leg | FitProgress, FitProgress, Outcome]
"""Course of a search: yields legs, whose ends it is sent, and ends with their verdicts."""


class Search:
    """A search for some of a scene's objects; the others stay where they are."""

    def __init__(
        self,
        scene: Scene,
        renderers: Mapping[int, Renderer],
        indices: Sequence[int] = (0,),
        threads: int = 1,
        view: int = 0,
    ) -> None:
        """``renderers``: of the objects ``indices``, for one thread at a time; ``view``: whose
        chart is searched. More ``threads`` give the same poses in less time.
        """
        self._start, self._renderers, self._threads = scene, renderers, threads
        self._indices, self._view = tuple(indices), view
        self.scene = scene
        """With the poses and results of the searches that are over."""
        self._placings: dict[int, Placing] = {}
        self._index = self._indices[0]
        self._problem: FitProblem

    def run(self) -> Iterator[SearchProgress]:
        """The search after every evaluation; an object's last progress has a verdict. To stop it,
        stop asking. Nothing is yielded where each object stands wholly behind others.

        Raises:
            SettingsError: the settings do not go with a photo, a model or its start.
            SingularChartError: the wanted chart has no parameters at a start.
        """
        plan, end = self._turns(), None
        while True:
            try:
                leg = next(plan) if end is None else plan.send(end)
            except StopIteration:
                return
            end = None
            if isinstance(leg, FitProgress):
                yield self._told(leg)
                continue
            for end in fit_pose(leg.problem, self._renderer, self._threads):
                if end.status is Status.RUNNING:
                    kept = leg.before if leg.keeps_pose else None
                    yield self._told(merge(leg.before, end, kept))

    def judged(self, problem: FitProblem, progress: FitProgress) -> FitProgress:
        """The progress with the verdict on its pose."""
        verdict = judge_end(progress, problem, self._mesh, self._renderer, self._threads)
        return replace(progress, verdict=verdict)

    def stopped(self, now: SearchProgress) -> SearchProgress:
        """The best pose of an interrupted search, with its verdict."""
        if now.progress.status is not Status.RUNNING:
            return now
        self._index, self._problem = now.index, now.problem
        stopped = replace(now.progress, status=Status.STOPPED)
        return self._told(self.judged(behind(now.problem, stopped.hidden), stopped))

    @property
    def _renderer(self) -> Renderer:
        return self._renderers[self._index]

    @property
    def _mesh(self) -> Mesh:
        return self.scene.objects[self._index].mesh

    def _told(self, progress: FitProgress) -> SearchProgress:
        self._placings = {**self._placings, self._index: Placing(self._problem, progress)}
        if progress.status is not Status.RUNNING:
            self.scene = with_end(self.scene, self._index, self._problem, progress, self._renderer)
        return SearchProgress(self._index, self._placings)

    def _turns(self) -> Plan[None]:
        """Search for all objects in turn, until none changes what is seen of another."""
        compared: dict[int, Hidings] = {}
        for _ in range(MOST_ROUNDS):
            due, was_searched = set(self._indices), False
            while due:
                index = self._most_seen(due)
                due.remove(index)
                hidden = hidings(self.scene, index, self._view)
                before = compared.get(index)
                is_whole = all(one is not None and one.is_whole for one in hidden.values())
                if is_whole or (before is not None and not _differ(before, hidden)):
                    continue
                if before is None and len(self._indices) == 1:
                    hidden = {number: _all_in_front(one) for number, one in hidden.items()}
                self._index = index
                compared[index] = yield from self._place(hidden)
                was_searched = True
            if not was_searched:
                return

    def _most_seen(self, due: set[int]) -> int:
        """The object of which all others hide least."""
        if len(self.scene.objects) == 1:
            return next(iter(due))
        standing = [i for i, one in enumerate(self.scene.objects) if i in due or not one.hidden]
        placed = [self.scene.placed(index, self._view) for index in standing]
        shares = dict(zip(standing, visibility(placed).shares, strict=True))
        return max(sorted(due), key=lambda index: shares[index])

    def _place(self, hidden: Hidings) -> Plan[Hidings]:
        """Search for an object of which others hide some pixels; returns those at its end.

        They are looked at again where the coarsest level leads, and where the search ends; only
        then the verdict and restarts follow, as with wrong pixels they would be in vain.
        """
        problem = self._made(hidden)
        hidden = {view.index: hidden[view.index] for view in problem.views}
        among = any(one is not None for one in hidden.values())
        is_coarse = among and problem.photo.structure is not None
        strategy = Strategy.COARSE if is_coarse else Strategy.FIRST
        start, done = self._start_of(problem), None
        gain = math.inf  # of the last search, where it continued another on the same pixels
        for look in range(LOOKS + 1):
            rest = rest_of(problem.limits, done)
            if rest is None:
                break
            part = replace(problem, strategy=strategy, start=start, limits=rest)
            now = yield from self._settle(part, done)
            gain = now.start_loss - now.loss if strategy is Strategy.CONTINUE else gain
            done = merge(done, now)
            start, seen = done.parameters, self._seen_at(problem, done.parameters, hidden)
            is_same = not _differ(hidden, seen)
            if strategy is not Strategy.COARSE and (is_same or look == LOOKS):
                break
            if not is_same:
                hidden, problem = seen, self._made(seen)
            strategy = Strategy.CONTINUE
        assert done is not None
        end = yield from self._finish(problem, done, among, gain)
        if is_start_kept(problem, end):
            hidden = self._seen_at(problem, problem.start, hidden)
            problem = self._made(hidden)
            end = self._kept(problem, end)
        yield end
        return hidden

    def _made(self, hidden: Hidings) -> FitProblem:
        """The problem about the start of the object, the others where they are now."""
        own = self._start.objects[self._index]
        scene = self.scene.with_object(self._index, world_from_model=own.world_from_model)
        self._problem, _ = make_problem(scene, self._index, self._view, hidden)
        return self._problem

    def _start_of(self, problem: FitProblem) -> FloatArray:
        """The parameters of the object where it is now."""
        if self._index not in self._placings:
            return problem.start
        pose = self.scene.pose(self._index, problem.views[0].index)
        scale = self.scene.objects[self._index].world_from_model.scale
        return numbers_of(problem.chart, pose, scale)

    def _seen_at(self, problem: FitProblem, parameters: FloatArray, before: Hidings) -> Hidings:
        """The pixels that others hide at ``parameters``, as ``before`` where they hide all."""
        poses = {view.index: view.chart.to_pose(parameters) for view in problem.views}
        now = hidings(self.scene, self._index, problem.views[0].index, poses)
        return {
            number: one if (new := now.get(number)) is None or new.is_whole else new
            for number, one in before.items()
        }

    def _settle(self, problem: FitProblem, before: FitProgress | None) -> Plan[FitProgress]:
        """Run the stages, and again without the coarsest level while the focal length moves far;
        ``before``: what this continues.
        """
        limits, done = problem.limits, (yield _Leg(problem, before))
        for _ in range(1, MOST_SEARCHES):
            rest, is_settled = rest_of(limits, done), _focal_moved(problem, done) <= FOCAL_THRESHOLD
            if done.status is not Status.CONVERGED or rest is None or is_settled:
                break
            is_coarse = problem.strategy is Strategy.COARSE
            strategy = problem.strategy if is_coarse else Strategy.CONTINUE
            problem = replace(problem, strategy=strategy, start=done.parameters, limits=rest)
            done = merge(done, (yield _Leg(problem, merge(before, done))))
        return done

    def _finish(
        self, problem: FitProblem, end: FitProgress, among: bool, gain: float
    ) -> Plan[FitProgress]:
        """Leave out what is in front where a first search has ended, judge, and restart unless the
        verdict is sure. ``among``: others may hide something of the object. ``gain``: the loss that
        the first search has gained, if it continued another one of the same problem.
        """
        began = time.perf_counter() - end.seconds
        whole = problem
        problem, best = yield from self._without_hidden(whole, end)
        if problem is not whole:
            gain = math.inf
        best = self.judged(problem, best)
        sure_from = SURE_AMONG_OTHERS if among else SURE_FROM
        for is_turned in (*(False,) * MOST_CONTINUED, True):
            again = restarted(problem, best, is_turned, time.perf_counter() - began, sure_from)
            if again is None:
                break
            if not is_turned and gain < GAIN_THRESHOLD:
                continue
            if is_turned:
                turned = better_turn(problem, self._mesh, self._renderer, best.pose, self._threads)
                if turned is None:
                    break
                again = replace(again, start=turned)
            before, after = best, (yield _Leg(again, best, keeps_pose=True))
            if after.loss < before.loss:
                after = self.judged(again, after)
            best = merge(before, after, after if is_taken(after, before, is_turned) else before)
            gain = before.loss - best.loss
        return best

    def _without_hidden(
        self, whole: FitProblem, best: FitProgress
    ) -> Plan[tuple[FitProblem, FitProgress]]:
        """Continue without what is in front of the model where a search ended: the problem and the
        end of that; the same as given where nothing is.
        """
        problem, views = whole, whole.views
        for _ in range(OCCLUSION_PASSES):
            rest = rest_of(problem.limits, best)
            if best.status is not Status.CONVERGED or whole.photo.structure is None or rest is None:
                break
            known = best.hidden or (None,) * len(views)
            poses = [view.chart.to_pose(best.parameters) for view in views]
            pairs = zip(views, poses, strict=True)
            masks = [find_hidden(view.photo, self._renderer, pose) for view, pose in pairs]
            now = tuple(old if new is None else new for old, new in zip(known, masks, strict=True))
            if all(map(_is_same, known, now, views)):
                break
            problem = behind(whole, now)
            loss, start_loss = (
                pose_loss(problem, self._renderer, point)
                for point in (best.parameters, problem.start)
            )
            before = replace(best, loss=loss, start_loss=start_loss, hidden=now)
            again = replace(problem, strategy=Strategy.CONTINUE, start=best.parameters, limits=rest)
            best = merge(before, (yield _Leg(again, before, keeps_pose=True)))
        return problem, best

    def _kept(self, problem: FitProblem, end: FitProgress) -> FitProgress:
        """The start in place of the ``end`` of a search from it, with its own loss and verdict,
        which says where the search ended.
        """
        start = problem.chart.to_pose(problem.start)
        loss = pose_loss(problem, self._renderer, problem.start)
        kept = replace(
            end,
            parameters=problem.start,
            pose=start,
            loss=loss,
            start_loss=loss,
            status=Status.KEPT,
            hidden=(),
        )
        kept = self.judged(problem, kept)
        assert end.verdict is not None  # by it the start is kept
        assert kept.verdict is not None
        away = pose_error(self._mesh, end.pose, start, problem.symmetry).percent
        said = (
            f"The start was kept: the search ended {away:.0f} % of the model's size away, where "
            f"{end.verdict.share_right}."
        )
        return replace(kept, verdict=replace(kept.verdict, reasons=(said, *kept.verdict.reasons)))


def with_end(
    scene: Scene, index: int, problem: FitProblem, progress: FitProgress, renderer: Renderer
) -> Scene:
    """The scene with an object where a search of its ``problem`` has ended, and its result."""
    chart, scale = problem.chart, None
    if isinstance(chart, ViewChart):
        scale = 1.0 / chart.scale_at(progress.parameters)
    seen: list[float] = [math.nan] * len(scene.views)
    hidden: list[Hidden] = [None] * len(scene.views)
    left = behind(problem, progress.hidden)
    # The first view comes last, as it has the pose; others may have focal lengths of their own.
    for number, view in reversed([*enumerate(left.views)]):
        pose = view.chart.to_pose(progress.parameters)
        scene = scene.with_pose(index, pose if number else progress.pose, view.index, scale)
        seen[view.index] = seen_share(view.photo, renderer, pose)
        if progress.hidden and (mask := progress.hidden[number]) is not None:
            photo = scene.views[view.index].photo
            hidden[view.index] = enlarged(mask, view.photo.factor, photo.width, photo.height)
    result = replace(
        unsearched_result(scene, index, problem, progress.parameters, progress.loss),
        verdict=progress.verdict,
        seen=tuple(seen),
        hidden=tuple(hidden),
    )
    notes = (*result.notes, *_least_sure(scene, problem, progress.verdict))
    return scene.with_object(index, result=replace(result, notes=notes))


def unsearched_result(
    scene: Scene, index: int, problem: FitProblem, parameters: FloatArray, loss: float
) -> SearchResult:
    """The loss of an object at ``parameters`` without a search, and how it is compared."""
    first = problem.views[0].index
    camera = problem.chart.to_pose(parameters).camera
    note = scene.views[first].photo.focal_note(camera)
    settings = settings_as_json(scene.objects[index].settings)
    return SearchResult(
        None,
        loss,
        problem.scale.unexplained(loss),
        tuple(parameters.tolist()),
        problem.chart.name,
        problem.chart.names,
        {**settings, "photo_channels": problem.photo.channels.shape[2]},
        notes=(note,) if note else (),
        view=first,
    )


def _least_sure(scene: Scene, problem: FitProblem, verdict: Verdict | None) -> tuple[str, ...]:
    """A note on the view that goes least with the others, unless each says ``found``."""
    views = () if verdict is None else verdict.views
    if all(one.word == "found" for one in views):
        return ()
    worst = min(range(len(views)), key=lambda number: views[number].probability)
    return (
        f"{scene.views[problem.views[worst].index].name} goes least with the others: something may "
        "hide the model there, or its camera may disagree with theirs.",
    )


def _differ(before: Hidings, now: Hidings) -> bool:
    """Whether others hide other pixels of an object now than when it was searched for."""
    for number, new in now.items():
        pair = before.get(number), new
        drawn = next((one.drawn for one in pair if one is not None), None)
        if drawn is not None:
            masks = [np.zeros_like(drawn) if one is None else one.hidden for one in pair]
            changed = np.count_nonzero((masks[0] ^ masks[1]) & drawn)
            if changed > CHANGED * np.count_nonzero(drawn):
                return True
    return False


def _all_in_front(seen: Hiding | None) -> Hiding | None:
    """All pixels of the others as hidden, since at a start depth may be too wrong to tell; as given
    where that leaves too little of the object, as of what stands before a wall.
    """
    if seen is None:
        return None
    left, shown = (np.count_nonzero(seen.drawn & ~hidden) for hidden in (seen.others, seen.hidden))
    return replace(seen, hidden=seen.others) if left >= LEAST_LEFT * shown else seen


def is_start_kept(problem: FitProblem, end: FitProgress) -> bool:
    """Whether a problem's start is to be given back, as the ``end`` of its search is not sure to be
    better; never before there is a verdict.
    """
    return problem.keep_start and end.verdict is not None and end.verdict.probability < SURE_FROM


def _is_same(one: Hidden, other: Hidden, view: ComparedView) -> bool:
    """Whether two masks differ on hardly any of the pixels that count."""
    if one is None or other is None:
        return one is other
    counted = view.photo.weights > 0.0
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


def _focal_moved(problem: FitProblem, progress: FitProgress) -> float:
    """The share of the focal length by which a search has moved it; 0 for the paper's method, which
    is not continued.
    """
    cameras = [pose.camera for pose in (problem.chart.to_pose(problem.start), progress.pose)]
    focals = [camera.fx for camera in cameras if isinstance(camera, Perspective)]
    is_searched = len(focals) == 2 and problem.method != "paper"
    return abs(focals[1] / focals[0] - 1.0) if is_searched else 0.0


def rest_of(
    limits: Limits, done: FitProgress | None, seconds: float | None = None
) -> Limits | None:
    """The rest of the ``limits`` after searches that ended in ``done`` and took ``seconds``, by
    default their own; None for nothing.
    """
    if done is None:
        return limits
    seconds = limits.seconds - (done.seconds if seconds is None else seconds)
    evaluations = limits.evaluations - done.evaluations
    return Limits(evaluations, seconds) if evaluations > 0 and seconds > 0.0 else None
