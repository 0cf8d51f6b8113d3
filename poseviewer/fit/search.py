"""Search for objects of a scene: first searches, occlusion, verdicts, restarts, and turns.

A search runs the stages (``fit.stages``) from the start, and again while focal length or principal
point move far. It goes on without the pixels on which something else stands in front
(``fit.occlusion``), and ends with a verdict on its pose. Unless that is trusted, it is continued
from there, and at last from the pose turned about an axis of the model's own; such a pose is taken
where the verdict allows it. Of a pose that is found the model's proportions are checked at last
(``fit.proportions``). A start that is an estimate is given back where the end is not sure to be
better.

Which pixels objects hide of one another depends on all their poses, so their searches take turns:
the object seen most goes first, and each is compared where those that stand firm leave it to be
seen. An object is searched for again where this has changed since.
"""

import math
import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from msgspec import structs

from poseviewer.confidence.verdict import (
    PROBABILITY_MARGIN,
    SURE_BEHIND,
    SURE_FROM,
    TURNED_THRESHOLD,
    WHOLE_FROM,
)
from poseviewer.fit.compared_pixels import ComparedView, enlarged
from poseviewer.fit.judge import better_turn, judge_end
from poseviewer.fit.occlusion import Hidden, find_hidden
from poseviewer.fit.problem import (
    FitProblem,
    Hidings,
    hidings,
    make_problem,
    moved,
    numbers_of,
    pose_loss,
)
from poseviewer.fit.progress import FitProgress, SearchProgress, Status
from poseviewer.fit.proportions import other_proportions
from poseviewer.fit.stages import StageMaker, fit_pose, make_stages
from poseviewer.fit.visibility import Hiding, visibility
from poseviewer.geometry.camera import Perspective, Pose, principal_offset
from poseviewer.geometry.charts import LOG_FOCAL, PRINCIPAL_POINT
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.pyramid.levels import visible_fraction
from poseviewer.render.types import Renderer
from poseviewer.scene.settings import settings_as_json
from poseviewer.scene.types import ChartParameters, Scene, SearchResult

MAX_CONTINUATIONS = 3
"""Number of searches continued from the end of the one before, until the pose is trusted."""
GAIN_THRESHOLD = 0.1
"""Loss that the last search must have gained to be continued."""
OCCLUSION_PASSES, NEW_SHARE = 2, 0.03
"""Looks for what is in front, and share of P by which that must differ to search again."""
MAX_RUNS = 4
"""Runs of the stages before a verdict: what others hide settles after two mostly."""
FOCAL_THRESHOLD = 0.02
"""Share by which a run moves the focal length, and share of the photo by which it moves the
principal point, to be continued, where their spread is not known."""
LAST_MOVE_PERCENT = 1.0
"""Move of the model by a run's last models, by its size, from which they left their valley."""
CHANGED = 0.05
"""Share of an object's pixels that others hide or free: less hardly moves its minimum."""
MIN_LEFT_FRACTION = 0.5
"""Share of what is seen at the start beside all others, to search first as if behind them all."""
MAX_ROUNDS = 4
"""Searches of one object at most: two that slide along each other would take turns for ever."""


Outcome = TypeVar("Outcome")
Steps = Generator[SearchProgress, None, Outcome]


class Search:
    """A search for some of a scene's objects; the others stay where they are."""

    def __init__(
        self,
        scene: Scene,
        renderers: Mapping[int, Renderer],
        indices: Sequence[int] = (0,),
        threads: int = 1,
        view: int = 0,
        stages: StageMaker = make_stages,
    ) -> None:
        """``renderers``: of the objects ``indices``, for one thread at a time; ``view``: whose
        chart is searched. More ``threads`` give the same poses in less time. ``stages`` makes the
        pyramid levels and minimisers.
        """
        self._make_stages = stages
        self._start = scene
        self._renderers = renderers
        self._threads = threads
        self._indices, self._view = tuple(indices), view
        self.scene = scene
        """With the poses and results of the searches that are over."""
        self._now: SearchProgress | None = None
        self._progress_by_object: dict[int, FitProgress] = {}
        self._searched: dict[int, FitProblem] = {}
        """The problem that each object was searched for by last, its end taken or not."""
        self._index, self._began = self._indices[0], 0.0
        self._is_far = False
        """Whether the last models of the last run moved far: they lead to a valley's side only."""

    def run(self) -> Steps[None]:
        """The search after every evaluation; an object's last progress has a verdict. To stop it,
        stop asking. Nothing is yielded where each object stands wholly behind others.

        Raises:
            SettingsError: the settings do not go with a photo, a model or its start.
            SingularChartError: the wanted chart has no parameters at a start.
        """
        for _ in range(MAX_ROUNDS):
            due, was_searched = set(self._indices), False
            while due:
                index = self._most_seen(due)
                due.remove(index)
                hidden = hidings(self.scene, index, self._view)
                before = self._progress_by_object.get(index)
                is_whole = all(one is not None and one.is_whole for one in hidden.values())
                if is_whole or (before is not None and not _differ(self._searched[index], hidden)):
                    continue
                if before is None and len(self._indices) == 1:
                    hidden = {number: _all_in_front(one) for number, one in hidden.items()}
                self._index = index
                self._began = time.perf_counter()
                was_searched = True
                yield from self._place(hidden)
                self._searched[index] = self._progress_by_object[index].problem
                if before is not None and is_worse(self._progress_by_object[index], before):
                    yield self._told(before)
            if not was_searched:
                return

    def stopped(self, now: SearchProgress) -> SearchProgress:
        """The best pose of an interrupted search, with its verdict."""
        if now.progress.status is not Status.RUNNING:
            return now
        self._index = now.object_index
        return self._told(self._judged(replace(now.progress, status=Status.STOPPED)))

    @property
    def _renderer(self) -> Renderer:
        return self._renderers[self._index]

    def _told(self, progress: FitProgress) -> SearchProgress:
        """The progress of the search with one more of the object that has its turn."""
        now = self._now
        improvements = restarts = tuple[FitProgress, ...]()
        self._progress_by_object = {**self._progress_by_object, self._index: progress}
        if progress.status is not Status.RUNNING:
            self.scene = with_end(self.scene, self._index, progress, self._renderer)
        is_going_on = now is not None and now.object_index == self._index
        if now and is_going_on and progress.evaluations >= now.progress.evaluations:
            improvements, restarts = now.improvements, now.restarts
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        if progress.restart > len(restarts):
            restarts = (*restarts, progress)
        known = self._progress_by_object, improvements, restarts
        self._now = SearchProgress(self.scene, self._index, *known)
        return self._now

    def _judged(self, progress: FitProgress) -> FitProgress:
        """The progress with the verdict on its pose."""
        judged = judge_end(progress, self._renderer, self._threads)
        return replace(judged, seconds=time.perf_counter() - self._began)

    def _most_seen(self, due: set[int]) -> int:
        """The object of which all others hide least."""
        if len(due) == 1:
            return next(iter(due))
        standing = [i for i, one in enumerate(self.scene.objects) if i in due or not one.hidden]
        seen = visibility([self.scene.placed(index, self._view) for index in standing])
        shares = dict(zip(standing, seen.shares, strict=True))
        return max(sorted(due), key=lambda index: shares[index])

    def _place(self, hidden: Hidings) -> Steps[None]:
        """Search for an object of which others hide some pixels."""
        # These are told again where the coarsest level leads, and after each run; only then follow
        # the verdict and restarts, as with wrong pixels they would be in vain.
        problem = self._made(hidden)
        is_among, gain = problem.is_among_others, math.inf
        if self._index in self._progress_by_object:  # it has been searched for: from there
            scale = self.scene.objects[self._index].world_from_model.scale
            pose = self.scene.pose(self._index, problem.views[0].index)
            problem = replace(problem, start=numbers_of(problem.chart, pose, scale))
        before, is_coarse = problem.poses(problem.start)[0], is_among and problem.is_structured
        best = yield from self._run(problem, is_coarse=is_coarse)
        for _ in range(1, MAX_RUNS):
            scene = moved(self.scene, self._index, best.problem, best.parameters)
            hidden = self._seen_in(scene, best.problem)
            is_same = not _differ(best.problem, hidden)
            is_far = self._is_far or is_focal_moved(before, best)
            is_settled = is_same and not is_coarse and not is_far
            if is_settled or not best.may_continue:
                break
            best = best if is_same else self._on(self._made(hidden), best)
            before = best.pose
            loss = best.loss
            is_coarse = False
            best = yield from self._run(best.problem, best)
            gain = loss - best.loss if is_among else math.inf
        best = self._of_this_model((yield from self._finish(best, gain)))
        is_unsure = best.verdict is not None and not is_sure(best)
        yield self._told(self._kept(best) if is_unsure and problem.settings.keep_start else best)

    def _run(
        self,
        problem: FitProblem,
        before: FitProgress | None = None,
        shown: FitProgress | None = None,
        **how: Any,
    ) -> Steps[FitProgress]:
        """Run the stages; meanwhile the pose of ``shown`` is the best, by default their own."""
        end = last = before
        how["make"] = self._make_stages
        for end in fit_pose(problem, self._renderer, self._threads, before, **how):
            last = end if last is None or end.restart != last.restart else last
            if end.status is Status.RUNNING:
                yield self._told(end if shown is None else end.keeping(shown))
        assert end is not None  # a run yields at least once
        assert last is not None
        apart = pose_error(problem.mesh, last.pose, end.pose, problem.symmetry)
        self._is_far = problem.is_structured and apart.percent > LAST_MOVE_PERCENT
        return end

    @property
    def _scene_at_start(self) -> Scene:
        """The scene with the object at its start, the others where they are now."""
        place = self._start.objects[self._index].world_from_model
        return self.scene.with_object(self._index, world_from_model=place)

    def _made(self, hidden: Hidings) -> FitProblem:
        """The problem about the start of the object."""
        return make_problem(self._scene_at_start, self._index, self._view, hidden)[0]

    def _seen_in(self, scene: Scene, problem: FitProblem) -> Hidings:
        """The pixels that others hide in a scene, as a ``problem`` has them where they hide all."""
        now = hidings(scene, self._index, problem.views[0].index)
        return {
            view.index: view.behind if (new := now.get(view.index)) is None or new.is_whole else new
            for view in problem.views
        }

    def _on(self, problem: FitProblem, best: FitProgress) -> FitProgress:
        """The best pose so far with its loss, and the start's, on the pixels of a ``problem``."""
        loss, start_loss = (
            pose_loss(problem, self._renderer, at) for at in (best.parameters, problem.start)
        )
        return replace(best, problem=problem, loss=loss, start_loss=start_loss)

    def _finish(self, best: FitProgress, gain: float) -> Steps[FitProgress]:
        """Leave out what is in front, judge, restart; ``gain``: loss that the last run gained."""
        whole, pose_before = best.problem, best.pose
        is_looked_for = whole.settings.in_front == "find"
        for _ in range(OCCLUSION_PASSES):
            if not (best.may_continue and whole.is_structured and is_looked_for):
                break
            views = best.problem.views
            poses = whole.poses(best.parameters)
            hidden = []
            for view, old, pose in zip(whole.views, views, poses, strict=True):
                new = find_hidden(view.photo, self._renderer, pose)
                hidden.append(old.hidden if new is None else new)
            if all(map(_is_same, views, hidden, whole.views)):
                break
            left = map(ComparedView.without, whole.views, hidden)
            before, pose_before = self._on(replace(whole, views=tuple(left)), best), best.pose
            best, gain = (yield from self._run(before.problem, before, before)), math.inf
        best = self._judged(best)
        for is_turned in (*(False,) * MAX_CONTINUATIONS, True):
            is_moved = best.may_continue and is_focal_moved(pose_before, best)
            is_settled = is_turned or not is_moved
            if not is_turned and gain < GAIN_THRESHOLD and is_settled:
                continue
            if is_settled and not is_restarted(best, is_turned):
                break
            pose_before = best.pose
            before, seed = best, whole.settings.seed + 2 + best.restart
            if is_turned:
                turned = better_turn(best.problem, self._renderer, best.pose, self._threads)
                if turned is None:
                    break
                before = replace(best, parameters=turned)
            after = yield from self._run(best.problem, before, best, seed=seed)
            if after.loss < best.loss:
                after = self._judged(after)
            loss = best.loss
            best = after if is_taken(after, best, is_turned) else after.keeping(best)
            gain = loss - best.loss
        return best

    def _of_this_model(self, end: FitProgress) -> FitProgress:
        """The ``end``, doubtful where another model's proportions explain the only photo better."""
        verdict, views = end.verdict, end.problem.views
        if verdict is None or verdict.label != "found" or len(views) > 1:
            return end
        said = other_proportions(end.problem, self._renderer, end.pose, self._threads)
        if not said:
            return end
        verdict = structs.replace(verdict, label="doubtful", reasons=(said, *verdict.reasons))
        return replace(end, verdict=verdict, seconds=time.perf_counter() - self._began)

    def _kept(self, end: FitProgress) -> FitProgress:
        """The start in place of the ``end``, with its own verdict, which says where that was."""
        problem = self._made(self._seen_in(self._scene_at_start, end.problem))
        start = problem.chart.to_pose(problem.start)
        kept = replace(end, parameters=problem.start, pose=start, status=Status.KEPT)
        kept = self._judged(self._on(problem, kept))
        assert end.verdict is not None  # by it the start is kept
        assert kept.verdict is not None
        away = pose_error(problem.mesh, end.pose, start, problem.symmetry).percent
        said = (
            f"The start was kept: the search ended {away:.0f} % of the model's size away, where "
            f"{end.verdict.share_right}."
        )
        reasons = (said, *kept.verdict.reasons)
        return replace(kept, verdict=structs.replace(kept.verdict, reasons=reasons))


def with_end(scene: Scene, index: int, progress: FitProgress, renderer: Renderer) -> Scene:
    """The scene with an object where a search for it has ended, and its result."""
    problem, at = progress.problem, progress.parameters
    scene = moved(scene, index, problem, at)
    seen: list[float | None] = [None] * len(scene.views)
    hidden: list[Hidden] = [None] * len(scene.views)
    for view, pose in zip(problem.views, problem.poses(at), strict=True):
        seen[view.index] = visible_fraction(view.photo, renderer, pose)
        if view.hidden is not None:
            photo, factor = scene.views[view.index].photo, view.photo.factor
            hidden[view.index] = enlarged(view.hidden, factor, photo.width, photo.height)
    result = replace(result_of(scene, index, progress), seen=tuple(seen), hidden=tuple(hidden))
    return scene.with_object(index, result=result)


def result_of(scene: Scene, index: int, progress: FitProgress) -> SearchResult:
    """The best pose of an object, how it is compared, and a note on the view that goes least with
    the others.
    """
    problem, verdict = progress.problem, progress.verdict
    first = scene.views[problem.views[0].index]
    notes = [first.photo.focal_note(problem.chart.to_pose(progress.parameters).camera)]
    verdicts = () if verdict is None else verdict.views
    if any(one.label != "found" for one in verdicts):
        worst = min(range(len(verdicts)), key=lambda number: verdicts[number].probability)
        notes.append(
            f"{scene.views[problem.views[worst].index].name} goes least with the others: something "
            "may hide the model there, or its camera may disagree with theirs."
        )
    settings = settings_as_json(scene.objects[index].settings)
    parameters = tuple(progress.parameters.tolist())
    return SearchResult(
        loss=progress.loss,
        unexplained=progress.unexplained,
        verdict=verdict,
        chart=ChartParameters(problem.chart.name, problem.chart.names, parameters),
        settings={**settings, "photo_channels": problem.photo.channels.shape[2]},
        notes=tuple(filter(None, notes)),
        view=problem.views[0].index,
        covariance=progress.covariance,
    )


def _differ(problem: FitProblem, now: Hidings) -> bool:
    """Whether others hide other pixels of an object now than in a ``problem``."""
    for view in problem.views:
        pair = [one for one in (view.behind, now.get(view.index, view.behind)) if one is not None]
        if pair:
            drawn = pair[0].drawn
            changed = np.logical_xor.reduce([one.hidden for one in pair]) & drawn
            if np.count_nonzero(changed) > CHANGED * np.count_nonzero(drawn):
                return True
    return False


def _all_in_front(seen: Hiding | None) -> Hiding | None:
    """All pixels of others as hidden: starts' depths err; as given where that leaves little."""
    if seen is None:
        return None
    left, shown = (np.count_nonzero(seen.drawn & ~hidden) for hidden in (seen.others, seen.hidden))
    return replace(seen, hidden=seen.others) if left >= MIN_LEFT_FRACTION * shown else seen


def _is_same(known: ComparedView, hidden: Hidden, whole: ComparedView) -> bool:
    """Whether hardly any of the pixels that count are hidden otherwise than is known."""
    if known.hidden is None or hidden is None:
        return known.hidden is hidden
    counted = whole.photo.weights > 0.0
    return bool(np.sum((known.hidden ^ hidden) & counted) < NEW_SHARE * np.sum(counted))


def is_sure(end: FitProgress) -> bool:
    """Whether a pose is probable enough to be trusted; less is asked where something hides it."""
    if end.verdict is None:
        return False
    is_behind = end.verdict.features.get("seen", 1.0) < WHOLE_FROM
    sure_from = SURE_BEHIND if is_behind or end.problem.is_among_others else SURE_FROM
    return end.verdict.probability >= sure_from


def is_restarted(best: FitProgress, is_turned: bool) -> bool:
    """Whether another run follows, from the end of the search before (``is_turned``: turned)."""
    if not (best.may_continue and best.problem.is_structured) or best.verdict is None:
        return False
    is_found = best.verdict.label == "found"
    return not is_sure(best) and not (is_found and is_turned)


def is_taken(after: FitProgress, before: FitProgress, is_turned: bool) -> bool:
    """Whether the pose of a further search replaces that of the one ``before``: by less loss and
    enough probability, since a wrong pose can have less loss than the right one.
    """
    if after.verdict is None or before.verdict is None or after.loss >= before.loss:
        return False
    known = before.verdict.probability
    if not is_turned:
        return after.verdict.probability >= known - PROBABILITY_MARGIN
    return after.verdict.probability >= max(known + PROBABILITY_MARGIN, TURNED_THRESHOLD)


def is_worse(after: FitProgress, before: FitProgress) -> bool:
    """Whether a further round has spoiled an object: what hides it now may stand there wrongly."""
    if after.verdict is None or before.verdict is None:
        return False
    is_spoiled = before.verdict.label == "found" != after.verdict.label
    known = before.verdict.probability - PROBABILITY_MARGIN
    return is_spoiled or after.verdict.probability < known


def is_focal_moved(before: Pose, end: FitProgress) -> bool:
    """Whether a run from a pose has moved focal length or principal point by more than its standard
    deviation, or by more than ``FOCAL_THRESHOLD`` before a verdict; not by the paper's method.
    """
    was, now, known = before.camera, end.pose.camera, end.covariance
    is_searched = end.problem.settings.loss != "paper"
    if not (is_searched and isinstance(was, Perspective) and isinstance(now, Perspective)):
        return False
    moves = {LOG_FOCAL: math.log(now.fx / was.fx)}
    moves |= zip(PRINCIPAL_POINT, principal_offset(was, now), strict=True)
    shares = dict(zip(known.names, np.sqrt(np.diag(known.matrix)), strict=True)) if known else {}
    return any(abs(move) > shares.get(name, FOCAL_THRESHOLD) for name, move in moves.items())
