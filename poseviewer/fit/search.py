"""Search for objects of a scene: runs of the stages, occlusion, verdicts, restarts and turns.

A search runs the stages (``fit.stages``) from the start, and again while focal length or principal
point move far. It continues without the pixels on which something else stands in front
(``fit.occlusion``), and ends with a verdict on its pose. A pose that is not trusted is searched
on: from where it is, and at last turned about a principal axis of the model. The verdict decides
whether the new pose is accepted. The model's proportions are checked on a pose that is found
(``fit.proportions``). A start that is an estimate is restored where the end is not sure to be
better.

Objects occlude one another by all their poses, so their searches take turns. The most visible
object goes first, and each is compared on the pixels that trusted objects do not occlude. An object
is searched for again when these pixels have changed since.
"""

import math
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from msgspec import structs

from poseviewer.confidence.verdict import (
    LABELS,
    LOST_BELOW,
    PROBABILITY_MARGIN,
    SURE_FROM,
    SURE_IF_OCCLUDED,
    WHOLE_FROM,
    Features,
    Verdict,
    among,
    judge_together,
)
from poseviewer.fit.compared_pixels import ViewResidual, enlarge_mask
from poseviewer.fit.judge import bare_renderer, judge_end
from poseviewer.fit.occlusion import OcclusionMask, find_occluded
from poseviewer.fit.problem import (
    FitProblem,
    Occlusions,
    make_problem,
    occlusions,
    pose_loss,
    pose_to_params,
    views_that_show,
    with_params,
)
from poseviewer.fit.progress import FitProgress, SearchProgress, Status
from poseviewer.fit.proportions import other_proportions
from poseviewer.fit.stages import StageMaker, fit_pose, make_stages
from poseviewer.fit.survey import apart_note, join, survey, with_residuals
from poseviewer.fit.view_choice import MAX_SEARCHED
from poseviewer.fit.visibility import Occlusion, visibility
from poseviewer.geometry.camera import Perspective, Pose, principal_offset
from poseviewer.geometry.charts import LOG_FOCAL, PRINCIPAL_POINT
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.attributes import Renderer
from poseviewer.render.pyramid.levels import visible_fraction
from poseviewer.scene.settings import settings_as_json
from poseviewer.scene.types import ChartParameters, Scene, SearchResult

MAX_CONTINUATIONS = 3
"""Searches continued from the end of the one before, until the pose is trusted."""
GAIN_THRESHOLD = 0.1
"""Loss that the last search must have gained to be continued, and to be probed anew."""
OCCLUSION_PASSES = 2
"""Searches for occluded pixels: the second corrects those of a pose that was still off."""
NEW_OCCLUSION_FRACTION = 0.03
"""Fraction of the pixels that count by which the occlusion must change to search again."""
MAX_RUNS = 4
"""Runs of the stages before a verdict: occlusion by other objects mostly settles after two."""
FOCAL_THRESHOLD = 0.02
"""Relative change of the focal length, and shift of the principal point as a fraction of the photo,
that continue a run before their deviations are known."""
LAST_MOVE_PERCENT = 1.0
"""Move in a run's last stage, in % of the model's size, that shows it has left its valley."""
CHANGED_FRACTION = 0.05
"""Fraction of an object's pixels that others occlude or free: less hardly moves its minimum."""
MIN_LEFT_FRACTION = 0.5
"""Fraction of the visible pixels left if all others were in front, to search first as if so."""
MAX_ROUNDS = 4
"""Searches of one object: two objects that slide along each other would alternate for ever."""


LOST = Verdict("lost", 0.0)
"""Verdict of an end that was not judged."""
LOST_RANK, FOUND_RANK = LABELS.index("lost"), LABELS.index("found")
"""Ranks of lost and found ends."""
APART_PERCENT = 2.0
"""Distance, in % of the model's size, from which two ends are different poses."""
MAX_PROPOSALS = 3
"""Further starts from which a search goes on: the right one is seldom a later one."""

Propose = Callable[[Scene, int, int], Sequence[Pose]]
"""Function that proposes starts, the likeliest first, about where an object stands in a view: of
the scene, the object's index and the view's; such as ``starts.automatic.propose_about``."""
Outcome = TypeVar("Outcome")
Steps = Generator[SearchProgress, None, Outcome]


class Search:
    """A search for some of a scene's objects; the others stay where they are."""

    def __init__(
        self,
        scene: Scene,
        renderers: Mapping[int, Renderer],
        object_indices: Sequence[int] = (0,),
        threads: int = 1,
        view_index: int = 0,
        stages: StageMaker = make_stages,
        propose: Propose | None = None,
    ) -> None:
        """Prepare the search.

        Args:
            scene: scene with the objects at their starts.
            renderers: renderer of each searched object, for one thread at a time.
            object_indices: indices of the objects to search for.
            threads: number of threads; more give the same poses in less time.
            view_index: index of the view whose chart is searched.
            stages: maker of the pyramid levels and minimisers.
            propose: proposes further starts where a search ends at a pose that is not sure.
        """
        self._make_stages, self._propose = stages, propose
        self._start = scene
        self._renderers, self._judges = renderers, dict[int, Renderer]()
        self._threads = threads
        self._object_indices, self._view_index = tuple(object_indices), view_index
        self.scene = scene
        """Scene with the poses and results of the searches that are over."""
        self._now: SearchProgress | None = None
        self._progress_by_object: dict[int, FitProgress] = {}
        self._last_problems: dict[int, FitProblem] = {}
        """Problem of each object's last search, whether its end was accepted or not."""
        self._object_index, self._began = self._object_indices[0], 0.0
        self._is_far = False
        """Whether the last run's last stage moved far: it may have ended on a valley's side."""

    def run(self) -> Steps[None]:
        """Search, and yield the progress after every evaluation; stop iterating to stop it.

        An object's last progress has a verdict. Nothing is yielded where each object stands wholly
        behind others.

        Raises:
            SettingsError: the settings do not go with a photo, a model or its start.
            SingularChartError: the wanted chart has no parameters at a start.
        """
        for _ in range(MAX_ROUNDS):
            due, was_searched = set(self._object_indices), False
            while due:
                object_index = self._most_visible(due)
                due.remove(object_index)
                occluded = occlusions(self.scene, object_index, self._view_index)
                before = self._progress_by_object.get(object_index)
                is_total = all(own is not None and own.is_total for own in occluded.values())
                if is_total or (
                    before is not None and not _differ(self._last_problems[object_index], occluded)
                ):
                    continue
                if before is None and len(self._object_indices) == 1:
                    occluded = {view: _all_in_front(own) for view, own in occluded.items()}
                self._object_index = object_index
                self._began = time.perf_counter()
                was_searched = True
                yield from self._search_object(occluded)
                self._last_problems[object_index] = self._progress_by_object[object_index].problem
                if before is not None and is_worse(self._progress_by_object[object_index], before):
                    yield self._publish(before)
            if not was_searched:
                return

    def stop(self, now: SearchProgress) -> SearchProgress:
        """Return the best pose of an interrupted search, with its verdict."""
        if now.progress.status is not Status.RUNNING:
            return now
        self._object_index = now.object_index
        return self._publish(self._judge(replace(now.progress, status=Status.STOPPED)))

    @property
    def _renderer(self) -> Renderer:
        return self._renderers[self._object_index]

    def _publish(self, progress: FitProgress) -> SearchProgress:
        """Add a progress of the current object to that of the search."""
        now = self._now
        improvements = restarts = tuple[FitProgress, ...]()
        self._progress_by_object = {**self._progress_by_object, self._object_index: progress}
        if progress.status is not Status.RUNNING:
            self.scene = with_end(self.scene, self._object_index, progress, self._renderer)
        is_going_on = now is not None and now.object_index == self._object_index
        if now and is_going_on and progress.evaluations >= now.progress.evaluations:
            improvements, restarts = now.improvements, now.restarts
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        if progress.restart > len(restarts):
            restarts = (*restarts, progress)
        known = self._progress_by_object, improvements, restarts
        self._now = SearchProgress(self.scene, self._object_index, *known)
        return self._now

    def _judge(self, progress: FitProgress, before: FitProgress | None = None) -> FitProgress:
        """Add the verdict on the pose; one that hardly gained on that ``before`` has its rivals."""
        index = self._object_index
        if index not in self._judges:
            mesh = self.scene.objects[index].mesh
            self._judges[index] = bare_renderer(mesh, self._renderer)
        judge = self._judges[index]
        known = None if before is None or before.verdict is None else before.verdict.features
        if before is None or not known or before.loss - progress.loss >= GAIN_THRESHOLD:
            judged = judge_end(progress, judge, self._threads)
        else:
            judged = judge_end(progress, judge, self._threads, Features(**known))
            judged = replace(judged, rival=before.rival)
        return replace(judged, seconds=time.perf_counter() - self._began)

    def _most_visible(self, due: set[int]) -> int:
        """Return the object of which all others occlude the smallest fraction."""
        if len(due) == 1:
            return next(iter(due))
        standing = [i for i, one in enumerate(self.scene.objects) if i in due or not one.hidden]
        shown = visibility([self.scene.model_at(i, self._view_index) for i in standing])
        visible = dict(zip(standing, shown.visible_fractions, strict=True))
        return max(sorted(due), key=lambda i: visible[i])

    def _search_object(self, occluded: Occlusions) -> Steps[None]:
        """Search for the current object, of which others occlude some pixels."""
        # Occlusion is found again after the coarsest level and after each run. Verdict and restarts
        # follow when it has settled: on wrong pixels they would be in vain.
        problem = self._make_problem(occluded)
        has_occluders, gain = problem.has_occluders, math.inf
        if self._object_index in self._progress_by_object:  # searched before: continue from there
            scale = self.scene.objects[self._object_index].world_from_model.scale
            pose = self.scene.pose(self._object_index, problem.views[0].view_index)
            problem = replace(problem, start=pose_to_params(problem.chart, pose, scale))
        before = problem.poses(problem.start)[0]
        is_coarse = has_occluders and problem.loss.has_structure
        best = yield from self._run(problem, is_coarse=is_coarse)
        for _ in range(1, MAX_RUNS):
            scene = with_params(self.scene, self._object_index, best.problem, best.parameters)
            occluded = self._occlusions_in(scene, best.problem)
            is_same = not _differ(best.problem, occluded)
            is_far = self._is_far or is_focal_moved(before, best)
            is_settled = is_same and not is_coarse and not is_far
            if is_settled or not best.may_continue:
                break
            best = best if is_same else self._rescore(self._make_problem(occluded), best)
            before = best.pose
            loss = best.loss
            is_coarse = False
            best = yield from self._run(best.problem, best)
            gain = loss - best.loss if has_occluders else math.inf
        best = self._check_proportions((yield from self._finish(best, gain)))
        best = yield from self._try_proposals(best, occluded)
        best = yield from self._survey(best)
        is_unsure = best.verdict is not None and not is_sure(best)
        yield self._publish(
            self._restore_start(best) if is_unsure and problem.settings.keep_start else best
        )

    def _run(
        self,
        problem: FitProblem,
        before: FitProgress | None = None,
        shown: FitProgress | None = None,
        **how: Any,
    ) -> Steps[FitProgress]:
        """Run the stages, and publish the pose of ``shown`` meanwhile, by default their own."""
        end = last = before
        how["make"] = self._make_stages
        for end in fit_pose(problem, self._renderer, self._threads, before, **how):
            last = end if last is None or end.restart != last.restart else last
            if end.status is Status.RUNNING:
                yield self._publish(end if shown is None else end.keeping(shown))
        assert end is not None  # a run yields at least once
        assert last is not None
        apart = pose_error(problem.mesh, last.pose, end.pose, problem.symmetry)
        self._is_far = problem.loss.has_structure and apart.percent > LAST_MOVE_PERCENT
        return end

    @property
    def _scene_at_start(self) -> Scene:
        """The scene with the object at its start, the others where they are now."""
        start = self._start.objects[self._object_index].world_from_model
        return self.scene.with_object(self._object_index, world_from_model=start)

    def _make_problem(self, occluded: Occlusions) -> FitProblem:
        """Make the problem about the start of the object."""
        return make_problem(self._scene_at_start, self._object_index, self._view_index, occluded)[0]

    def _occlusions_in(self, scene: Scene, problem: FitProblem) -> Occlusions:
        """Occlusion in a scene; where it is total or unknown, that of the ``problem``."""
        now = occlusions(scene, self._object_index, problem.views[0].view_index)
        known = {view.view_index: view.occlusion for view in problem.views}
        return {
            view_index: old if (new := now.get(view_index)) is None or new.is_total else new
            for view_index, old in known.items()
        }

    def _rescore(self, problem: FitProblem, best: FitProgress) -> FitProgress:
        """Evaluate the best pose so far, and the start, on the pixels of a ``problem``."""
        loss, start_loss = (
            pose_loss(problem, self._renderer, at) for at in (best.parameters, problem.start)
        )
        return replace(best, problem=problem, loss=loss, start_loss=start_loss)

    def _finish(self, best: FitProgress, gain: float) -> Steps[FitProgress]:
        """Leave out occluded pixels, judge and restart; ``gain`` is the last run's, in loss."""
        whole, pose_before = best.problem, best.pose
        is_looked_for = whole.settings.in_front == "find"
        for _ in range(OCCLUSION_PASSES):
            if not (best.may_continue and whole.loss.has_structure and is_looked_for):
                break
            views = best.problem.views
            poses = whole.poses(best.parameters)
            masks = []
            for view, old, pose in zip(whole.views, views, poses, strict=True):
                new = find_occluded(view.photo, self._renderer, pose)
                masks.append(old.occluded if new is None else new)
            if all(map(_is_same, views, masks, whole.views)):
                break
            left = map(ViewResidual.without, whole.views, masks)
            before, pose_before = self._rescore(replace(whole, views=tuple(left)), best), best.pose
            best, gain = (yield from self._run(before.problem, before, before)), math.inf
        best = self._judge(best)
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
                rival = best.rival_parameters
                if rival is None:
                    break
                before = replace(best, parameters=rival)
            after = yield from self._run(best.problem, before, best, seed=seed)
            if after.loss < best.loss:
                after = self._judge(after, None if is_turned else best)
            loss = best.loss
            is_better = is_accepted(after, best, is_turned)
            best = after if is_better else after.keeping(best)
            gain = loss - best.loss
            if is_better and is_turned and best.problem is not whole:
                # What was left out was told from the pose before.
                return (yield from self._finish(self._rescore(whole, best), math.inf))
        return best

    def _try_proposals(self, end: FitProgress, occluded: Occlusions) -> Steps[FitProgress]:
        """Search from proposed starts, too, where the end is not sure: the start may have been too
        far off.
        """
        settings, verdict = end.problem.settings, end.verdict
        is_one_view = len(end.problem.views) == 1
        is_wanted = is_one_view and end.problem.loss.has_structure and not settings.lock
        if not is_wanted or self._propose is None or settings.keep_start or end.problem.doubt:
            return end
        if verdict is None or is_sure(end) or not end.may_continue:
            return end
        view_index, index = end.problem.views[0].view_index, self._object_index
        at_end = with_params(self.scene, index, end.problem, end.parameters)
        view, ends = self.scene.views[view_index], [end]
        for pose in self._propose(at_end, index, view_index)[:MAX_PROPOSALS]:
            scene = self.scene.with_object(index, world_from_model=view.world_from_model(pose))
            problem = make_problem(scene, index, self._view_index, occluded)[0]
            after = yield from self._run(problem, spend(FitProgress.at_start(problem), ends[-1]))
            after = self._check_proportions((yield from self._finish(after, math.inf)))
            if after.verdict is not None:
                after = replace(after, verdict=among(after.verdict, len(ends) + 1))
            ends.append(after)
            if is_sure(after) or not after.may_continue:
                break
        return spend(choose_end(ends), ends[-1])

    def _survey(self, end: FitProgress) -> Steps[FitProgress]:
        """Look at the end in all views, where the search has compared some of them."""
        index, first = self._object_index, end.problem.views[0].view_index
        shown = views_that_show(self.scene, index, self._view_index)
        verdict, problem = end.verdict, end.problem
        if verdict is None or verdict.label == "lost" or not end.may_continue:
            return end
        if len(shown) <= MAX_SEARCHED or len(problem.views) == 1:
            return end
        probed = next((Features(**one.features) for one in verdict.views if one.features), None)
        scene, each = with_params(self.scene, index, problem, end.parameters), []
        searched = [view.view_index for view in problem.views]
        order = [*searched, *(number for number in shown if number not in searched)]
        for view in survey(scene, index, order, probed, self._judges[index], self._threads):
            each.append(view)
            seconds = time.perf_counter() - self._began
            yield self._publish(replace(end, status=Status.RUNNING, seconds=seconds))
            if seconds >= problem.settings.limits.seconds:
                end = replace(end, status=Status.SECONDS_SPENT, seconds=seconds)
                break
        if len(each) < len(searched):  # they tell less than the search
            return end
        each.sort(key=lambda view: (view.view_index != first, view.view_index))
        pose, scale = scene.pose(index, first), scene.objects[index].world_from_model.scale
        if not problem.settings.lock:  # the views know of no locks
            pose, scale = join(scene, index, each, first)
        each = with_residuals(scene.with_pose(index, pose, first, scale), index, each)
        parameters = end.parameters.copy()
        moved = pose_to_params(problem.chart, pose, scale)
        parameters[:6] = moved[:6]
        if scene.free_scale:
            parameters[-1] = moved[-1]
        verdict = judge_together([view.verdict for view in each])
        return replace(
            end,
            parameters=parameters,
            pose=problem.chart.to_pose(parameters),
            loss=pose_loss(problem, self._renderer, parameters),
            seconds=time.perf_counter() - self._began,
            verdict=verdict,
            covariance=end.covariance and replace(end.covariance, pose=pose),
            surveyed=tuple(each),
        )

    def _check_proportions(self, end: FitProgress) -> FitProgress:
        """Judge whether other proportions of the model explain the only photo as well or better."""
        verdict, (view, *others) = end.verdict, end.problem.views
        if verdict is None or verdict.label != "found" or others:
            return end
        other = other_proportions(end.problem, self._renderer, end.pose, self._threads)
        if other is None:
            return end
        photo = self.scene.views[view.view_index].photo
        is_assumed = bool(photo.focal_note(end.pose.camera))
        other = replace(other, is_focal_assumed=is_assumed)
        if other.is_better:
            reasons = (str(other), *verdict.reasons)
            verdict = structs.replace(verdict, label="doubtful", reasons=reasons)
        else:
            verdict = structs.replace(verdict, reasons=(*verdict.reasons, str(other)))
        return replace(end, verdict=verdict, seconds=time.perf_counter() - self._began)

    def _restore_start(self, end: FitProgress) -> FitProgress:
        """Restore the start, with its own verdict, which says how far away the ``end`` was."""
        problem = self._make_problem(self._occlusions_in(self._scene_at_start, end.problem))
        start = problem.chart.to_pose(problem.start)
        kept = replace(end, parameters=problem.start, pose=start, status=Status.KEPT)
        kept = self._judge(self._rescore(problem, kept))
        assert end.verdict is not None  # it is why the start is restored
        assert kept.verdict is not None
        away = pose_error(problem.mesh, end.pose, start, problem.symmetry).percent
        reason = (
            f"The start was kept: the search ended {away:.0f} % of the model's size away, where "
            f"{end.verdict.share_right}."
        )
        reasons = (reason, *kept.verdict.reasons)
        return replace(kept, verdict=structs.replace(kept.verdict, reasons=reasons))


def with_end(scene: Scene, object_index: int, progress: FitProgress, renderer: Renderer) -> Scene:
    """Put an object of a scene where its search has ended, with its result.

    Args:
        scene: scene to change.
        object_index: index of the object.
        progress: last progress of the search.
        renderer: renderer of the object.
    """
    problem, parameters = progress.problem, progress.parameters
    scene = with_params(scene, object_index, problem, parameters)
    visible: list[float | None] = [None] * len(scene.views)
    masks: list[OcclusionMask] = [None] * len(scene.views)
    for surveyed in progress.surveyed:
        visible[surveyed.view_index] = surveyed.verdict.features.get("seen", 0.0)
    for view, pose in zip(problem.views, problem.poses(parameters), strict=True):
        visible[view.view_index] = visible_fraction(view.photo, renderer, pose)
        if view.occluded is not None:
            photo, factor = scene.views[view.view_index].photo, view.photo.factor
            mask = enlarge_mask(view.occluded, factor, photo.width, photo.height)
            masks[view.view_index] = mask
    result = make_search_result(scene, object_index, progress)
    result = replace(result, seen=tuple(visible), hidden=tuple(masks))
    return scene.with_object(object_index, result=result)


def make_search_result(scene: Scene, object_index: int, progress: FitProgress) -> SearchResult:
    """Make the result of a search, with a note on the view that agrees least with the others."""
    problem, verdict = progress.problem, progress.verdict
    first = scene.views[problem.views[0].view_index]
    notes = [first.photo.focal_note(problem.chart.to_pose(progress.parameters).camera)]
    verdicts = () if verdict is None else verdict.views
    surveyed = progress.surveyed
    residuals = dict.fromkeys(range(len(scene.views) if surveyed else 0), None)
    residuals |= {view.view_index: view.residual_px for view in surveyed}
    if surveyed:
        notes.append(apart_note(scene, surveyed))
        if progress.status is Status.SECONDS_SPENT:
            said = f"{len(surveyed)} of {len(scene.views)} photos were looked at"
            notes.append(f"{said} before `Limits.seconds`; raise it to look at all.")
    elif any(one.label != "found" for one in verdicts):
        worst = min(range(len(verdicts)), key=lambda number: verdicts[number].probability)
        notes.append(
            f"{scene.views[problem.views[worst].view_index].name} goes least with the others: "
            "something may hide the model there, or its camera may disagree with theirs."
        )
    settings = settings_as_json(scene.objects[object_index].settings)
    parameters = tuple(progress.parameters.tolist())
    return SearchResult(
        loss=progress.loss,
        unexplained=progress.unexplained,
        verdict=verdict,
        chart=ChartParameters(problem.chart.name, problem.chart.names, parameters),
        settings={**settings, "photo_channels": problem.photo.channels.shape[2]},
        notes=tuple(filter(None, notes)),
        view=problem.views[0].view_index,
        covariance=progress.covariance,
        residuals_px=tuple(residuals.values()),
    )


def _differ(problem: FitProblem, now: Occlusions) -> bool:
    """Tell whether the occlusion of an object differs from that in a ``problem``."""
    for view in problem.views:
        pair = [view.occlusion, now.get(view.view_index, view.occlusion)]
        known = [occlusion for occlusion in pair if occlusion is not None]
        if known:
            silhouette = known[0].silhouette
            changed = np.logical_xor.reduce([own.occluded for own in known]) & silhouette
            if np.count_nonzero(changed) > CHANGED_FRACTION * np.count_nonzero(silhouette):
                return True
    return False


def _all_in_front(own: Occlusion | None) -> Occlusion | None:
    """Count all pixels of occluders as occluded, as starts' depths err, if enough is left."""
    if own is None:
        return None
    left, visible = (
        np.count_nonzero(own.silhouette & ~mask) for mask in (own.occluders, own.occluded)
    )
    return replace(own, occluded=own.occluders) if left >= MIN_LEFT_FRACTION * visible else own


def _is_same(known: ViewResidual, mask: OcclusionMask, whole: ViewResidual) -> bool:
    """Tell whether ``mask`` is known but for a few of the pixels that count."""
    if known.occluded is None or mask is None:
        return known.occluded is mask
    counted = whole.photo.weights > 0.0
    new = np.sum((known.occluded ^ mask) & counted)
    return bool(new < NEW_OCCLUSION_FRACTION * np.sum(counted))


def is_sure(end: FitProgress) -> bool:
    """Tell whether a pose is probable enough to be trusted; an occluded one needs less."""
    if end.verdict is None:
        return False
    is_occluded = end.verdict.features.get("seen", 1.0) < WHOLE_FROM
    sure_from = SURE_IF_OCCLUDED if is_occluded or end.problem.has_occluders else SURE_FROM
    return end.verdict.probability >= sure_from


def is_restarted(best: FitProgress, is_turned: bool) -> bool:
    """Tell whether another run follows from the ``best`` pose, or from it turned."""
    if not (best.may_continue and best.problem.loss.has_structure) or best.verdict is None:
        return False
    is_found = best.verdict.label == "found"
    return not is_sure(best) and not (is_found and is_turned)


def is_accepted(after: FitProgress, before: FitProgress, is_turned: bool) -> bool:
    """Tell whether the pose of a further search replaces the one ``before``.

    It needs less loss and enough probability: a wrong pose can have less loss than the right one.
    """
    if after.verdict is None or before.verdict is None or after.loss >= before.loss:
        return False
    known = before.verdict.probability
    if not is_turned:
        return after.verdict.probability >= known - PROBABILITY_MARGIN
    return after.verdict.probability >= max(known + PROBABILITY_MARGIN, LOST_BELOW)


def spend(progress: FitProgress, spent: FitProgress) -> FitProgress:
    """Count evaluations, restarts and seconds from those of another progress."""
    counts = {"evaluations": spent.evaluations, "restart": spent.restart}
    return replace(progress, **counts, seconds=spent.seconds)


def choose_end(ends: Sequence[FitProgress]) -> FitProgress:
    """Return the likeliest of the ends of searches from several starts, the given one first.

    The given start is evidence, too: its end stays unless it is lost, or another is sure. Where
    others lie elsewhere it says so, and only a sure pose stays ``found`` beside one that is.
    """

    def rank(end: FitProgress) -> tuple[int, float]:
        verdict = end.verdict or LOST
        return LABELS.index(verdict.label), verdict.probability

    def away(end: FitProgress) -> float:
        return pose_error(best.problem.mesh, end.pose, best.pose, best.problem.symmetry).percent

    first, best = ends[0], max(ends, key=rank)
    is_first_lost = rank(first)[0] == LOST_RANK < rank(best)[0]
    best = best if is_sure(best) or is_first_lost else first
    is_rivalled = any(rank(end)[0] == FOUND_RANK and away(end) > APART_PERCENT for end in ends)
    if best.verdict is None or not (is_rivalled or away(first) > APART_PERCENT):
        return best
    reason = "Searches from other starts end at another pose that looks right, too."
    if away(first) > APART_PERCENT:
        start = "the given start, which may be far off, the search ended"
        reason = f"Found from another start: from {start} {away(first):.0f} % of its size away."
    is_doubted = best.verdict.label == "found" and not is_sure(best)
    label = "doubtful" if is_doubted else best.verdict.label
    reasons = (*best.verdict.reasons, reason)
    return replace(best, verdict=structs.replace(best.verdict, label=label, reasons=reasons))


def is_worse(after: FitProgress, before: FitProgress) -> bool:
    """Tell whether a further round has spoiled an object, as by an occluder at a wrong pose."""
    if after.verdict is None or before.verdict is None:
        return False
    is_spoiled = before.verdict.label == "found" != after.verdict.label
    known = before.verdict.probability - PROBABILITY_MARGIN
    return is_spoiled or after.verdict.probability < known


def is_focal_moved(before: Pose, end: FitProgress) -> bool:
    """Tell whether a run moved focal length or principal point by more than its deviation.

    Before a verdict, ``FOCAL_THRESHOLD`` stands for it. See ``Loss.is_continued``, too.
    """
    was, now = before.camera, end.pose.camera
    known = end.covariance
    if not (isinstance(was, Perspective) and isinstance(now, Perspective)):
        return False
    if not end.problem.loss.is_continued:
        return False
    moves = {LOG_FOCAL: math.log(now.fx / was.fx)}
    moves |= zip(PRINCIPAL_POINT, principal_offset(was, now), strict=True)
    shares = dict(zip(known.names, np.sqrt(np.diag(known.matrix)), strict=True)) if known else {}
    return any(abs(move) > shares.get(name, FOCAL_THRESHOLD) for name, move in moves.items())
