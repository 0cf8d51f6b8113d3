"""Jobs beside the session: preparation, search, proposals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar
from weakref import WeakSet

import numpy as np

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document, reference_view
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import (
    Preparation,
    SearchRequest,
    SearchUpdate,
    Session,
    start_query,
)
from poseviewer.app.workers.worker import Job, lower_priority
from poseviewer.errors import PoseViewerError, SettingsError, sentence_of
from poseviewer.fit import search as fit
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.fit.progress import FitProgress, Status
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.render.overlay.contour import quick_silhouette
from poseviewer.render.pool import processors
from poseviewer.render.types import Renderer
from poseviewer.scene.settings import LOSSES
from poseviewer.scene.types import Scene
from poseviewer.starts.automatic import best_start
from poseviewer.starts.instances import propose_beside

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

R = TypeVar("R")

COMPILING_FAILED = (
    "The model cannot be compared with the photo: its kernels could not be compiled; "
    "restart poseviewer, or install numba again"
)


_ready: WeakSet[Mesh] = WeakSet()


@lru_cache(maxsize=16)
def renderer_of(mesh: Mesh) -> SoftwareRenderer:
    """The renderer of a model, from any thread; whoever draws in a thread of its own clones it."""
    from poseviewer.render.software.software_renderer import SoftwareRenderer

    renderer = SoftwareRenderer(mesh)
    _ready.add(mesh)
    return renderer


def has_renderer(mesh: Mesh) -> bool:
    """Whether the model has been made ready."""
    return mesh in _ready


def for_one_thread(make: Callable[[SoftwareRenderer], R]) -> Callable[[Mesh], R]:
    """Keep what a thread of its own makes of the renderer of the model that it was at last."""
    return lru_cache(maxsize=1)(lambda mesh: make(renderer_of(mesh).clone()))


def prepare(mesh: Mesh) -> Iterator[Preparation]:
    """Make ready kernels and renderer of a model; raises ``SettingsError``: none are compiled."""
    from poseviewer.render.software.compiled import compile_steps, kernels_are_compiled

    try:
        if not kernels_are_compiled():
            yield from map(Preparation, compile_steps())
        renderer_of(mesh)
    except Exception as error:
        raise SettingsError(f"{COMPILING_FAILED} ({sentence_of(error)}).") from error


def preparing(notify: Callable[[], None]) -> Job[Mesh, Edit]:
    """Make ready the model at hand."""

    def asked(session: Session) -> Mesh | None:
        mesh = session.document.mesh
        return None if has_renderer(mesh) else mesh

    return Job(
        "preparation",
        asked,
        lambda mesh: map(c.preparation_advanced, prepare(mesh)),
        notify,
        failed=lambda _, error: c.preparation_advanced(Preparation(trouble=str(error))),
    )


def searching() -> Job[SearchRequest, Edit]:
    """Search, as soon as all is ready; the loop looks for its updates."""
    return Job(
        "search",
        lambda now: (
            now.search.asked if now.search and now.searching and not now.preparation else None
        ),
        lambda asked: (c.search_advanced(asked, update) for update in run_search(asked)),
        failed=lambda asked, _: c.search_failed(asked),
    )


def proposing(notify: Callable[[], None]) -> Job[Document, Edit]:
    """Propose start poses, as soon as all is ready."""

    def asked(session: Session) -> Document | None:
        wanted = session.proposals if session.preparation is None else None
        return wanted.document if wanted is not None and not wanted.is_over else None

    def make(document: Document) -> Iterator[Edit]:
        return proposed(document, lambda: job.require_asked(document))

    job = Job(
        "proposals",
        asked,
        make,
        notify,
        failed=lambda *_: c.stop_proposing(),
        low_priority=True,
    )
    return job


def proposed(document: Document, watch: Callable[[], None]) -> Iterator[Edit]:
    """Propose start poses, and fit the best of them for a model that is nowhere yet; that it is not
    seen is an error for a model that is placed alone. ``watch`` may raise to stop it.
    """
    query, renderer = start_query(document), renderer_of(document.mesh).clone()
    try:
        placed = [document.scene.placed(index, document.at) for index in document.others]
        same = [one for one in placed if one.mesh is document.mesh]
        starts = tuple(propose_beside(query, same, renderer, lower_priority, watch))
        lines = tuple(quick_silhouette(document.mesh, renderer, one.pose) for one in starts)
        yield c.starts_proposed(document, starts, lines)
        if document.object.is_placed:
            return
        best = best_start(query, starts, renderer, watch).pose
        begun = c.put(document, best).started
        asked = SearchRequest(begun, (begun.settings,), (begun.active,))
        for update in run_search(asked):  # noqa: B007 - the last one is what is wanted
            watch()
        away = [pose_error(document.mesh, best, one.pose).reprojection_px for one in starts]
        yield c.start_fitted(document, asked, update, int(np.argmin(away)))
    except PoseViewerError:
        if document.object.is_placed:
            raise
        yield c.starts_proposed(document, (), ())


def run_search(asked: SearchRequest) -> Iterator[SearchUpdate]:
    """The search that the session asks for, after every evaluation, by each of its losses in turn;
    of several, the last update has the ends of all. Raises as ``make_problem``.
    """
    done: list[SearchUpdate] = []
    for settings in asked.methods:
        scene = asked.start.scene.with_object(asked.start.active, settings=settings)
        view = reference_view(scene, asked.start.active, asked.start.at)
        for update in _search(scene, asked.indices, view):
            yield update
        done.append(update)
    mesh = asked.start.mesh
    ends = ends_of(done, mesh, renderer_of(mesh).clone()) if len(done) > 1 else ()
    yield replace(done[-1], is_over=True, ends=ends)


def _search(scene: Scene, indices: tuple[int, ...], view: int) -> Iterator[SearchUpdate]:
    objects = scene.objects
    renderers = {i: renderer_of(objects[i].mesh).clone() for i in indices}
    search = fit.Search(scene, renderers, indices, processors(), view)
    update: SearchUpdate | None = None
    improvements: tuple[FitProgress, ...] = ()
    restarts: tuple[FitProgress, ...] = ()
    for now in search.run():
        index, progress = now.index, now.progress
        evaluations = update.progress.evaluations if update and index == update.index else math.inf
        if progress.evaluations < evaluations:
            improvements = restarts = ()
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        if progress.restart > len(restarts):
            restarts = (*restarts, progress)
        ended = {*now.placings} - ({index} if progress.status is Status.RUNNING else set())
        results = {i: search.scene.objects[i].result for i in ended}
        settings = objects[index].settings
        update = SearchUpdate(index, now.placings, results, settings, improvements, restarts)
        yield update
    if update is None:
        for index in indices:
            make_problem(scene, index, view)  # says why it cannot be compared, and what to do
        raise SettingsError("the objects stand wholly behind others: bring one to the front")


def ends_of(
    done: Sequence[SearchUpdate], mesh: Mesh, renderer: Renderer
) -> tuple[SearchUpdate, ...]:
    """The ends of searches by several losses, ours first, each judged by the loss of each."""
    order = list(LOSSES)
    done = sorted(done, key=lambda update: order.index(update.settings.loss))
    return tuple(
        replace(
            end,
            losses=tuple(pose_loss(by.problem, renderer, end.progress.parameters) for by in done),
            outline=quick_silhouette(mesh, renderer, end.progress.pose),
        )
        for end in done
    )
