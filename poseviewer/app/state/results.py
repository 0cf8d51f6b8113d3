"""Results of workers: all that they have drawn and computed for a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.document import Document
from poseviewer.figures.map_archive import LossMaps
from poseviewer.fit.loss import Unexplained
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose

if TYPE_CHECKING:
    from poseviewer.app.state.session import Session

NO_LINES = np.zeros((0, 2, 2))


@dataclass(frozen=True, slots=True, eq=False)
class LossReading:
    """Unexplained shares of the photos at the active object's pose."""

    request: Session
    """Session that has the pose and the pixels that are compared."""
    mean: Unexplained | None = None
    """Over the views that are compared; None: ``note`` says why."""
    note: str = ""
    start: float | None = None
    """The loss at the start pose."""
    of_views: Mapping[int, Unexplained] = field(default_factory=dict)
    """Unexplained shares by the indices of the views that are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """The model as drawn for a request."""

    request: Session
    outline: FloatArray
    """(n, 2, 2): line segments in px of the photo."""
    edges: FloatArray = field(default_factory=lambda: NO_LINES)
    """(n, 2, 2): edges inside it, as such segments."""
    picture: NDArray[np.uint8] | None = None
    """(h, w, 3): RGB in place of the photo; None for none."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Outlines beside that of the active object in the large view."""

    lines: Mapping[int, FloatArray]
    """Other objects in the large view, (n, 2, 2) by their numbers: line segments in px."""
    small: tuple[Mapping[int, FloatArray], ...] = ()
    """For each of several views all objects, (n, 2, 2) in shares of the photo's sides."""


@dataclass(frozen=True, slots=True, eq=False)
class Landscape:
    """Maps of a loss about a pose, as far as they are known."""

    document: Document
    """The pose of its active object in its active view is the centre."""
    problem: FitProblem
    start: Pose
    """The pose about which pixels are compared, in the problem's first view."""
    parameters: FloatArray
    """(d,): the centre in the problem's chart."""
    half_width: float
    slices: tuple[Slice, ...] = ()
    """A slice for each pair, as soon as there is one."""

    @property
    def maps(self) -> LossMaps:
        """The slices as files hold them."""
        photo = self.document.scene.views[self.problem.views[0].view_index].photo
        return LossMaps.about(self.parameters, self.slices, self.half_width, self.problem, photo)


@dataclass(frozen=True, slots=True, eq=False)
class Preparation:
    """Preparation before the model can be drawn and compared finely: kernels and renderer."""

    share: float | None = None
    """Share of compiled kernels, in [0, 1]; None where all were, or before it is known."""
    trouble: str = ""
    """Why it will not be: a sentence for the user."""


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Newest results for the document at hand, or for one a moment ago."""

    overlay: Overlay | None = None
    alone: tuple[Pose, NDArray[np.uint8]] | None = None
    """The model drawn beside the photo, to be marked: its pose there, and pixels (h, w, 3)."""
    losses: LossReading | None = None
    landscapes: tuple[Landscape, ...] = ()
    """For each loss that is shown."""
    maps_note: str = ""
    """Why there are no maps; a sentence."""
    outlines: Outlines | None = None
