"""Which maps of the loss are wanted now, and the job that makes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from poseviewer.fit.pose_fit import FitProblem
from poseviewer.geometry.camera import Pose
from poseviewer.registration import FitSettings, Registration
from poseviewer.render.attributes import Renderer
from poseviewer.session.jobs import LandscapeNews, landscape_problem, maps
from poseviewer.session.session import Session

SIZE = 41
QUICK_SIZE = 9
"""Points along a side of maps that are made while the pose moves."""


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

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._anchor: Pose | None = None
        self._settings: FitSettings | None = None
        self._problem: FitProblem | None = None

    def run(self, job: MapJob) -> Iterator[LandscapeNews]:
        """News of the maps, coarse to fine.

        Raises:
            PoseViewerError: there are none with these settings at this pose.
        """
        problem = job.problem or self._problem_about(job)
        size = QUICK_SIZE if job.moving else SIZE
        return maps(problem, job.centre, self._renderer, job.half_width, size)

    def _problem_about(self, job: MapJob) -> FitProblem:
        same = job.anchor is self._anchor and job.settings == self._settings
        if self._problem is None or not same:
            self._problem = landscape_problem(job.registration, job.anchor, job.settings)
            self._anchor, self._settings = job.anchor, job.settings
        return self._problem
