"""Maps of the loss about the current pose, and the worker that makes them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.app.state.document import in_view_alone, reference_view
from poseviewer.app.state.edits import Edit, show_results
from poseviewer.app.state.results import Landscape
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import for_one_thread
from poseviewer.app.workers.worker import Worker, lower_priority
from poseviewer.errors import PoseViewerError
from poseviewer.figures.map_archive import LossMaps
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.slices import QUICK_SIZES, quick_level, strides
from poseviewer.fit.slices import landscape as make_slices
from poseviewer.fit.stages import make_stages
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.losses.loss import LossName
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool, processors
from poseviewer.scene.settings import FitSettings

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

SIZE = 41
SEARCH_MAPS_S = 0.5
"""Period of maps during a search, which needs the processors."""


def serves(begun: Session, request: Session, busy: bool) -> bool:
    """Whether maps that were begun, and are under way (``busy``) or done, answer a request."""
    if _losses_of(begun) != _losses_of(request):
        return False
    if begun.is_moving and request.is_moving and busy:
        return True  # coarse maps are soon done; restarted at every step, they would never be
    is_fine = request.is_moving or not begun.is_moving
    return begun.document.pose is request.document.pose and is_fine


def _losses_of(request: Session) -> tuple[object, ...]:
    """Values that are equal if the losses and the axes of the maps are the same."""
    search = request.own_progress
    return request.mapped, request.display.half_width, search and search.problem, *request.pixels


def mapping() -> Worker[Session, Edit]:
    """Make the maps of the session, only coarse ones while the pose moves."""
    maker = for_one_thread(MapMaker)

    def make(request: Session) -> Iterator[Edit]:
        document = request.document
        try:
            for landscapes in maker(document.compared_mesh, document.settings.renderer).run(
                request
            ):
                yield show_results(document, landscapes=landscapes, maps_note="")
        except PoseViewerError as error:
            yield show_results(document, maps_note=str(error))

    return Worker(
        "maps",
        lambda now: None if now.preparation or not now.display.sees_maps else now.request,
        make,
        serves=serves,
        period_s=lambda now: SEARCH_MAPS_S if now.is_searching else 0.0,
        low_priority=True,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """A loss that is mapped: on the photos, and on coarser ones for quick maps."""

    losses: tuple[object, ...]
    """Result of ``_losses_of``."""
    problem: FitProblem
    start: Pose
    """Pose in the problem's first view about which pixels are compared."""
    quick: FitProblem
    pool: RendererPool
    """Renderers for ``quick``."""


class MapMaker:
    """Makes maps of a model in one thread, helped by others of low priority."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        self._renderer = renderer
        self._fine = _pool(renderer)
        self._cases: dict[LossName, _Case] = {}
        self._is_prepared = False

    def run(self, request: Session) -> Iterator[tuple[Landscape, ...]]:
        """Yield the maps by each loss, coarse to fine, once each map has its first grid."""
        cases = [self._case(request, settings) for settings in request.mapped]
        document, width = request.document, request.display.half_width
        landscapes = [
            Landscape(document, case.problem, case.start, document.params_in(case.problem), width)
            for case in cases
        ]
        first, *more = QUICK_SIZES
        for size in (first, *more) if request.is_moving else (first, *more, SIZE):
            if size == SIZE and not self._is_prepared:  # before a search waits for it
                self._is_prepared = True
                make_stages(cases[0].problem, self._renderer)
            for index, case in enumerate(cases):
                coarse, fine = (case.quick, case.pool), (case.problem, self._fine)
                levels = coarse if size < SIZE else fine
                for landscape in refine_maps(landscapes[index], *levels, size):
                    landscapes[index] = landscape
                    if size != first:
                        yield tuple(landscapes)
            if size == first:
                yield tuple(landscapes)

    def _case(self, request: Session, settings: FitSettings) -> _Case:
        """The case of a loss: cached, with the problem of a search if there is one."""
        before = self._cases.get(settings.loss)
        losses, search = _losses_of(request), request.own_progress
        if before is not None and before.losses == losses:
            return before
        document = request.document
        anchor = request.compared_scene.with_object(document.active, settings=settings)
        anchor = in_view_alone(anchor, document.active, document.view_index)
        view = reference_view(anchor, document.active, document.view_index)
        if search is not None and search.settings == settings:
            problem = search.problem
        else:
            problem, _ = make_problem(anchor, document.active, view)
        params, start = document.params_in(problem), anchor.pose(document.active, view)
        levels = [
            quick_level(alone, alone.chart.to_pose(params), self._renderer)
            for alone in problem.by_view
        ]
        quick = problem.on([level.photo for level in levels])
        if before is not None:
            before.pool.close()
        case = _Case(losses, problem, start, quick, _pool(levels[0].renderer))
        self._cases[settings.loss] = case
        return case


def _pool(renderer: Renderer) -> RendererPool:
    """Renderers for the maps; one processor is left to drawing and the page."""
    return RendererPool(renderer, threads=max(processors() - 1, 1), begin=lower_priority)


def is_fine(landscape: Landscape) -> bool:
    """Whether all maps of a landscape are known on the finest grid."""
    losses = [piece.losses for piece in landscape.slices]
    return all(len(grid) == SIZE and bool(np.isfinite(grid).all()) for grid in losses)


def refine_maps(
    landscape: Landscape, problem: FitProblem, pool: RendererPool, size: int
) -> Iterator[Landscape]:
    """Yield the landscape after every row of a map.

    Args:
        landscape: with coarser maps, or none.
        problem: on the photos, or on coarser ones.
        pool: renderers for the problem.
        size: points along each side of a map.
    """
    newest = {(piece.first, piece.second): piece for piece in landscape.slices}
    first = strides(size)[0]
    options = {"half_width": landscape.half_width, "size": size, "smooth": True}
    for piece in make_slices(problem, pool, landscape.parameters, **options):
        pair = piece.first, piece.second
        if pair not in newest or bool(np.isfinite(piece.losses[::first, ::first]).all()):
            newest[pair] = piece
        yield replace(landscape, slices=tuple(newest.values()))


def covariance_about(landscape: Landscape, session: Session) -> FloatArray | None:
    """(d, d): covariance of the session's pose in the chart of a landscape, if it is known."""
    view = landscape.problem.views[0]
    sure = session.covariance_in(view.view_index)
    with suppress(PoseViewerError, OutsideChartError):
        return None if sure is None else sure.in_chart(view.chart)
    return None


def path_about(landscape: Landscape, session: Session) -> FloatArray | None:
    """(n, d): path of the session's search; None: there is none in the chart of a landscape."""
    request, search = session.search, session.own_progress
    problem = landscape.problem
    if not (request and search and search.problem.chart.names == problem.chart.names):
        return None
    start = request.start
    if start.scene.pose(start.active, problem.views[0].view_index) is not landscape.start:
        return None  # another chart
    return np.array([step.parameters for step in search.improvements])


def maps_about(landscape: Landscape, session: Session) -> LossMaps:
    """The maps as files hold them, with what the session knows of the search."""
    problem = landscape.problem
    photo = landscape.document.scene.views[problem.views[0].view_index].photo
    of_loss = landscape.slices, landscape.half_width, problem, photo
    covariance, path = covariance_about(landscape, session), path_about(landscape, session)
    return replace(LossMaps.about(landscape.parameters, *of_loss), covariance=covariance, path=path)
