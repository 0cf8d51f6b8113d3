"""What runs beside the session as one generator: what is made ready, a search for one object, in a
set of photos or for all objects, proposals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

from poseviewer.api import Case, SetCase, SetResult, make_case, make_set_case
from poseviewer.app.state.document import Document, SceneObject, SearchEnd
from poseviewer.app.state.photo_set import PhotoSet
from poseviewer.app.state.session import (
    MethodEnd,
    Preparation,
    ProposedStarts,
    Search,
    SearchUpdate,
    Together,
)
from poseviewer.app.workers.worker import lower_priority
from poseviewer.confidence.model import judge_end
from poseviewer.confidence.uncertainty import joint_covariance
from poseviewer.errors import SettingsError
from poseviewer.files.pose import PhotoReference
from poseviewer.fit.problem import pose_loss
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.registration import PlacedModel, Registration
from poseviewer.fit.settings import METHODS, FitSettings
from poseviewer.fit.together import ModelToPlace, search_together
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.view_chart import ViewChart
from poseviewer.render.pool import processors
from poseviewer.render.types import Renderer
from poseviewer.starts.automatic import propose
from poseviewer.starts.view_set import SetRegistration, is_seen, require_several

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.renderer import SoftwareRenderer


def compared_of(document: Document, poses: tuple[Pose, ...]) -> dict[int, Registration]:
    """The photos of a set that are compared and see the model at ``poses``, by their numbers, the
    large one first: each with its own mask and region, started there.
    """
    views, mesh = document.views, document.registration.mesh
    assert views is not None  # who asks has a set
    found = {}
    for index in (views.at, *(i for i in range(len(poses)) if i != views.at)):
        if not views.compared[index] or not is_seen(mesh, poses[index]):
            continue
        own, photo = document.own_of_photos[index], views.views.views[index].photo
        mask = own.mask
        if own.region is not None:
            inside = own.region.mask(photo.height, photo.width)
            mask = Mask.of(inside if mask is None else mask.weights * inside)
        found[index] = replace(document.registration, photo=photo, start=poses[index], mask=mask)
    return found


def set_case_at(
    document: Document, pose: Pose, settings: FitSettings, renderer: Renderer
) -> SetCase:
    """The set that is open, started from ``pose`` in its large photo."""
    views = document.views
    assert views is not None  # who asks has a set
    scale = views.scale
    if views.starts[views.at] is pose is not document.pose:
        scale = views.start_scale
    found = compared_of(document, views.views.posed(views.at, pose, scale))
    kept = tuple(views.views.views[index] for index in found)
    require_several(views.views, [view.name for view in kept])
    seen = replace(views.views, views=kept)
    placed = SetRegistration(seen, tuple(found.values()), scale, views.free_size, ())
    return make_set_case(placed, replace(settings, region=None), renderer)


def ends_in_set(case: SetCase, progress: FitProgress, views: PhotoSet) -> tuple[SearchEnd, ...]:
    """Where a search has ended, as each photo of the set has it."""
    result = SetResult(case, progress.parameters, progress)
    filed, problem, mesh = result.record, case.whole.problem, case.whole.registration.mesh
    chart = problem.chart
    assert isinstance(chart, ViewChart)  # that of every set
    first = views.index_of(case.whole.registration.photo)
    poses = views.views.posed(first, filed.pose, chart.scale_at(progress.parameters))
    starts = views.views.posed(first, case.whole.registration.start, chart.scale)
    back = starts[first].camera_from_model.inverse()
    alone = {views.index_of(one.case.registration.photo): one for one in result.views}
    judged = () if progress.verdict is None else progress.verdict.views
    ends = []
    for index, (view, pose) in enumerate(zip(views.views.views, poses, strict=True)):
        record = filed
        if index != first:
            photo, sure = view.photo, None
            if filed.covariance is not None:
                turn = starts[index].camera_from_model @ back
                here = replace(chart, camera=view.camera, view_from_reference=turn)
                sure = joint_covariance(problem, mesh, progress.parameters, judged, pose, here)
            named = PhotoReference(photo.name, photo.width, photo.height, photo.sha256)
            record = replace(
                filed, pose=pose, photo=named, undistortion=photo.undistortion, covariance=sure
            )
        one = alone.get(index)
        word = "" if one is None or one.verdict is None else one.verdict.word
        hidden = None if one is None else one.hidden
        ends.append(SearchEnd(record, hidden, word, filed))
    return tuple(ends)


def search_all(document: Document, objects: Sequence[SceneObject]) -> Iterator[SearchUpdate]:
    """A search for some of a document's objects in turn, until none improves, the others where they
    are; raises as ``search``, and where nothing of any of them is to be seen.
    """
    numbers = [one.number for one in objects]
    left = [one for one in document.objects if one.stands and one.number not in numbers]
    stay = tuple(PlacedModel(one.registration.mesh, one.pose) for one in left)
    models = [
        ModelToPlace(
            replace(one.registration, start=one.pose, others=stay),
            one.settings,
            renderer_of(one.registration.mesh).clone(),
        )
        for one in objects
    ]
    case: Case | None = None
    update: SearchUpdate | None = None
    improvements: tuple[FitProgress, ...] = ()
    restarts: tuple[FitProgress, ...] = ()
    ends: dict[int, SearchEnd] = {}
    for now in search_together(models, judge_end, processors()):
        model, placing, number = models[now.index], now.placings[now.index], numbers[now.index]
        assert placing is not None  # it is the one under way
        progress = placing.progress
        if case is None or case.problem is not placing.problem:
            case = Case(placing.registration, model.settings, placing.problem, model.renderer)
            improvements = restarts = ()
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        if progress.restart > len(restarts):
            restarts = (*restarts, progress)
        if progress.status is not Status.RUNNING:
            ends = {**ends, number: SearchEnd.of(case, progress)}
        together = Together(number, dict(zip(numbers, now.poses, strict=True)), ends)
        update = SearchUpdate(case, progress, improvements, restarts, together=together)
        yield update
    if update is None or update.together is None:
        for model in models:  # says why it cannot be compared, and what to do
            make_case(model.registration, model.settings, model.renderer)
        raise SettingsError("the objects stand wholly behind others: bring one to the front")
    yield replace(update, together=replace(update.together, is_over=True))


@lru_cache(maxsize=16)
def _made_for(mesh: Mesh) -> list[SoftwareRenderer]:
    """A model's renderer, or nothing yet; kept for the models that were at hand lately (renderers
    fill the memory).
    """
    del mesh
    return []


def renderer_of(mesh: Mesh) -> SoftwareRenderer:
    """The renderer of a model, made where there is none; from any thread. Whoever draws in a thread
    of its own clones it.
    """
    from poseviewer.render.software.renderer import SoftwareRenderer

    made = _made_for(mesh)
    if not made:
        made.append(SoftwareRenderer(mesh))
    return made[0]


def has_renderer(mesh: Mesh) -> bool:
    """Whether ``renderer_of`` gives it at once."""
    return bool(_made_for(mesh))


def prepare(mesh: Mesh) -> Iterator[Preparation]:
    """Make ready what draws and compares a model: the kernels, and its renderer."""
    from poseviewer.render.software.compiled import compiling, kernels_are_compiled

    if not kernels_are_compiled():
        yield from map(Preparation, compiling())
    renderer_of(mesh)
    yield Preparation()


def case_at(
    registration: Registration, pose: Pose, settings: FitSettings, renderer: Renderer
) -> Case:
    """What is open, started from ``pose``."""
    return make_case(replace(registration, start=pose), settings, renderer=renderer)


def search(
    registration: Registration, pose: Pose, settings: FitSettings, renderer: Renderer
) -> Iterator[SearchUpdate]:
    """A search from ``pose``, after every evaluation; on all processors where the search knows
    several poses at a time.
    """
    yield from _search(case_at(registration, pose, settings, renderer))


def _search(
    case: Case, found: Callable[[FitProgress], tuple[SearchEnd, ...]] = lambda _: ()
) -> Iterator[SearchUpdate]:
    """``found``: of a set, what its end says of each photo."""
    improvements: tuple[FitProgress, ...] = ()
    restarts: tuple[FitProgress, ...] = ()
    restart = 0
    for progress in case.search(threads=processors()):
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        if progress.restart > restart:
            restart, restarts = progress.restart, (*restarts, progress)
        ends = () if progress.status is Status.RUNNING else found(progress)
        yield SearchUpdate(case, progress, improvements, restarts, of_photos=ends)


def run_search(asked: Search) -> Iterator[SearchUpdate]:
    """The search that the session asks for: for an object alone, by each of its methods in turn (of
    several, the last update has the ends of all), or for some among others.
    """
    if asked.objects:
        yield from search_all(asked.before, asked.objects)
        return
    own, views = asked.before.registration, asked.before.views
    renderer = renderer_of(own.mesh).clone()
    done: list[SearchUpdate] = []
    for settings in asked.methods:
        update = None
        if views is None:
            updates = search(own, asked.start, settings, renderer)
        else:
            of_set = set_case_at(asked.before, asked.start, settings, renderer)
            updates = _search(of_set.whole, partial(ends_in_set, of_set, views=views))
        for update in updates:
            yield update
        assert update is not None  # a search yields at least once
        done.append(update)
    if len(done) > 1:
        yield replace(done[-1], ends=ends_of(done))


def ends_of(done: Sequence[SearchUpdate]) -> tuple[MethodEnd, ...]:
    """The ends of searches by several methods, ours first, each judged by the loss of each."""
    order = list(METHODS)
    done = sorted(done, key=lambda update: order.index(update.case.settings.method))
    return tuple(MethodEnd(end, tuple(_loss_at(by.case, end) for by in done)) for end in done)


def _loss_at(case: Case, end: SearchUpdate) -> float:
    """By a case, where another of the same photos has ended."""
    if case.problem.others:  # whose charts are one
        return pose_loss(case.problem, case.renderer, end.progress.parameters)
    return case.at(end.progress.pose).loss


def propose_starts(asked: ProposedStarts) -> Iterator[tuple[Pose, ...]]:
    """The proposed start poses, once, the likeliest first."""
    query = asked.query
    found = propose(query, renderer_of(query.mesh).clone(), lower_priority).found
    yield tuple(one.pose for one in found)
