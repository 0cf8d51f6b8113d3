"""The session: the document at hand, its history, and how it is looked at. Immutable."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from poseviewer.app.state.document import Document, History
from poseviewer.app.state.gestures import Grip
from poseviewer.app.state.lineup import Lineup
from poseviewer.app.workers.jobs import LandscapeNews, Painting, SearchNews
from poseviewer.geometry.camera import Pose

NO_COMPLAINT = ""


@dataclass(frozen=True, slots=True)
class Look:
    """How the model is shown."""

    name: str = "outline"
    opacity: float = 0.8
    """Of the look ``solid``."""
    wipe: float = 1.0
    """The model is shown left of this share of the photo's width."""
    hidden: bool = False
    """Blinked away: the photo alone."""
    rings: bool = False
    """Whether the rotation rings are shown."""
    before: bool = False
    """Whether, after a search, the pose before it is shown."""


@dataclass(frozen=True, slots=True)
class LandscapeView:
    """How the maps are shown."""

    half_width: float = 0.2
    """In spans of each number: 0.2 is the paper's 20 %."""
    shared_scale: bool = False
    large: tuple[int, int] | None = None
    """The pair whose map is open large."""
    surface: bool = False
    """Whether the large map is a surface in space."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """A search that runs, or whose result awaits a word."""

    number: int
    before: Document
    running: bool = True
    news: SearchNews | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Proposing:
    """Start poses that are being looked for, or were found and await a word."""

    number: int
    document: Document
    """What they were asked for."""
    running: bool = True
    poses: tuple[Pose, ...] = ()
    """The likeliest first."""
    index: int = 0
    """The one that is shown."""

    def is_about(self, document: Document) -> bool:
        """Whether a document has the same photo and model."""
        own, other = self.document.registration, document.registration
        return own.photo is other.photo and own.mesh is other.mesh


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """All that the page shows."""

    document: Document
    history: History = field(default_factory=History)
    grip: Grip | None = None
    """What the pointer holds."""
    before_grip: Document | None = None
    """The document when it was taken hold of."""
    tool: str = "pose"
    look: Look = field(default_factory=Look)
    maps: LandscapeView = field(default_factory=LandscapeView)
    search: Search | None = None
    searches: int = 0
    """How many searches were started."""
    proposing: Proposing | None = None
    proposals_asked: int = 0
    """How many times proposals were asked for."""
    lineup: Lineup = field(default_factory=Lineup)
    comparisons: int = 0
    """How many times the models of the line-up were compared."""
    landscape: LandscapeNews | None = None
    painting: Painting | None = None
    anchor: Pose | None = None
    """The pose that the compared pixels are about (see ``PaintRequest``)."""
    saved: Pose | None = None
    """The pose that stands in a file."""
    typed: tuple[str, Document] | None = None
    """The number that was last typed, and the document that it led to."""
    complaint: str = NO_COMPLAINT
    """What the last command could not do, and why: a sentence for the user."""

    @property
    def shown_pose(self) -> Pose:
        """The pose that is drawn."""
        search = self.search
        if self.look.before and search is not None and not search.running:
            return search.before.pose
        return self.document.pose

    @property
    def paths(self) -> frozenset[Path]:
        """The files of all photos and models that undo and redo can bring back, of those at hand,
        and of the models in the line-up.
        """
        documents = (*self.history.past, self.document, *self.history.future)
        return self.lineup.paths.union(*(document.paths for document in documents))

    @property
    def searching(self) -> bool:
        """Whether a search runs."""
        return self.search is not None and self.search.running

    @property
    def unsaved(self) -> bool:
        """Whether the pose at hand stands in no file."""
        return self.document.pose is not self.saved
