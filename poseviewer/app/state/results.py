"""Requests to workers, and results: what they have found, drawn and computed for a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.document import Document
from poseviewer.fit.problem import FitProblem
from poseviewer.fit.progress import SearchProgress
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.losses.loss import Unexplained
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import PoseHypothesis

NO_LINES = np.zeros((0, 2, 2))


@dataclass(frozen=True, slots=True, eq=False)
class SearchRequest:
    """Request for a search."""

    start: Document
    """Document that the search begins at."""
    methods: tuple[FitSettings, ...]
    """Settings of the active object for each of several searches from the start."""
    object_indices: tuple[int, ...]
    """Objects that are searched for in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class LossComparison:
    """Comparison of searches from one start by each loss."""

    ends: tuple[SearchProgress, ...]
    """Last progress by each loss, in the order of ``LOSSES``."""
    losses: FloatArray
    """(n, n): loss of each end (row) by each loss (column)."""
    outlines: tuple[FloatArray, ...]
    """For each end (k, 2, 2), line segments in px."""


@dataclass(frozen=True, slots=True, eq=False)
class ProposedStarts:
    """Start poses that are requested, or were found and can be chosen from."""

    document: Document
    """Document for which they were requested."""
    starts: tuple[PoseHypothesis, ...] = ()
    """Pose hypotheses, the likeliest first; empty until they are found."""
    outlines: tuple[FloatArray, ...] = ()
    """For each start (n, 2, 2), line segments in px of the photo."""
    index: int = -1
    """Index of the chosen start; -1: none yet."""
    is_over: bool = False
    """Whether the search for starts, and for a pose from them, has ended."""


@dataclass(frozen=True, slots=True)
class Pace:
    """Progress of a work on frames."""

    done: float = 0.0
    """Number of frames that are done."""
    total: int | None = None
    """Number of frames; None: not known."""
    seconds: float = 0.0
    """Seconds since its begin."""
    begun: float = 0.0
    """Number of frames that were done at its begin."""


@dataclass(frozen=True, slots=True, eq=False)
class PropagationRequest:
    """Request to propagate poses of objects to frames, or to mend them from a key outwards."""

    start: Document
    object_indices: tuple[int, ...]
    first: int = 0
    """Index of the first frame that gets a pose, unless it has a key."""
    last: int = 0
    key: int | None = None
    """Index of the frame from which poses are mended, instead of ``first`` and ``last``; None:
    they are propagated.
    """


@dataclass(frozen=True, slots=True, eq=False)
class PropagationProgress:
    """A propagation, and how far it is."""

    request: PropagationRequest
    steps: int = 0
    """Number of its steps that the scene has."""
    frames: frozenset[int] = frozenset()
    """Frames that got poses."""
    pace: Pace = Pace()
    notes: tuple[str, ...] = ()
    """Sentences on its end."""
    follows: bool = True
    """Whether the frame of each step is shown: until the user looks at another one."""
    is_over: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class LossReading:
    """Unexplained shares at the active object's pose."""

    at_pose: tuple[object, ...]
    """Values that are equal if the loss is the same."""
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

    document: Document
    drawn: tuple[object, ...]
    """Values that are equal if the picture of the model is the same."""
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
