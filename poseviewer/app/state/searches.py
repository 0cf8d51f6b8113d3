"""Requests for searches and start poses, and what has come of them."""

from dataclasses import dataclass, replace

from poseviewer.app.state.document import Document
from poseviewer.fit.progress import SearchProgress
from poseviewer.geometry.arrays import FloatArray
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import PoseHypothesis, StartQuery
from poseviewer.starts.start import StartInputs


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


@dataclass(frozen=True, slots=True, eq=False)
class PropagationRequest:
    """Request to propagate the active object's poses."""

    start: Document
    first: int
    """Index of the first frame that gets a pose, unless it has a key."""
    last: int


@dataclass(frozen=True, slots=True, eq=False)
class PropagationProgress:
    """A propagation, and how far it is."""

    request: PropagationRequest
    steps: int = 0
    """Number of its steps that the scene has."""
    frame_index: int = 0
    """Index of the last step's frame."""
    notes: tuple[str, ...] = ()
    """Sentences on its end."""
    follows: bool = True
    """Whether the frame of each step is shown: until the user looks at another one."""
    is_over: bool = False


def start_query(document: Document) -> StartQuery:
    """Query for start poses of the active object in the large view."""
    region = document.in_view.region
    inputs = StartInputs(document.photo, document.mesh, document.model.keypoints, document.mask)
    settings = replace(document.settings, region=region)
    return StartQuery(inputs, document.pose.camera, document.marks.box or region, settings)
