"""Workers for preparation, search and proposals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from weakref import WeakSet

import numpy as np

from poseviewer.app.state.document import Document, reference_view
from poseviewer.app.state.dragging import move_to
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.results import (
    LossComparison,
    Preparation,
    ProposedStarts,
    SearchRequest,
)
from poseviewer.app.state.search_edits import (
    list_starts,
    preparation_advanced,
    search_advanced,
    search_failed,
    stop_proposing,
    take_fitted_start,
)
from poseviewer.app.state.session import Session
from poseviewer.app.workers.worker import Worker, lower_priority
from poseviewer.errors import (
    PoseViewerError,
    QuickStartError,
    RendererUnavailableError,
    SettingsError,
    sentence_of,
)
from poseviewer.fit.problem import make_problem, pose_loss
from poseviewer.fit.progress import SearchProgress
from poseviewer.fit.search import Search
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.pose_error import pose_error
from poseviewer.losses.known_losses import LOSSES
from poseviewer.render.attributes import Renderer
from poseviewer.render.overlay.contour import quick_silhouette
from poseviewer.render.pool import processors
from poseviewer.render.renderers import RendererName
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import StartQuery, best_start, propose_about
from poseviewer.starts.instances import propose_beside
from poseviewer.starts.start import StartInputs

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

R = TypeVar("R")

COMPILING_FAILED = (
    "The model cannot be compared with the photo: its kernels could not be compiled; "
    "restart poseviewer, or install numba again"
)


_ready: WeakSet[Mesh] = WeakSet()


def renderer_of(mesh: Mesh, name: RendererName = "auto") -> SoftwareRenderer:
    """The cached renderer of a mesh; clone it to draw in another thread.

    Raises:
        SettingsError: there is no GPU, or the renderer is ``opengl``, which the app lacks.
    """
    field = "choose another one in the step Fit, Settings, Renderer."
    if name == "opengl":
        raise SettingsError(f"The app has no renderer opengl; {field}")
    try:
        return _renderer_of(mesh, name == "gpu")
    except RendererUnavailableError as error:
        raise SettingsError(f"{error} On the page, {field}") from error


@lru_cache(maxsize=16)
def _renderer_of(mesh: Mesh, is_on_gpu: bool) -> SoftwareRenderer:
    if is_on_gpu:
        from poseviewer.render.gpu.gpu_renderer import GpuRenderer

        return GpuRenderer(mesh)
    from poseviewer.render.software.software_renderer import SoftwareRenderer

    renderer = SoftwareRenderer(mesh)
    _ready.add(mesh)
    return renderer


def has_renderer(mesh: Mesh) -> bool:
    """Whether the mesh has its software renderer."""
    return mesh in _ready


def for_one_thread(make: Callable[[SoftwareRenderer], R]) -> Callable[..., R]:
    """Cache ``make(clone)`` for the last arguments of ``renderer_of``; for one worker's thread."""
    return lru_cache(maxsize=1)(lambda *arguments: make(renderer_of(*arguments).clone()))


def prepare(mesh: Mesh) -> Iterator[Preparation]:
    """Compile kernels and make the renderer of a mesh.

    Raises:
        SettingsError: the kernels cannot be compiled.
    """
    from poseviewer.render.software.compiled import compile_steps, kernels_are_compiled

    try:
        if not kernels_are_compiled():
            yield from map(Preparation, compile_steps())
        renderer_of(mesh)
    except Exception as error:
        raise SettingsError(f"{COMPILING_FAILED} ({sentence_of(error)}).") from error


def preparing() -> Worker[Mesh, Edit]:
    """Prepare the active object's model."""

    def request_of(session: Session) -> Mesh | None:
        mesh = session.document.mesh
        return None if has_renderer(mesh) else mesh

    return Worker(
        "preparation",
        request_of,
        lambda mesh: map(preparation_advanced, prepare(mesh)),
        failed=lambda _, error: preparation_advanced(Preparation(trouble=str(error))),
    )


def searching() -> Worker[SearchRequest, Edit]:
    """Search once all is prepared."""
    return Worker(
        "search",
        lambda now: now.search if now.is_searching and not now.preparation else None,
        search_edits,
        failed=lambda request, _: search_failed(request),
    )


def proposing(features: Path | None = None) -> Worker[Document, Edit]:
    """Propose start poses once all is prepared; ``features`` are as those of ``StartQuery``."""

    def request_of(session: Session) -> Document | None:
        is_wanted = session.preparation is None and session.is_proposing
        return session.proposals.document if session.proposals and is_wanted else None

    job = Worker(
        "proposals",
        request_of,
        lambda document: propose_and_fit(document, lambda: job.require_current(document), features),
        failed=lambda *_: stop_proposing(),
        low_priority=True,
    )
    return job


def propose_and_fit(
    document: Document, watch: Callable[[], None], features: Path | None = None
) -> Iterator[Edit]:
    """Propose start poses, and fit a model without a pose from the best; ``watch`` may raise."""
    query = replace(start_query(document), features=features)
    renderer = renderer_of(document.mesh, document.settings.renderer).clone()
    try:
        others = [document.scene.model_at(index, document.view_index) for index in document.others]
        instances = [model for model in others if model.mesh is document.mesh]
        starts = tuple(propose_beside(query, instances, renderer, lower_priority, watch))
        lines = tuple(quick_silhouette(document.mesh, renderer, start.pose) for start in starts)
        yield list_starts(ProposedStarts(document, starts, lines))
        if document.object.is_placed:
            return
        start = best_start(query, starts, renderer, watch)
        best = start.pose
        at_best = move_to(document, best).with_start_here.with_object(doubt=start.doubt)
        settings = at_best.settings
        if best.camera != document.pose.camera:  # a guess by wheels
            settings = replace(settings, free_focal=True)
        request = SearchRequest(at_best, (settings,), (at_best.active,))
        for progress in run_search(request):  # noqa: B007 - the last one is used
            watch()
        errors_px = [pose_error(document.mesh, best, s.pose).reprojection_px for s in starts]
        yield take_fitted_start(document, request, progress, int(np.argmin(errors_px)))
    except PoseViewerError as error:
        has_no_box = query.rectangle is None and isinstance(error, QuickStartError)
        if document.object.is_placed and not has_no_box:
            raise  # else the page says what helps
        yield list_starts(ProposedStarts(document))


def start_query(document: Document) -> StartQuery:
    """Query for start poses of the active object in the large view."""
    region = document.in_view.region
    inputs = StartInputs(document.photo, document.mesh, document.model.keypoints, document.mask)
    settings = replace(document.settings, region=region)
    return StartQuery(inputs, document.pose.camera, document.marks.box or region, settings)


def search_edits(request: SearchRequest) -> Iterator[Edit]:
    """Search by each method in turn; the last edit compares the ends of several."""
    ends: list[SearchProgress] = []
    for settings in request.methods:
        for progress in run_search(request, settings):
            if not progress.is_over:
                yield search_advanced(request, progress)
        ends.append(progress)
    renderer = renderer_of(request.start.mesh).clone()
    comparison = compare_ends(ends, renderer) if len(ends) > 1 else None
    yield search_advanced(request, ends[-1], comparison)


def run_search(
    request: SearchRequest, settings: FitSettings | None = None
) -> Iterator[SearchProgress]:
    """Search by one method, by default the first; yields the progress after every evaluation and
    once more at the end.

    Raises:
        PoseViewerError: an object cannot be compared, or there is no such renderer.
    """
    start, indices = request.start, request.object_indices
    settings = settings or request.methods[0]
    scene = start.scene.with_object(start.active, settings=settings)
    view = reference_view(scene, start.active, start.view_index)
    meshes = {i: scene.compared_mesh(i) for i in indices}
    renderers = {i: renderer_of(mesh, settings.renderer).clone() for i, mesh in meshes.items()}
    progress: SearchProgress | None = None
    for progress in Search(
        scene, renderers, indices, processors(), view, propose=propose_about
    ).run():
        yield progress
    if progress is None:
        for index in indices:
            make_problem(scene, index, view)  # raises the reason
        raise SettingsError("the objects stand wholly behind others: bring one to the front")
    yield replace(progress, is_over=True)


def compare_ends(ends: Sequence[SearchProgress], renderer: Renderer) -> LossComparison:
    """Compare the ends of searches by several losses."""
    order = list(LOSSES)
    ends = tuple(sorted(ends, key=lambda end: order.index(end.settings.loss)))
    losses = [
        [pose_loss(by.problem, renderer, end.progress.parameters) for by in ends] for end in ends
    ]
    mesh = ends[0].problem.mesh
    outlines = tuple(quick_silhouette(mesh, renderer, end.progress.pose) for end in ends)
    return LossComparison(ends, np.array(losses), outlines)
