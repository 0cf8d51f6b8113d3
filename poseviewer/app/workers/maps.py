"""Maps of the loss about the pose at hand: which are wanted now, and the job that makes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from poseviewer import api
from poseviewer.app.state.commands import show
from poseviewer.app.state.document import reference_view
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import LandscapeUpdate, Session
from poseviewer.app.workers.jobs import for_one_thread
from poseviewer.app.workers.worker import Job, lower_priority
from poseviewer.errors import PoseViewerError
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.slices import QUICK_SIZES, Slice, landscape, quick_level, strides
from poseviewer.fit.stages import make_stages
from poseviewer.render.pool import RendererPool, processors
from poseviewer.render.types import Renderer
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
    if begun.moving and asked.moving and busy:
        return True  # coarse maps are soon done; a new start for every step shows none
    return begun.document.pose is asked.document.pose and (asked.moving or not begun.moving)


def _losses_of(request: Session) -> tuple[object, ...]:
    """Values that are equal where losses are, along the axes of the same camera."""
    search = request.own_search
    return request.mapped, request.half_width, search and search.problem, *request.pixels


def mapping() -> Job[Session, Edit]:
    """Make the maps of the losses that the session asks for, coarse ones while the pose moves; the
    loop looks for what is known.
    """
    maker = for_one_thread(MapMaker)

    def make(request: Session) -> Iterator[Edit]:
        own = request.document
        try:
            for landscapes in maker(own.mesh).run(request):
                yield show(own, landscapes=landscapes, maps_note="")
        except PoseViewerError as error:
            yield show(own, maps_note=str(error))

    return Job(
        "maps",
        lambda now: None if now.preparation else now.request,
        make,
        serves=will_do,
        period_s=lambda now: SEARCH_MAPS_S if now.searching else 0.0,
        low_priority=True,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """An object as its loss is mapped: on its photos, and on coarser ones for quick maps."""

    losses: tuple[object, ...]
    """Values that say which losses it is made for."""
    scene: api.Scene
    quick: FitProblem
    pool: RendererPool
    """Draws for ``quick``."""


class MapMaker:
    """Makes maps of a model, one job after another, for one thread; others of low priority help."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        self._renderer = renderer
        self._fine = _pool(renderer)
        self._cases: dict[LossName, _Case] = {}
        self._is_prepared = False

    def run(self, request: Session) -> Iterator[tuple[LandscapeUpdate, ...]]:
        """The maps by each loss, coarse to fine, as soon as there is a first grid of each map."""
        cases = [self._case(request, settings) for settings in request.mapped]
        known: dict[LossName, LandscapeUpdate] = {}
        first, *more = QUICK_SIZES
        for size in (first, *more) if request.moving else (first, *more, SIZE):
            if size == SIZE and not self._is_prepared:  # now, and not when it is waited for
                self._is_prepared = True
                make_stages(cases[0].scene.problem, self._renderer)
            for case in cases:
                loss = case.scene.settings.loss
                shown = known[loss].slices if loss in known else ()
                coarse, fine = (case.quick, case.pool), (case.scene.problem, self._fine)
                levels = coarse if size < SIZE else fine
                for latest in maps(case.scene, request, *levels, size, shown):
                    known[loss] = latest
                    if size != first:
                        yield tuple(known.values())
            if size == first:
                yield tuple(known.values())

    def _case(self, request: Session, settings: FitSettings) -> _Case:
        """About what is compared; as a search compares it, where that is by these settings."""
        before = self._cases.get(settings.loss)
        losses, search = _losses_of(request), request.own_search
        if before is not None and before.losses == losses:
            return before
        own, anchor = request.document, request.compared
        view = reference_view(anchor, own.active, own.at)
        anchor = anchor.with_object(own.active, settings=settings)
        scene = api.Scene(anchor, {own.mesh: self._renderer}, own.active, view)
        if search is not None and search.settings == settings:
            scene = scene.comparing(search.problem, self._renderer)
        numbers = own.numbers_in(scene.problem)
        levels = [
            quick_level(view, view.chart.to_pose(numbers), self._renderer)
            for view in scene.problem.alone
        ]
        quick = scene.problem.on([level.photo for level in levels])
        if before is not None:
            before.pool.close()
        case = _Case(losses, scene, quick, _pool(levels[0].renderer))
        self._cases[settings.loss] = case
        return case


def _pool(renderer: Renderer) -> RendererPool:
    """Threads for the maps: one processor is left to drawing and to the page."""
    return RendererPool(renderer, threads=max(processors() - 1, 1), begin=lower_priority)


def maps(
    case: api.Scene,
    request: Session,
    problem: FitProblem,
    pool: RendererPool,
    size: int,
    shown: tuple[Slice, ...] = (),
) -> Iterator[LandscapeUpdate]:
    """The maps of a case by a problem, which is its own or on coarser photos, whenever a row of one
    is known. Maps that are ``shown`` already stay until the first grid of the new one is known.
    """
    own, width = request.document, request.half_width
    centre = own.numbers_in(problem)
    newest = {(piece.first, piece.second): piece for piece in shown}
    first = strides(size)[0]
    for piece in landscape(problem, pool, centre, half_width=width, size=size, smooth=True):
        pair = piece.first, piece.second
        if pair not in newest or bool(np.isfinite(piece.losses[::first, ::first]).all()):
            newest[pair] = piece
        yield LandscapeUpdate(own, case, centre, width, tuple(newest.values()))
