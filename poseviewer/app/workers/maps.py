"""Maps of the loss about the pose at hand: which are wanted now, and the job that makes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.app.state.display_edits import show_results
from poseviewer.app.state.document import reference_view
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.results import Landscape
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import for_one_thread
from poseviewer.app.workers.worker import Worker, lower_priority
from poseviewer.errors import PoseViewerError
from poseviewer.fit.problem import FitProblem, make_problem
from poseviewer.fit.slices import QUICK_SIZES, quick_level, strides
from poseviewer.fit.slices import landscape as make_slices
from poseviewer.fit.stages import make_stages
from poseviewer.geometry.camera import Pose
from poseviewer.render.attributes import Renderer
from poseviewer.render.pool import RendererPool, processors
from poseviewer.scene.settings import FitSettings, LossName

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

SIZE = 41
SEARCH_MAPS_S = 0.5
"""Seconds between maps that follow a search: the processor is for the search."""


def will_do(begun: Session, asked: Session, busy: bool) -> bool:
    """Whether maps that were begun, and are under way (``busy``) or done, do for what is asked."""
    if _losses_of(begun) != _losses_of(asked):
        return False
    if begun.is_moving and asked.is_moving and busy:
        return True  # coarse maps are soon done; a new start for every step shows none
    return begun.document.pose is asked.document.pose and (asked.is_moving or not begun.is_moving)


def _losses_of(request: Session) -> tuple[object, ...]:
    """Values that are equal where losses are, along the axes of the same camera."""
    search = request.own_progress
    return request.mapped, request.display.half_width, search and search.problem, *request.pixels


def mapping() -> Worker[Session, Edit]:
    """Make the maps that the session asks for, coarse ones while the pose moves."""
    maker = for_one_thread(MapMaker)

    def make(request: Session) -> Iterator[Edit]:
        own = request.document
        try:
            for landscapes in maker(own.mesh, own.settings.renderer).run(request):
                yield show_results(own, landscapes=landscapes, maps_note="")
        except PoseViewerError as error:
            yield show_results(own, maps_note=str(error))

    return Worker(
        "maps",
        lambda now: None if now.preparation else now.request,
        make,
        serves=will_do,
        period_s=lambda now: SEARCH_MAPS_S if now.is_searching else 0.0,
        low_priority=True,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """A loss that is mapped: on the photos, and on coarser ones for quick maps."""

    losses: tuple[object, ...]
    """Values that say which losses it is made for."""
    problem: FitProblem
    start: Pose
    """The pose about which pixels are compared, in the problem's first view."""
    quick: FitProblem
    pool: RendererPool
    """Draws for ``quick``."""


class MapMaker:
    """Makes maps of a model, one after another, for one thread; others of low priority help."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        self._renderer = renderer
        self._fine = _pool(renderer)
        self._cases: dict[LossName, _Case] = {}
        self._is_prepared = False

    def run(self, request: Session) -> Iterator[tuple[Landscape, ...]]:
        """The maps by each loss, coarse to fine, as soon as there is a first grid of each map."""
        cases = [self._case(request, settings) for settings in request.mapped]
        own, width = request.document, request.display.half_width
        known = [
            Landscape(own, case.problem, case.start, own.params_in(case.problem), width)
            for case in cases
        ]
        first, *more = QUICK_SIZES
        for size in (first, *more) if request.is_moving else (first, *more, SIZE):
            if size == SIZE and not self._is_prepared:  # now, and not when it is waited for
                self._is_prepared = True
                make_stages(cases[0].problem, self._renderer)
            for index, case in enumerate(cases):
                coarse, fine = (case.quick, case.pool), (case.problem, self._fine)
                levels = coarse if size < SIZE else fine
                for latest in maps(known[index], *levels, size):
                    known[index] = latest
                    if size != first:
                        yield tuple(known)
            if size == first:
                yield tuple(known)

    def _case(self, request: Session, settings: FitSettings) -> _Case:
        """The case of a loss, made anew where others are compared; as a search has it, if any."""
        before = self._cases.get(settings.loss)
        losses, search = _losses_of(request), request.own_progress
        if before is not None and before.losses == losses:
            return before
        own = request.document
        anchor = request.compared_scene.with_object(own.active, settings=settings)
        view = reference_view(anchor, own.active, own.view_index)
        if search is not None and search.settings == settings:
            problem = search.problem
        else:
            problem, _ = make_problem(anchor, own.active, view)
        numbers, start = own.params_in(problem), anchor.pose(own.active, view)
        levels = [
            quick_level(alone, alone.chart.to_pose(numbers), self._renderer)
            for alone in problem.by_view
        ]
        quick = problem.on([level.photo for level in levels])
        if before is not None:
            before.pool.close()
        case = _Case(losses, problem, start, quick, _pool(levels[0].renderer))
        self._cases[settings.loss] = case
        return case


def _pool(renderer: Renderer) -> RendererPool:
    """Threads for the maps: one processor is left to drawing and to the page."""
    return RendererPool(renderer, threads=max(processors() - 1, 1), begin=lower_priority)


def maps(
    landscape: Landscape, problem: FitProblem, pool: RendererPool, size: int
) -> Iterator[Landscape]:
    """The landscape, after every row of a map, by a problem on its own or on coarser photos."""
    newest = {(piece.first, piece.second): piece for piece in landscape.slices}
    first = strides(size)[0]
    options = {"half_width": landscape.half_width, "size": size, "smooth": True}
    for piece in make_slices(problem, pool, landscape.parameters, **options):
        pair = piece.first, piece.second
        if pair not in newest or bool(np.isfinite(piece.losses[::first, ::first]).all()):
            newest[pair] = piece
        yield replace(landscape, slices=tuple(newest.values()))
