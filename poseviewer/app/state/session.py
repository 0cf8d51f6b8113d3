"""The session: the document at hand, its history, how it is looked at, and what the workers found
out about it. Immutable.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from poseviewer.api import Case
from poseviewer.app.state.document import Document, History, SceneObject, SearchEnd
from poseviewer.app.state.dragging import Drag, radius_in_photo
from poseviewer.errors import SettingsError
from poseviewer.figures.loss_maps import LossMaps
from poseviewer.fit.landscape import Slice
from poseviewer.fit.progress import FitProgress
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import METHODS, FitSettings, Method
from poseviewer.fit.unexplained import Unexplained
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.photo import Photo
from poseviewer.geometry.pose_covariance import PoseCovariance
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.starts.automatic import StartQuery

Whose = Literal["chosen", "default", "paper", "both"]


@dataclass(frozen=True, slots=True, eq=False)
class OverlayRequest:
    """What is to be drawn."""

    registration: Registration
    settings: FitSettings
    pose: Pose
    anchor: Pose
    """The pose that the compared pixels are about: fixed while the model moves, so that losses on
    the way can be compared."""
    look: str
    opacity: float = 0.8
    moving: bool = False
    """Whether the next pose will follow at once: then the quick drawing is all there is."""
    document: Document | None = None
    """Of a set, whose loss is the mean over its photos."""

    def compares_same(self, other: OverlayRequest) -> bool:
        """Whether both compare the same pixels by the same loss."""
        same = self.registration.compares_same(other.registration)
        if self.document is not None and other.document is not None:
            same = same and self.document.compares_same(other.document)
        return same and self.anchor is other.anchor and self.settings == other.settings

    def has_loss_of(self, other: OverlayRequest) -> bool:
        """Whether the losses of both are one."""
        return self.pose is other.pose and self.compares_same(other)


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """The model as drawn for a request."""

    request: OverlayRequest
    outline: FloatArray
    """(N, 2, 2): line segments in px of the photo."""
    picture: NDArray[np.uint8] | None
    """(h, w, 3 or 4): RGB in place of the photo, or RGBA over it; None for none."""
    place: tuple[float, float, float, float]
    """Where the picture lies: left, top, width, height in px of the photo."""
    unexplained: Unexplained | None
    """The loss at the pose; None where it cannot be told."""
    note: str = ""
    """Why there is no loss, or no such look."""
    loss_is_current: bool = True
    """False: the loss is still that of the pose before, its own will follow."""
    start_loss: float | None = None
    """Of the pose that the pixels are about: where a drag began."""
    of_photos: Mapping[int, Unexplained] = field(default_factory=dict)
    """The losses of the photos of a set by their numbers, as far as they are compared."""

    def with_loss_of(self, other: Overlay, is_current: bool) -> Overlay:
        """The same drawing with the loss, or why there is none, of another."""
        return replace(
            self,
            unexplained=other.unexplained,
            start_loss=other.start_loss,
            of_photos=other.of_photos,
            note=other.note,
            loss_is_current=is_current,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """What is drawn of the objects that are not picked."""

    lines: Mapping[int, FloatArray]
    """(N, 2, 2) by their numbers: line segments in px of the photo."""


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """The model in each photo of a set."""

    poses: tuple[Pose, ...]
    """At which it is drawn."""
    lines: tuple[FloatArray, ...]
    """(N, 2, 2) each: line segments, in shares of the photo's width and height."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchUpdate:
    """A search after one more evaluation."""

    case: Case
    """What is searched, from the pose that the search began at."""
    progress: FitProgress
    improvements: tuple[FitProgress, ...]
    """The progress at each evaluation that found a better pose, the first one among them."""
    restarts: tuple[FitProgress, ...] = ()
    """The progress at the first evaluation of each restart."""
    ends: tuple[MethodEnd, ...] = ()
    """Of the last update of a search by several methods: where each of them has ended."""
    together: Together | None = None
    """Of a search for several objects."""
    of_photos: tuple[SearchEnd, ...] = ()
    """Of the last update of a search over a set: what was found, for each of its photos."""


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """How a search for several objects stands, which is at one of them."""

    number: int
    """Of the object that the update is of."""
    poses: Mapping[int, Pose]
    """Of all objects that are searched for, by their numbers."""
    ends: Mapping[int, SearchEnd]
    """What was found, by the numbers of the objects whose last search is over."""
    is_over: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class MethodEnd:
    """Where one of several methods has ended, from the start that they share."""

    update: SearchUpdate
    losses: tuple[float, ...]
    """At its pose, by each of the methods in their order."""

    @property
    def settings(self) -> FitSettings:
        """By which it was searched."""
        return self.update.case.settings


@dataclass(frozen=True, slots=True, eq=False)
class LandscapeUpdate:
    """The maps about a pose, as far as they are known."""

    centre: Pose
    case: Case
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


@dataclass(frozen=True, slots=True)
class Look:
    """How the model is shown."""

    name: str = "outline"
    opacity: float = 0.8
    """Of the look ``solid``."""
    hidden: bool = False
    """Blinked away: the photo alone."""


@dataclass(frozen=True, slots=True)
class LandscapeView:
    """How the maps are shown."""

    half_width: float = 0.2
    """Share of each parameter's scale: 0.2 is the paper's 20 %."""
    large: tuple[int, int] | None = None
    """The pair whose map is open large."""
    whose: Whose = "chosen"
    """Whose loss is shown: that of the method that is chosen, of one of them, or both."""


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """A search that runs, or whose result awaits a word."""

    number: int
    before: Document
    start: Pose
    """What it begins at."""
    methods: tuple[FitSettings, ...]
    """By which it is searched, one after the other, each from the start."""
    running: bool = True
    latest: SearchUpdate | None = None
    objects: tuple[SceneObject, ...] = ()
    """Those that are searched for in turn; none: the picked one alone."""


@dataclass(frozen=True, slots=True, eq=False)
class ProposedStarts:
    """Start poses that are being looked for, or were found and await a word."""

    number: int
    document: Document
    """What they were asked for."""
    running: bool = True
    poses: tuple[Pose, ...] = ()
    """The likeliest first."""
    index: int = 0
    """The one that is shown."""

    @property
    def query(self) -> StartQuery:
        """What they are looked for, with the camera at hand."""
        own, settings = self.document.registration, self.document.settings
        camera, box = self.document.pose.camera, self.document.marks.box or settings.region
        rectangle = None if box is None else Rectangle(*box)
        return StartQuery(own.photo, own.mesh, own.keypoints, camera, rectangle, settings, own.mask)


@dataclass(frozen=True, slots=True, eq=False)
class Preparation:
    """What is made ready before the model at hand can be drawn and compared finely: the kernels,
    once on a machine, and what draws the model.
    """

    share: float | None = None
    """Of the kernels that are compiled, in [0, 1]; None where all were, or before that is known."""
    trouble: str = ""
    """Why it will not be: a sentence for the user."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """All that the page shows."""

    document: Document
    history: History = field(default_factory=History)
    drag: Drag | None = None
    """What the pointer holds."""
    before_drag: Document | None = None
    """The document when it was taken hold of; None until the pointer moves."""
    tool: str = "pose"
    erasing: bool = False
    """Whether strokes of the tools that hide bring back what they cover."""
    strokes: int = 0
    """How many strokes were taken: a page shows its own until then."""
    look: Look = field(default_factory=Look)
    maps: LandscapeView = field(default_factory=LandscapeView)
    search: Search | None = None
    searches: int = 0
    """How many searches were started."""
    proposals: ProposedStarts | None = None
    proposals_asked: int = 0
    """How many times proposals were asked for."""
    landscapes: tuple[LandscapeUpdate, ...] = ()
    """One for each loss that is shown."""
    ends: tuple[MethodEnd, ...] = ()
    """Where both methods ended when they were last compared on this photo and model."""
    aside: FitSettings = field(default_factory=lambda: FitSettings("paper"))
    """The settings as they were before the method was changed last."""
    overlay: Overlay | None = None
    outlines: Outlines | None = None
    """Of the objects that were not picked when they were drawn."""
    strip: Strip | None = None
    """Of the photos of the set."""
    preparation: Preparation | None = None
    """None: all is ready. Until then a search waits, and outlines are sketched."""
    anchor: Pose | None = None
    """The pose that the compared pixels are about (see ``OverlayRequest``)."""
    saved: Document | None = None
    """What stands in a file."""
    typed: tuple[str, Document] | None = None
    """The parameter that was last typed, and the document that it led to."""
    error_message: str = ""
    """What the last command could not do, and why: a sentence for the user."""

    @property
    def covariance(self) -> PoseCovariance | None:
        """How sure the pose at hand is; None where no search has said it."""
        return self.covariance_in(self.document.registration.photo)

    def covariance_in(self, photo: Photo) -> PoseCovariance | None:
        """The same of the pose in a photo: that at hand, or another of the set."""
        found, views = self.document.searched, self.document.views
        if found is not None and views is not None:
            found = self.document.own_of_photos[views.index_of(photo)].end
        return None if found is None else found.record.covariance

    @property
    def paths(self) -> frozenset[Path]:
        """The files of all photos and models that are at hand or that undo and redo can bring
        back.
        """
        documents = (*self.history.past, self.document, *self.history.future)
        return frozenset().union(*(document.paths for document in documents))

    @property
    def searching(self) -> bool:
        """Whether a search runs."""
        return self.search is not None and self.search.running

    @property
    def shown_box(self) -> Rectangle | None:
        """The rectangle about the object, while it is drawn and starts are taken from it."""
        at_hand = self.proposals is not None and self.search is None
        return self.document.marks.box if at_hand or self.tool == "box" else None

    @property
    def own_search(self) -> SearchUpdate | None:
        """The newest of the search, where it is for the picked object; of a set, where it is told
        by the large photo's camera.
        """
        latest = None if self.search is None else self.search.latest
        if latest is None or latest.together is None:
            own, views = self.document.registration, self.document.views
            is_elsewhere = latest is not None and latest.case.registration.photo is not own.photo
            return None if views is not None and is_elsewhere else latest
        return latest if latest.together.number == self.document.number else None

    def settings_by(self, method: Method) -> FitSettings:
        """The settings at hand, by a method."""
        return self.document.settings.of_method(method, self.aside)

    @property
    def mapped(self) -> tuple[FitSettings, ...]:
        """By which settings the losses are that the maps are to show."""
        own, whose = self.document.settings, self.maps.whose
        if whose == "both":
            return tuple(self.settings_by(method) for method in METHODS)
        return (own if whose == "chosen" else self.settings_by(whose),)

    @property
    def unsaved(self) -> bool:
        """Whether a pose at hand, or what is compared there, stands in no file."""
        own, kept = self.document, self.saved
        if kept is None or len(own.objects) != len(kept.objects):
            return True
        return not all(map(SceneObject.is_placed_same, own.objects, kept.objects))

    def at(self, history: History, document: Document) -> Session:
        """At another document of a history, a search ended; maps and overlay of another photo or
        object go.
        """
        same = document.shows_same(self.document)
        return replace(
            self,
            history=history,
            document=document,
            search=None,
            anchor=document.pose,
            landscapes=self.landscapes if same else (),
            ends=self.ends if same else (),
            overlay=self.overlay if same else None,
        )

    def picking(self, number: int) -> Session:
        """With another of the objects picked, which is no step; the same where it is picked."""
        document = self.document.picking(number)
        return self if document is self.document else self.at(self.history, document)

    def looking_at(self, index: int) -> Session:
        """With another photo of the set large, which is no step; what is searched goes on.

        Raises:
            SettingsError: the model is behind that photo's camera.
        """
        before, document = self.document.views, self.document.looking_at(index)
        if before is None or document is self.document:
            return self
        if not is_in_sight(document):
            raise SettingsError(f"{before.names[index]} does not show the model where it is now")
        anchor = self.anchor or self.document.pose
        poses = before.poses if anchor is self.document.pose else ()
        poses = poses or before.views.posed(before.at, anchor, before.scale)
        return replace(
            self,
            document=document,
            anchor=poses[index],
            landscapes=(),
            overlay=None,
            proposals=None,
            drag=None,
            before_drag=None,
        )

    def with_document(self, document: Document, same_step: bool = False) -> Session:
        """One undoable step to another document; with ``same_step`` undo leads to before the step
        that came last, too.

        Raises:
            FloatingPointError: the model would be behind the camera, or out of all proportion.
        """
        require_in_sight(document)
        history = self.history if same_step else self.history.with_step(self.document)
        return self.at(history, document)

    def with_pose(self, pose: Pose) -> Session:
        """One undoable step to another pose; raises as ``with_document``."""
        return self.with_document(replace(self.document, pose=pose))

    def with_error(self, text: str) -> Session:
        """The same with an error message: with a capital letter first, a full stop last."""
        text = text[:1].upper() + text[1:]
        text = text if text.endswith((".", "!", "?")) else f"{text}."
        return replace(self, error_message=text)


def is_in_sight(document: Document) -> bool:
    """Whether the model is in front of the camera, neither infinitely large nor infinitely far."""
    pose = document.pose
    radius = radius_in_photo(pose, document.registration.mesh)
    is_finite = bool(np.isfinite(pose.camera_from_model.translation).all())
    return 0.0 < radius < math.inf and is_finite


def require_in_sight(document: Document) -> None:
    """The model is in front of the camera, and neither infinitely large nor infinitely far.

    Raises:
        FloatingPointError: it is not.
    """
    if not is_in_sight(document):
        raise FloatingPointError(
            "that pose is behind the camera or out of all proportion; nothing was changed"
        )
