"""Results of workers: what they have drawn and computed for a session."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.document import Document
from poseviewer.errors import PoseViewerError
from poseviewer.figures.map_archive import LossMaps
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.losses.loss import Unexplained

if TYPE_CHECKING:
    from poseviewer.app.state.session import Session

NO_LINES = np.zeros((0, 2, 2))


@dataclass(frozen=True, slots=True, eq=False)
class LossReading:
    """Unexplained shares at the active object's pose."""

    request: Session
    mean: Unexplained | None = None
    """Mean over the compared views; None: ``note`` says why."""
    note: str = ""
    start: float | None = None
    """Loss at the start pose."""
    by_view: Mapping[int, Unexplained] = field(default_factory=dict)
    """Unexplained shares by the indices of the compared views."""


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """Drawing of the active object."""

    request: Session
    outline: FloatArray
    """(n, 2, 2): line segments in px of the photo."""
    edges: FloatArray = field(default_factory=lambda: NO_LINES)
    """(n, 2, 2): segments of the edges inside the outline."""
    picture: NDArray[np.uint8] | None = None
    """(h, w, 3): RGB picture in place of the photo; None: the photo is shown."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Outlines of further objects and views; line segments (n, 2, 2) by the objects' ids."""

    large: Mapping[int, FloatArray]
    """Objects but the active one in the large view, px."""
    small: tuple[Mapping[int, FloatArray], ...] = ()
    """For each of several views all objects, in shares of the photo's sides."""


@dataclass(frozen=True, slots=True, eq=False)
class Landscape:
    """Maps of a loss about a pose."""

    document: Document
    """Document whose active object, in its large view, has the centre pose."""
    problem: FitProblem
    start: Pose
    """Pose in the problem's first view about which pixels are compared."""
    parameters: FloatArray
    """(d,): the centre in the problem's chart."""
    half_width: float
    slices: tuple[Slice, ...] = ()
    """Slices by pairs of parameters, as far as they are computed."""

    def covariance_in(self, session: Session) -> FloatArray | None:
        """(d, d): covariance of the session's pose in the problem's chart, if it is known."""
        view = self.problem.views[0]
        sure = session.covariance_in(view.view_index)
        with suppress(PoseViewerError, OutsideChartError):
            return None if sure is None else sure.in_chart(view.chart)
        return None

    def path_in(self, session: Session) -> FloatArray | None:
        """(n, d): path of the session's search; None: there is none in the problem's chart."""
        request, search = session.search, session.own_progress
        problem = self.problem
        if not (request and search and search.problem.chart.names == problem.chart.names):
            return None
        start = request.start
        if start.scene.pose(start.active, problem.views[0].view_index) is not self.start:
            return None  # another chart
        return np.array([step.parameters for step in search.improvements])

    def maps_in(self, session: Session) -> LossMaps:
        """The slices as files hold them, with what the session knows of the search."""
        photo = self.document.scene.views[self.problem.views[0].view_index].photo
        maps = LossMaps.about(self.parameters, self.slices, self.half_width, self.problem, photo)
        covariance, path = self.covariance_in(session), self.path_in(session)
        return replace(maps, covariance=covariance, path=path)


@dataclass(frozen=True, slots=True, eq=False)
class Preparation:
    """State of compiling kernels and making the renderer, before which models are sketched."""

    share: float | None = None
    """Share of compiled kernels, in [0, 1]; None: all were, or it is not known yet."""
    trouble: str = ""
    """Sentence: why preparation has failed."""


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Newest results, which may be of a slightly older document."""

    overlay: Overlay | None = None
    alone: tuple[Pose, NDArray[np.uint8]] | None = None
    """Picture (h, w, 3) of the model without the photo, for marking points, and the pose in it."""
    losses: LossReading | None = None
    landscapes: tuple[Landscape, ...] = ()
    """For each loss that is mapped."""
    maps_note: str = ""
    """Sentence: why there are no maps."""
    outlines: Outlines | None = None
