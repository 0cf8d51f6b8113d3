"""Searches and proposals: what was requested, and what has come of it."""

from dataclasses import dataclass, replace

from poseviewer.app.state.document import Document
from poseviewer.fit.progress import SearchProgress
from poseviewer.geometry.arrays import FloatArray
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import PoseHypothesis, StartQuery
from poseviewer.starts.loading import StartInputs


@dataclass(frozen=True, slots=True, eq=False)
class SearchRequest:
    """Request for a search; no two are equal."""

    start: Document
    """Document that the search begins at."""
    methods: tuple[FitSettings, ...]
    """Settings of the active object, one after the other, each from the start."""
    object_indices: tuple[int, ...]
    """Objects that are searched for in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class LossComparison:
    """Searches by each loss from one start, and what each loss says of each end."""

    ends: tuple[SearchProgress, ...]
    """The last progress by each loss, in the order of ``LOSSES``."""
    losses: FloatArray
    """(n, n): loss of each end (row) by each loss (column)."""
    outlines: tuple[FloatArray, ...]
    """(k, 2, 2) of each end: line segments, px."""


@dataclass(frozen=True, slots=True, eq=False)
class ProposedStarts:
    """Start poses that are being looked for, or were found and wait for a choice."""

    document: Document
    """Document that they were requested at."""
    starts: tuple[PoseHypothesis, ...] = ()
    """The likeliest first; none while they are looked for."""
    outlines: tuple[FloatArray, ...] = ()
    """(n, 2, 2) of each: line segments in px of the photo."""
    index: int = -1
    """The start that is taken; -1: none yet."""
    is_over: bool = False
    """Whether nothing is looked for, or fitted, any more."""


def start_query(document: Document) -> StartQuery:
    """Request for start poses at a document, by its camera."""
    region = document.own.region
    inputs = StartInputs(document.photo, document.mesh, document.model.keypoints, document.mask)
    settings = replace(document.settings, region=region)
    return StartQuery(inputs, document.pose.camera, document.marks.box or region, settings)
