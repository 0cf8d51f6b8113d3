"""The session: document, history, look, and what workers found out. Immutable."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from poseviewer import api
from poseviewer.app.state.camera_change import with_camera
from poseviewer.app.state.document import UNLOCK, Document, History, compared, label_of
from poseviewer.app.state.dragging import Drag, radius_in_photo
from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import SettingsError
from poseviewer.figures.map_archive import LossMaps
from poseviewer.fit.loss import Unexplained
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.search import SearchProgress
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.settings import LOSSES, FitSettings, LossName
from poseviewer.scene.types import Scene, SearchResult
from poseviewer.starts.automatic import PoseHypothesis, StartQuery
from poseviewer.starts.loading import StartInputs

NO_LINES = np.zeros((0, 2, 2))
Whose = Literal["chosen", "default", "paper", "both"]


@dataclass(frozen=True, slots=True, eq=False)
class Losses:
    """Unexplained shares of the photos at the active object's pose."""

    request: Session
    """Session of whose pose they are, and whose pixels are compared."""
    mean: Unexplained | None = None
    """Over the views that are compared; None where it cannot be told."""
    note: str = ""
    """Why not."""
    start: float | None = None
    """The loss at the start pose."""
    of_views: Mapping[int, Unexplained] = field(default_factory=dict)
    """By the indices of the views that are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """The model as drawn for a request."""

    request: Session
    outline: FloatArray
    """(N, 2, 2): line segments in px of the photo."""
    edges: FloatArray = field(default_factory=lambda: NO_LINES)
    """(N, 2, 2): edges inside it, as such segments."""
    picture: NDArray[np.uint8] | None = None
    """(h, w, 3): RGB in place of the photo; None for none."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Outlines beside the active object."""

    lines: Mapping[int, FloatArray]
    """Other objects in the large view, (N, 2, 2) by their numbers: line segments in px."""
    small: tuple[Mapping[int, FloatArray], ...] = ()
    """For each of several views all objects, (N, 2, 2) in shares of the photo's width and
    height."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchUpdate(SearchProgress):
    """A search after one more evaluation, and the way that it came."""

    results: Mapping[int, SearchResult | None]
    """Results of the objects whose last search is over."""
    settings: FitSettings
    """By which the object is searched for."""
    improvements: tuple[FitProgress, ...]
    """The progress at each evaluation that found a better pose, the first one among them."""
    restarts: tuple[FitProgress, ...] = ()
    """The progress at the first evaluation of each restart."""
    is_over: bool = False
    """Whether it is the last one."""
    ends: tuple[SearchUpdate, ...] = ()
    """Ends by the losses from one start, in the last update of a search by several."""
    losses: tuple[float, ...] = ()
    """Loss of one of these ends by each of the losses, in their order."""
    outline: FloatArray = field(default_factory=lambda: NO_LINES)
    """(n, 2, 2): line segments, px, of one of these ends."""


@dataclass(frozen=True, slots=True, eq=False)
class LandscapeUpdate:
    """The maps about a pose, as far as they are known."""

    document: Document
    """Its active object's pose in its active view is the centre."""
    case: api.Scene
    """About the object whose loss it is."""
    parameters: FloatArray
    """(d,): the centre in the case's chart."""
    half_width: float
    slices: tuple[Slice, ...]
    """One for each pair, as soon as there is one."""

    @property
    def shown(self) -> tuple[Slice, ...]:
        """The slices with the losses as a person is shown them."""
        return tuple(piece.shown(self.case.problem.scale) for piece in self.slices)

    @property
    def maps(self) -> LossMaps:
        """The slices as files hold them."""
        return self.case.maps_at(self.parameters, self.slices, self.half_width)


@dataclass(frozen=True, slots=True, eq=False)
class SearchRequest:
    """Request for a search; each is an object of its own."""

    start: Document
    """Document that the search begins at."""
    methods: tuple[FitSettings, ...]
    """Settings by which the active object is searched for, one after the other, each from the
    start."""
    indices: tuple[int, ...]
    """Objects that are searched for in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """A search that runs, or whose result awaits a word."""

    asked: SearchRequest
    running: bool = True
    latest: SearchUpdate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ProposedStarts:
    """Start poses that are being looked for, or were found and await a word."""

    document: Document
    """Document that they were asked for at."""
    starts: tuple[PoseHypothesis, ...] = ()
    """The likeliest first; none while they are looked for."""
    outlines: tuple[FloatArray, ...] = ()
    """(n, 2, 2) of each: line segments in px of the photo."""
    index: int = -1
    """The one that is taken; -1: none yet."""
    is_over: bool = False
    """Whether nothing is looked for, or fitted, any more."""

    @property
    def stopped(self) -> ProposedStarts | None:
        """Proposals made so far, when nothing more is looked for."""
        return replace(self, is_over=True) if self.starts else None


def start_query(document: Document) -> StartQuery:
    """Request for start poses at a document, by its camera."""
    own = document.own
    settings = replace(document.settings, region=own.region)
    inputs = StartInputs(document.photo, document.mesh, document.model.keypoints, document.mask)
    box = document.marks.box or own.region
    return StartQuery(inputs, document.pose.camera, box, settings)


@dataclass(frozen=True, slots=True, eq=False)
class Preparation:
    """Preparation before the model can be drawn and compared finely: kernels and renderer."""

    share: float | None = None
    """Share of compiled kernels, in [0, 1]; None where all were, or before it is known."""
    trouble: str = ""
    """Why it will not be: a sentence for the user."""


OF_A_PHOTO = {"overlay": None, "alone": None, "losses": None, "proposals": None, "landscapes": ()}
"""Fields of a session where nothing is made yet for the photo that is shown large."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """All that the page shows."""

    document: Document
    history: History = field(default_factory=History)
    drag: Drag | None = None
    """Part of the model or photo that the pointer holds."""
    tool: str = "pose"
    erasing: bool = False
    """Whether strokes of the tools that hide bring back what they cover."""
    for_one: bool = False
    """Whether they are about the active object alone, instead of the photo."""
    strokes: int = 0
    """Number of strokes that were taken: a page shows its own until then."""
    look: str = "outline"
    """Drawing of the model."""
    opacity: float = 0.8
    """Opacity of the look ``solid``."""
    photo_alone: bool = False
    """Whether the model is blinked away."""
    half_width: float = 0.2
    """Reach of the maps as a share of each parameter's scale: 0.2 is the paper's 20 %."""
    large_map: tuple[int, int] | None = None
    """Pair of parameters whose map is open large."""
    whose: Whose = "chosen"
    """Which loss is mapped: the chosen one, one of them, or both."""
    search: Search | None = None
    proposals: ProposedStarts | None = None
    other_proposals: Mapping[int, ProposedStarts | None] = field(default_factory=dict)
    """Those of objects that are not active, by their numbers."""
    landscapes: tuple[LandscapeUpdate, ...] = ()
    """One for each loss that is shown."""
    maps_note: str = ""
    """Why there are no maps; a sentence."""
    ends: tuple[SearchUpdate, ...] = ()
    """Ends by both losses when they were last compared on this photo and model."""
    other_settings: FitSettings = field(default_factory=lambda: FitSettings("paper"))
    """The settings as they were before the loss was changed last."""
    overlay: Overlay | None = None
    alone: tuple[Pose, NDArray[np.uint8]] | None = None
    """The model drawn beside the photo, to be marked: its pose there, and pixels (h, w, 3)."""
    losses: Losses | None = None
    """Losses of the pose at hand, or of one a moment ago: its own will follow."""
    outlines: Outlines | None = None
    preparation: Preparation | None = None
    """None: all is ready. Until then a search waits, and outlines are sketched."""
    anchor: Scene | None = None
    """Scene about which pixels are compared: fixed while the model moves, so that losses on the way
    can be compared; None: the document's."""
    saved: Document | None = None
    """Document that stands in a file."""
    last_step: tuple[object, Document] | None = None
    """Key of the last step that had one, and the document that it led to."""

    @property
    def compared(self) -> Scene:
        """The scene about which pixels are compared."""
        return self.anchor or self.document.scene

    @property
    def request(self) -> Session:
        """The session as workers keep it: without results and history, which fill the memory."""
        return replace(self, **OF_A_PHOTO, history=History(), outlines=None, other_proposals={})

    @property
    def pixels(self) -> tuple[object, ...]:
        """Values that are equal where the same pixels are compared by the same loss."""
        return *self.document.shown, *compared(self.compared, self.document.active)

    @property
    def at_pose(self) -> tuple[object, ...]:
        """Values that are equal where the loss is one."""
        return self.document.pose, *self.pixels

    @property
    def drawn(self) -> tuple[object, ...]:
        """Values that are equal where the picture of the model is one."""
        return self.look, self.opacity, self.preparation is None, *self.at_pose

    def covariance_in(self, view: int) -> PoseCovariance | None:
        """Covariance of the active object's pose in a view; None where no search has said it."""
        own, result = self.document, self.document.object.result
        if result is None or result.covariance is None:
            return None
        sure, views = result.covariance, own.scene.views
        if result.view == view:
            return sure
        turn = views[view].camera_from_world @ views[result.view].camera_from_world.inverse()
        shift = turn.translation / own.object.world_from_model.scale
        turn = RigidTransform(turn.rotation, shift)
        return sure.in_view_of(turn, own.scene.pose(own.active, view), own.mesh)

    @property
    def searching(self) -> bool:
        """Whether a search runs."""
        return self.search is not None and self.search.running

    @property
    def proposing(self) -> bool:
        """Whether start poses are being looked for."""
        return self.proposals is not None and not self.proposals.is_over

    @property
    def looking(self) -> bool:
        """Whether this is for a model that is nowhere yet: whatever places it ends that."""
        return self.proposing and not self.document.object.is_placed

    @property
    def opened(self) -> Session:
        """The session that looks for an active object that is nowhere yet."""
        is_placed = self.document.object.is_placed
        return self if is_placed else replace(self, proposals=ProposedStarts(self.document))

    @property
    def moving(self) -> bool:
        """Whether a hand or a search moves the model: the next pose will follow at once."""
        is_dragged = self.drag is not None and self.drag.before is not None
        return is_dragged or self.searching

    @property
    def marks_model(self) -> bool:
        """Whether points of the model are marked."""
        is_first = self.tool == "wheels" and self.document.model.keypoints is None
        return is_first or self.tool == "pairs"

    @property
    def shown_box(self) -> Rectangle | None:
        """The rectangle about the object, while it is drawn and starts are taken from it."""
        at_hand = self.proposals is not None and self.search is None
        return self.document.marks.box if at_hand or self.tool == "box" else None

    @property
    def other_ends(self) -> tuple[SearchUpdate, ...]:
        """Ends of a comparison in the large view, without the one at hand; none if that is none."""
        own = None if self.searching else self.own_search
        if own is None or not (own.ends or own in self.ends):
            return ()
        return tuple(end for end in self.ends if end.settings.loss != own.settings.loss)

    @property
    def own_search(self) -> SearchUpdate | None:
        """The newest of the search, where it is for the active object, by the view's camera."""
        latest, own = None if self.search is None else self.search.latest, self.document
        if latest is None or latest.index != own.active:
            return None
        return latest if latest.problem.views[0].index == own.at else None

    def settings_by(self, loss: LossName) -> FitSettings:
        """The settings at hand, by a loss."""
        return self.document.settings.of_loss(loss, self.other_settings)

    @property
    def mapped(self) -> tuple[FitSettings, ...]:
        """Settings of the losses that the maps are to show."""
        own, whose = self.document.settings, self.whose
        if whose == "both":
            return tuple(map(self.settings_by, LOSSES))
        return (own if whose == "chosen" else self.settings_by(whose),)

    @property
    def unsaved(self) -> bool:
        """Whether a pose at hand, or what is compared there, stands in no file."""
        return self.saved is None or self.saved.placement != self.document.placement

    def at(self, history: History, document: Document) -> Session:
        """Session at another document of a history, without a search or another photo's results."""
        gone = {} if document.shown == self.document.shown else {**OF_A_PHOTO, "ends": ()}
        state = {"history": history, "document": document, "anchor": document.scene, **gone}
        if self.looking and self.proposals and document.object.is_placed:
            state = {"proposals": self.proposals.stopped, **state}
        return replace(self, search=None, **state)

    def with_active(self, index: int) -> Session:
        """Make another object active, which is no step; the same session where it is."""
        document, number = self.document.with_active(index), self.document.number
        if document is self.document:
            return self
        others = {**self.other_proposals, number: self.proposals}
        proposals = others.pop(document.number, None)
        if proposals is not None and proposals.document.shown != document.shown:
            proposals = None
        session = self.at(self.history, document)
        return replace(session, proposals=proposals, other_proposals=others)

    def with_document(self, document: Document, key: object = None) -> Session:
        """One undoable step to another document; of steps in a row with one ``key`` (what is
        typed, letter by letter) undo leads to before the first. Raises ``FloatingPointError``: the
        model would be out of sight; ``SettingsError``: a locked object would move.
        """
        if not is_in_sight(document):
            raise FloatingPointError(
                "that pose is behind the camera or out of all proportion; nothing was changed"
            )
        _require_unlocked(self.document, document)
        is_same = key is not None and self.last_step == (key, self.document)
        is_same = is_same and not self.history.future
        history = self.history if is_same else self.history.with_step(self.document)
        session = self.at(history, document)
        return session if key is None else replace(session, last_step=(key, document))

    def with_pose(self, pose: Pose) -> Session:
        """One undoable step to another pose; raises as ``with_document``."""
        return self.with_document(self.document.at_pose(pose))


def is_in_sight(document: Document) -> bool:
    """Whether the model is in front of the camera, neither infinitely large nor infinitely far."""
    pose = document.pose
    radius = radius_in_photo(pose, document.mesh)
    is_finite = bool(np.isfinite(pose.camera_from_model.translation).all())
    return 0.0 < radius < math.inf and is_finite


def _require_unlocked(before: Document, now: Document) -> None:
    """Raise unless a locked object is where it was in the photo; under another camera, too."""
    is_same = before.shown == now.shown and before.pose is not now.pose
    if not (is_same and before.object.locked and now.object.locked):
        return
    kept = with_camera(before.pose, now.pose.camera, now.mesh.centre)
    pixels = [pose.project(now.mesh.vertices) for pose in (kept, now.pose)]
    if not np.allclose(*pixels, rtol=0.0, atol=1e-4, equal_nan=True):
        label = label_of(now.object)
        raise SettingsError(f"{label} is locked: {UNLOCK} to move it; nothing was changed")
