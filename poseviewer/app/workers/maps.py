"""Maps of the loss about the pose at hand: which are wanted now, and the job that makes them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from poseviewer import api
from poseviewer.app.state.commands import show
from poseviewer.app.state.document import Document, compared, reference_view
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import LandscapeUpdate, SearchUpdate, Session
from poseviewer.app.workers.jobs import case_of, for_one_thread
from poseviewer.app.workers.worker import Job, lower_priority
from poseviewer.errors import PoseViewerError
from poseviewer.fit.scene import Scene
from poseviewer.fit.settings import FitSettings, Method
from poseviewer.fit.slices import QUICK_SIZES, Slice, landscape, quick_level, strides
from poseviewer.fit.stages import make_stages
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.pool import RendererPool, processors

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

SIZE = 41
SEARCH_MAPS_S = 0.5
"""Seconds between maps that follow a search: the processor is for the search."""


@dataclass(frozen=True, slots=True, eq=False)
class MapJob:
    """Maps about a pose, by one loss or several."""

    document: Document
    """Document at hand: its pose is the maps' centre."""
    anchor: Scene
    """Scene about which pixels are compared and the chart is made."""
    search: SearchUpdate | None
    """From ``anchor``; its problem is used where its loss is mapped."""
    losses: tuple[FitSettings, ...]
    half_width: float
    moving: bool

    @classmethod
    def wanted(cls, session: Session) -> MapJob:
        """The maps that the session asks for; coarse ones while the pose moves."""
        losses, width = session.mapped, session.half_width
        latest = session.own_search
        return cls(session.document, session.compared, latest, losses, width, session.moving)

    def replaces(self, other: MapJob, busy: bool) -> bool:
        """Whether to begin anew, while ``other`` runs (``busy``) or is done."""
        if not self.has_same_losses(other):
            return True
        if self.moving and other.moving and busy:
            return False  # coarse maps are soon done; a new start for every step shows none
        return self.document.pose is not other.document.pose or (other.moving and not self.moving)

    def has_same_losses(self, other: MapJob) -> bool:
        """Whether both are of the same losses, along the axes of the same camera."""
        same_maps = self.losses == other.losses and self.half_width == other.half_width
        same_maps = same_maps and self.document.shows_same(other.document)
        own, its = (compared(job.anchor, job.document.active) for job in (self, other))
        problems = [job.search and job.search.problem for job in (self, other)]
        return same_maps and own == its and problems[0] is problems[1]


def mapping() -> Job[MapJob]:
    """Make the maps of the loss that the session asks for; the loop looks for what is known."""
    maker = for_one_thread(MapMaker)

    def make(job: MapJob) -> Iterator[Edit]:
        try:
            for landscapes in maker(job.document.mesh).run(job):
                yield show(job.document, landscapes=landscapes, maps_note="")
        except PoseViewerError as error:
            yield show(job.document, maps_note=str(error))

    return Job(
        "maps",
        lambda now: None if now.preparation else MapJob.wanted(now),
        make,
        serves=lambda begun, asked, busy: not asked.replaces(begun, busy),
        period_s=lambda now: SEARCH_MAPS_S if now.searching else 0.0,
        low_priority=True,
    )


class MapMaker:
    """Makes maps, one job after another, for one thread; others of low priority help it."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        self._renderer = renderer
        self._fine = RendererPool(renderer, threads=_spare(), begin=lower_priority)
        self._quick: dict[Method, tuple[api.Scene, api.Scene, RendererPool]] = {}
        self._cases: dict[Method, tuple[MapJob, api.Scene]] = {}
        self._prepared: Mesh | None = None

    def run(self, job: MapJob) -> Iterator[tuple[LandscapeUpdate, ...]]:
        """The maps by each loss, coarse to fine, as soon as there is a first grid of each map: what
        was shown before is to stay until then.
        """
        document, mesh = job.document, job.document.mesh
        cases = [self._case(job, settings) for settings in job.losses]
        known: dict[Method, LandscapeUpdate] = {}

        def made(case: api.Scene, size: int | None) -> Iterator[LandscapeUpdate]:
            """The maps by one loss; with a ``size``, coarse ones."""
            method = case.settings.method
            shown = known[method].slices if method in known else ()
            quick, level = (case, self._fine) if size is None else self._quick_case(case, document)
            for latest in maps(quick, document, level, job.half_width, size or SIZE, shown):
                known[method] = replace(latest, case=case)
                yield known[method]

        first, *more = QUICK_SIZES
        for case in cases:
            deque(made(case, first), maxlen=0)
        yield tuple(known.values())
        for size in (*more, None):
            if size is None and job.moving:
                return
            if size is None and self._prepared is not mesh:  # now, and not when it is waited for
                self._prepared = mesh
                make_stages(cases[0].problem, self._renderer)
            for case in cases:
                for _ in made(case, size):
                    yield tuple(known.values())

    def _quick_case(self, case: api.Scene, document: Document) -> tuple[api.Scene, RendererPool]:
        """The case on a coarser level of each photo, and what draws it; made once."""
        method = case.settings.method
        if method not in self._quick or self._quick[method][0] is not case:
            numbers = document.numbers_in(case.problem)
            level, *more = (
                quick_level(view, view.chart.to_pose(numbers), self._renderer)
                for view in case.problem.alone
            )
            pool = RendererPool(level.renderer, threads=_spare(), begin=lower_priority)
            if method in self._quick:
                self._quick[method][2].close()
            problem = case.problem.on([its.photo for its in (level, *more)])
            quick = case.comparing(problem, level.renderer)
            self._quick[method] = case, quick, pool
        return self._quick[method][1:]

    def _case(self, job: MapJob, settings: FitSettings) -> api.Scene:
        """About the job's anchor; as a search compares it, where that is by these settings."""
        before, kept = self._cases.get(settings.method, (None, None))
        is_kept = before is not None and before.has_same_losses(job)
        if kept is None or not is_kept:
            own = job.document
            view = reference_view(job.anchor, own.active, own.at)
            kept = case_of(job.anchor, own.active, view, settings, self._renderer)
            if job.search is not None and job.search.settings == settings:
                kept = kept.comparing(job.search.problem, self._renderer)
            self._cases[settings.method] = job, kept
        return kept


def _spare() -> int:
    """Threads for the maps: one processor is left to drawing and to the page."""
    return max(processors() - 1, 1)


def maps(
    case: api.Scene,
    document: Document,
    pool: RendererPool,
    half_width: float,
    size: int,
    shown: tuple[Slice, ...] = (),
) -> Iterator[LandscapeUpdate]:
    """The maps about the pose at hand, coarse to fine, whenever a row of one is known.

    Maps that are ``shown`` already, from a coarser picture, stay until the first grid of the new
    one is known.
    """
    problem = case.problem
    parameters = document.numbers_in(problem)
    seen = {(piece.first, piece.second): piece for piece in shown}
    first = strides(size)[0]
    slices = landscape(problem, pool, parameters, half_width=half_width, size=size, smooth=True)
    for piece in slices:
        pair = piece.first, piece.second
        if pair not in seen or bool(np.isfinite(piece.losses[::first, ::first]).all()):
            seen[pair] = piece
        yield LandscapeUpdate(document, case, parameters, half_width, tuple(seen.values()))
