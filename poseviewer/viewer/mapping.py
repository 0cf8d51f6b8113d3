"""Which maps of the loss are wanted now, and the job that makes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from poseviewer.fit.landscape import Slice
from poseviewer.fit.pose_fit import FitProblem
from poseviewer.geometry.camera import Pose
from poseviewer.registration import FitSettings, Registration
from poseviewer.render.levels import LevelRenderer, coarser
from poseviewer.render.software import SoftwareRenderer
from poseviewer.session.jobs import LandscapeNews, landscape_problem, maps
from poseviewer.session.session import Session

SIZE = 41
QUICK_SIZES = (3, 9)
"""Points along a side of the first maps, which are all there are while the pose moves."""
QUICK_SIDE, MOST_FACTOR = 240, 4
"""px of the longer side that the photo is brought down to for the first maps, at most so many
times smaller: they are to be there at once."""


def level_of(problem: FitProblem) -> int:
    """How many times smaller the photo is for the first maps."""
    height, width = problem.photo.weights.shape
    return int(min(max(max(width, height) // QUICK_SIDE, 1), MOST_FACTOR))


@dataclass(frozen=True, slots=True, eq=False)
class MapJob:
    """Maps about a pose."""

    registration: Registration
    settings: FitSettings
    centre: Pose
    anchor: Pose
    problem: FitProblem | None
    """A search's; None: the one about ``anchor``."""
    half_width: float
    moving: bool

    @classmethod
    def wanted(cls, session: Session, moving: bool) -> MapJob:
        """The maps that the session asks for; coarse ones while the pose moves."""
        document, search = session.document, session.search
        news = None if search is None else search.news
        return cls(
            document.registration,
            document.settings,
            document.pose,
            session.anchor or document.pose,
            None if news is None else news.problem,
            session.maps.half_width,
            moving,
        )

    def replaces(self, other: MapJob | None, busy: bool) -> bool:
        """Whether to begin anew, while ``other`` runs (``busy``) or is done."""
        if other is None or not self._same_loss(other):
            return True
        if self.moving and other.moving and busy:
            return False  # coarse maps are soon done; a new start for every step shows none
        return self.centre is not other.centre or (other.moving and not self.moving)

    def _same_loss(self, other: MapJob) -> bool:
        return (
            self.registration.photo is other.registration.photo
            and self.registration.mesh is other.registration.mesh
            and self.settings == other.settings
            and self.half_width == other.half_width
        )


class Mapper:
    """Makes maps, one job after another, in one thread."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        # One for each level: buffers are made for a size.
        self._renderer, self._fine = renderer, renderer.clone()
        self._coarse: tuple[FitProblem, FitProblem] | None = None
        self._anchor: Pose | None = None
        self._settings: FitSettings | None = None
        self._problem: FitProblem | None = None

    def run(self, job: MapJob) -> Iterator[LandscapeNews]:
        """News of the maps, coarse to fine.

        Raises:
            PoseViewerError: there are none with these settings at this pose.
        """
        problem = job.problem or self._problem_about(job)
        quick = self._quick_problem(problem)
        level = LevelRenderer(self._renderer, level_of(problem))
        shown: tuple[Slice, ...] = ()
        for size in QUICK_SIZES:
            before = shown
            for news in maps(quick, job.centre, level, job.half_width, size, before):
                shown = news.slices
                yield replace(news, problem=problem, known=0.0)
        if not job.moving:
            yield from maps(problem, job.centre, self._fine, job.half_width, SIZE, shown)

    def _quick_problem(self, problem: FitProblem) -> FitProblem:
        """The problem on a coarser level of the photo; made once."""
        if self._coarse is None or self._coarse[0] is not problem:
            factor = level_of(problem)
            photo = problem.photo if factor == 1 else coarser(problem.photo, factor)
            self._coarse = problem, replace(problem, photo=photo)
        return self._coarse[1]

    def _problem_about(self, job: MapJob) -> FitProblem:
        same = job.anchor is self._anchor and job.settings == self._settings
        if self._problem is None or not same:
            self._problem = landscape_problem(job.registration, job.anchor, job.settings)
            self._anchor, self._settings = job.anchor, job.settings
        return self._problem
