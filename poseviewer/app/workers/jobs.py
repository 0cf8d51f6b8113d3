"""What runs beside the session as one generator: what is made ready, a search, proposals, a
comparison of models.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from poseviewer.api import Case, make_case
from poseviewer.app.state.candidates import Comparison
from poseviewer.app.state.document import SearchEnd
from poseviewer.app.state.session import (
    MethodEnd,
    Preparation,
    ProposedStarts,
    Search,
    SearchUpdate,
)
from poseviewer.app.workers.views import ends_in_set, set_case_at
from poseviewer.app.workers.worker import lower_priority
from poseviewer.confidence.identify import Identification, identifying
from poseviewer.fit.problem import pose_loss
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import METHODS, FitSettings
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh, kept_lately
from poseviewer.render.pool import processors
from poseviewer.render.renderers import compiled_renderer
from poseviewer.render.types import Renderer
from poseviewer.starts.automatic import propose

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.renderer import SoftwareRenderer


@kept_lately(16)
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
    made = _made_for(mesh)
    if not made:
        made.append(compiled_renderer(mesh))
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
    """What is open, started from ``pose``.

    Raises:
        PoseViewerError: the settings do not go with the photo, the model or the pose.
    """
    return make_case(replace(registration, start=pose), settings, renderer=renderer)


def search(
    registration: Registration, pose: Pose, settings: FitSettings, renderer: Renderer
) -> Iterator[SearchUpdate]:
    """A search from ``pose``, after every evaluation; on all processors where the search knows
    several poses at a time.

    Raises:
        PoseViewerError: the settings do not go with the photo, the model or the pose.
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
    """The search that the session asks for, by each of its methods in turn. Of several methods, the
    last update has the ends of all.

    Raises:
        PoseViewerError: the settings do not go with the photo, the model or the pose.
    """
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


def compare(asked: Comparison) -> Iterator[Identification]:
    """Models told apart, after every evaluation of each fit."""
    settings = asked.document.settings
    return identifying(
        asked.registrations, settings, renderer_of=lambda mesh: renderer_of(mesh).clone()
    )
