"""Maps of the loss about the pose at hand: which are wanted now, and the job that makes them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from poseviewer import api
from poseviewer.app.state.commands import show
from poseviewer.app.state.document import reference_view
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import LandscapeUpdate, OverlayRequest, SearchUpdate, Session
from poseviewer.app.workers.jobs import for_one_thread
from poseviewer.app.workers.worker import Job, lower_priority
from poseviewer.errors import PoseViewerError
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.settings import FitSettings, Method
from poseviewer.fit.slices import QUICK_SIZES, Slice, landscape, quick_level, strides
from poseviewer.fit.stages import make_stages
from poseviewer.render.pool import RendererPool, processors
from poseviewer.render.types import Renderer

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

SIZE = 41
SEARCH_MAPS_S = 0.5
"""Seconds between maps that follow a search: the processor is for the search."""


@dataclass(frozen=True, slots=True, eq=False)
class MapJob:
    """Maps about a pose, by one loss or several."""

    request: OverlayRequest
    """Pose that is the maps' centre, and pixels that are compared."""
    search: SearchUpdate | None
    """Search from there; its problem is used where its loss is mapped."""
    losses: tuple[FitSettings, ...]
    half_width: float
    moving: bool

    @classmethod
    def wanted(cls, session: Session) -> MapJob:
        """The maps that the session asks for; coarse ones while the pose moves."""
        own, latest = session.overlay_request, session.own_search
        return cls(own, latest, session.mapped, session.half_width, session.moving)

    def replaces(self, other: MapJob, busy: bool) -> bool:
        """Whether to begin anew, while ``other`` runs (``busy``) or is done."""
        if self.losses_key != other.losses_key:
            return True
        if self.moving and other.moving and busy:
            return False  # coarse maps are soon done; a new start for every step shows none
        is_same = self.request.document.pose is other.request.document.pose
        return not is_same or (other.moving and not self.moving)

    @property
    def losses_key(self) -> tuple[object, ...]:
        """Values that are equal where the losses are, along the axes of the same camera."""
        problem = self.search and self.search.problem
        return self.losses, self.half_width, problem, *self.request.pixels


def mapping() -> Job[MapJob, Edit]:
    """Make the maps of the loss that the session asks for; the loop looks for what is known."""
    maker = for_one_thread(MapMaker)

    def make(job: MapJob) -> Iterator[Edit]:
        own = job.request.document
        try:
            for landscapes in maker(own.mesh).run(job):
                yield show(own, landscapes=landscapes, maps_note="")
        except PoseViewerError as error:
            yield show(own, maps_note=str(error))

    return Job(
        "maps",
        lambda now: None if now.preparation else MapJob.wanted(now),
        make,
        serves=lambda begun, asked, busy: not asked.replaces(begun, busy),
        period_s=lambda now: SEARCH_MAPS_S if now.searching else 0.0,
        low_priority=True,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """An object as its loss is mapped: on its photos, and on coarser ones for quick maps."""

    job: MapJob
    """Job that it was made for."""
    scene: api.Scene
    quick: FitProblem
    pool: RendererPool
    """Draws for ``quick``."""


class MapMaker:
    """Makes maps of a model, one job after another, for one thread; others of low priority help."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        self._renderer = renderer
        self._fine = _pool(renderer)
        self._cases: dict[Method, _Case] = {}
        self._is_prepared = False

    def run(self, job: MapJob) -> Iterator[tuple[LandscapeUpdate, ...]]:
        """The maps by each loss, coarse to fine, as soon as there is a first grid of each map."""
        cases = [self._case(job, settings) for settings in job.losses]
        known: dict[Method, LandscapeUpdate] = {}

        def made(case: _Case, size: int) -> Iterator[tuple[LandscapeUpdate, ...]]:
            """The maps by one loss, beside those by the others."""
            method = case.scene.settings.method
            shown = known[method].slices if method in known else ()
            levels = (case.quick, case.pool) if size < SIZE else (case.scene.problem, self._fine)
            for latest in maps(case.scene, job, *levels, size, shown):
                known[method] = latest
                yield tuple(known.values())

        first, *more = QUICK_SIZES
        for case in cases:
            deque(made(case, first), maxlen=0)
        yield tuple(known.values())
        for size in more if job.moving else (*more, SIZE):
            if size == SIZE and not self._is_prepared:  # now, and not when it is waited for
                self._is_prepared = True
                make_stages(cases[0].scene.problem, self._renderer)
            for case in cases:
                yield from made(case, size)

    def _case(self, job: MapJob, settings: FitSettings) -> _Case:
        """About the job's anchor; as a search compares it, where that is by these settings."""
        before = self._cases.get(settings.method)
        if before is not None and before.job.losses_key == job.losses_key:
            return before
        own, anchor = job.request.document, job.request.anchor
        view = reference_view(anchor, own.active, own.at)
        anchor = anchor.with_object(own.active, settings=settings)
        scene = api.Scene(anchor, {own.mesh: self._renderer}, own.active, view)
        if job.search is not None and job.search.settings == settings:
            scene = scene.comparing(job.search.problem, self._renderer)
        numbers = own.numbers_in(scene.problem)
        levels = [
            quick_level(view, view.chart.to_pose(numbers), self._renderer)
            for view in scene.problem.alone
        ]
        quick = scene.problem.on([level.photo for level in levels])
        if before is not None:
            before.pool.close()
        case = _Case(job, scene, quick, _pool(levels[0].renderer))
        self._cases[settings.method] = case
        return case


def _pool(renderer: Renderer) -> RendererPool:
    """Threads for the maps: one processor is left to drawing and to the page."""
    return RendererPool(renderer, threads=max(processors() - 1, 1), begin=lower_priority)


def maps(
    case: api.Scene,
    job: MapJob,
    problem: FitProblem,
    pool: RendererPool,
    size: int,
    shown: tuple[Slice, ...] = (),
) -> Iterator[LandscapeUpdate]:
    """The maps of a case by a problem, which is its own or on coarser photos, whenever a row of one
    is known. Maps that are ``shown`` already stay until the first grid of the new one is known.
    """
    own, width = job.request.document, job.half_width
    centre = own.numbers_in(problem)
    seen = {(piece.first, piece.second): piece for piece in shown}
    first = strides(size)[0]
    for piece in landscape(problem, pool, centre, half_width=width, size=size, smooth=True):
        pair = piece.first, piece.second
        if pair not in seen or bool(np.isfinite(piece.losses[::first, ::first]).all()):
            seen[pair] = piece
        yield LandscapeUpdate(own, case, centre, width, tuple(seen.values()))
