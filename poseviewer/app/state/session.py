"""The session: immutable state of all that the page shows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from poseviewer.app.state.document import UNLOCK, Document, label_of, loss_inputs, with_camera
from poseviewer.app.state.dragging import Drag, radius_in_photo
from poseviewer.app.state.history import History, store_changed_poses
from poseviewer.app.state.results import (
    LossComparison,
    Preparation,
    PropagationProgress,
    ProposedStarts,
    Results,
    SearchRequest,
)
from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.errors import SettingsError
from poseviewer.fit.progress import SearchProgress
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.losses.known_losses import LOSSES
from poseviewer.losses.loss import LossName
from poseviewer.scene.settings import FitSettings
from poseviewer.scene.types import Scene

MappedLoss = Literal["chosen", "all"] | LossName


@dataclass(frozen=True, slots=True)
class Pen:
    """State of the tools that hide pixels."""

    erases: bool = False
    """Whether strokes bring back what they cover."""
    for_one: bool = False
    """Whether strokes are about the active object alone, instead of the photo."""
    strokes: int = 0
    """Counter of masked strokes; a page draws its own strokes until it rises."""


@dataclass(frozen=True, slots=True)
class Display:
    """Choices of how model and maps are shown."""

    style: str = "outline"
    """Look of the model, one of ``render.overlay.LOOKS``."""
    opacity: float = 1.0
    """Opacity of the style ``solid``."""
    photo_alone: bool = False
    """Whether the model is blinked away."""
    half_width: float = 0.2
    """Half width of the maps, in each parameter's scale: 0.2 is the paper's 20 %."""
    large_map: tuple[int, int] | None = None
    """Pair of parameters whose map is shown large."""
    mapped_loss: MappedLoss = "chosen"
    """Loss that is mapped: that of the settings, one by its name, or all."""
    model_turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector, in camera axes, of the model's picture beside the photo, from its pose."""
    relative_to: str = ""
    """Label of the object in whose frame the active one's pose is also shown; "": none."""
    sees_maps: bool = True
    """Whether a page shows the maps, and they are computed."""
    motion_graph: bool = False
    """Whether the motion over the frames is drawn above the time line."""
    propagates_alone: bool = False
    """Whether the active object alone is propagated to start and end, instead of all."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Everything that the page shows."""

    document: Document
    history: History = field(default_factory=History)
    saved: Document | None = None
    """Document as it was saved last."""
    saved_before: tuple[Document, ...] = ()
    """Documents that were open before, as they were saved last: undo may lead back to them."""
    tool: str = "pose"
    drag: Drag | None = None
    measured: tuple[tuple[Photo, FloatArray], ...] = ()
    """Photos and pixels (2,) of the last points, at most two, of the tool ``measure``."""
    pen: Pen = field(default_factory=Pen)
    display: Display = field(default_factory=Display)
    search: SearchRequest | None = None
    """Search that runs, or has ended and is neither kept nor reverted."""
    search_progress: SearchProgress | None = None
    """Newest progress of that search."""
    comparison: LossComparison | None = None
    """Last comparison of the losses for this photo and model."""
    kept_settings: Mapping[LossName, FitSettings] = field(default_factory=dict)
    """Settings of losses that were chosen before."""
    proposals_by_object: Mapping[int, ProposedStarts | None] = field(default_factory=dict)
    """Proposed starts by the objects' ids."""
    wanted_frame: int | None = None
    """Index of the frame that is shown once its photo is read; None: the one that is shown."""
    is_at_work: bool = False
    """Whether a task is done that takes a moment, such as to read a video."""
    propagation: PropagationProgress | None = None
    """Propagation that runs, or has ended just now."""
    anchor: Scene | None = None
    """Scene about which pixels are compared, fixed while the model moves; None: the document's."""
    results: Results = field(default_factory=Results)
    preparation: Preparation | None = None
    """None: all is ready. Until then searches wait, and outlines are sketched."""

    @property
    def compared_scene(self) -> Scene:
        """The scene about which pixels are compared."""
        return self.anchor or self.document.scene

    @property
    def request(self) -> Session:
        """The session for workers: without results and history, which take memory."""
        return replace(self, results=Results(), history=History(), proposals_by_object={})

    @property
    def read_scene(self) -> Scene:
        """The scene about which the pixels of the loss at the pose lie; at rest the document's, so
        that a pose has one loss, whatever led to it.
        """
        return self.compared_scene if self.is_moving else self.document.scene

    @property
    def pixels(self) -> tuple[object, ...]:
        """Values that are equal if the same pixels are compared by the same loss."""
        return *self.document.shown, *loss_inputs(self.read_scene, self.document.active)

    @property
    def at_pose(self) -> tuple[object, ...]:
        """Values that are equal if the loss is the same."""
        return self.document.pose, *self.pixels

    @property
    def drawn(self) -> tuple[object, ...]:
        """Values that are equal if the picture of the model is the same."""
        display = self.display
        return display.style, display.opacity, self.preparation is None, *self.at_pose

    def covariance_in(self, view_index: int) -> PoseCovariance | None:
        """Covariance of the active object's pose in a view; None: no search gave one."""
        return self.document.scene.covariance(self.document.active, view_index)

    @property
    def is_searching(self) -> bool:
        """Whether a search runs."""
        progress = self.search_progress
        return self.search is not None and not (progress is not None and progress.is_over)

    @property
    def is_propagating(self) -> bool:
        """Whether poses are propagated through frames."""
        return self.propagation is not None and not self.propagation.is_over

    @property
    def is_moving(self) -> bool:
        """Whether a drag or a search moves the model, so that the next pose follows at once."""
        is_dragged = self.drag is not None and self.drag.before is not None
        return is_dragged or self.is_searching

    @property
    def own_progress(self) -> SearchProgress | None:
        """Progress of the search, if it is for the active object by the large view's chart."""
        progress, document = self.search_progress, self.document
        if progress is None or progress.object_index != document.active:
            return None
        return progress if progress.problem.views[0].view_index == document.view_index else None

    @property
    def other_outlines(self) -> tuple[FloatArray, ...]:
        """Outlines of the comparison's other ends, while one of its ends is shown."""
        comparison, shown = self.comparison, None if self.is_searching else self.own_progress
        if comparison is None or shown not in comparison.ends:
            return ()
        pairs = zip(comparison.ends, comparison.outlines, strict=True)
        return tuple(outline for end, outline in pairs if end is not shown)

    def settings_by(self, loss: LossName) -> FitSettings:
        """Settings of the active object for a loss."""
        return self.document.settings.of_loss(loss, self.kept_settings.get(loss))

    def keeping(self, settings: FitSettings) -> Session:
        """The session that takes these settings up when their loss is chosen again."""
        return replace(self, kept_settings={**self.kept_settings, settings.loss: settings})

    @property
    def mapped(self) -> tuple[FitSettings, ...]:
        """Settings for each loss that is mapped, with the focal length that a search frees."""
        chosen, mapped = self.document.settings.loss, self.display.mapped_loss
        names = LOSSES if mapped == "all" else (chosen if mapped == "chosen" else mapped,)
        settings = tuple(map(self.settings_by, names))
        if self.own_progress is not None and self.own_progress.settings.free_focal:
            settings = tuple(replace(own, free_focal=True) for own in settings)
        return settings

    @property
    def proposals(self) -> ProposedStarts | None:
        """Proposed starts of the active object in the large view."""
        proposals = self.proposals_by_object.get(self.document.object_id)
        return proposals if proposals and proposals.document.shown == self.document.shown else None

    def with_proposals(self, proposals: ProposedStarts | None) -> Session:
        """The session with other proposed starts of the active object."""
        changed = {self.document.object_id: proposals}
        return replace(self, proposals_by_object={**self.proposals_by_object, **changed})

    @property
    def is_proposing(self) -> bool:
        """Whether start poses are being searched for."""
        return self.proposals is not None and not self.proposals.is_over

    @property
    def is_looking(self) -> bool:
        """Whether starts are proposed for a model without a pose; any pose ends that."""
        return self.is_proposing and not self.document.object.is_placed

    @property
    def with_first_proposals(self) -> Session:
        """The session with starts requested, if the active object has no pose."""
        is_placed = self.document.object.is_placed
        return self if is_placed else self.with_proposals(ProposedStarts(self.document))

    def stop_proposing(self) -> Session:
        """The session whose proposals for the active object have ended."""
        proposals = self.proposals
        if proposals is None or proposals.is_over:
            return self
        return self.with_proposals(replace(proposals, is_over=True) if proposals.starts else None)

    def stop_propagating(self) -> Session:
        """The session that stays at its frame, and whose propagation has ended."""
        progress = self.propagation
        if progress is not None and not progress.is_over:
            notes = (*progress.notes, "stopped by you")
            progress = replace(progress, notes=notes, is_over=True)
        is_same = progress is self.propagation and self.wanted_frame is None
        return self if is_same else replace(self, propagation=progress, wanted_frame=None)

    @property
    def measurement_pixels(self) -> tuple[FloatArray, ...]:
        """Pixels (2,) that the measuring tool, if it is in use, has pressed in the large photo."""
        measured = self.measured if self.tool == "measure" else ()
        return tuple(pixel for photo, pixel in measured if photo is self.document.photo)

    @property
    def marks_model(self) -> bool:
        """Whether the tool marks points of the model beside the photo."""
        is_first = self.tool == "wheels" and self.document.model.keypoints is None
        return is_first or self.tool == "pairs"

    @property
    def shows_model(self) -> bool:
        """Whether the model stands beside the photo, to be marked or with wheels marked by hand."""
        return self.marks_model or (self.tool == "wheels" and bool(self.document.marks.hubs))

    @property
    def shown_box(self) -> Rectangle | None:
        """Box about the object, while it is drawn and while starts in it can be chosen."""
        is_used = self.proposals is not None and self.search is None
        return self.document.marks.box if is_used or self.tool == "box" else None

    @property
    def is_unsaved(self) -> bool:
        """Whether a pose, or what files keep with it, has changed since it was saved."""
        saved = (one.placement for one in (self.saved, *self.saved_before) if one is not None)
        return self.document.placement not in saved

    def with_history(self, history: History, document: Document) -> Session:
        """The session at a document of a history, without a search and stale results."""
        is_same = document.object_id == self.document.object_id
        has_pose_now = is_same and self.is_looking and document.object.is_placed
        session = self.stop_proposing() if has_pose_now else self
        if document.shown != self.document.shown:
            session = replace(session.with_new_view(), comparison=None)
        session = replace(session.without_search(document.scene), propagation=None)
        return replace(session, history=history, document=document, wanted_frame=None)

    def without_search(self, anchor: Scene) -> Session:
        """The session without a search; pixels are compared about ``anchor``."""
        return replace(self, search=None, search_progress=None, anchor=anchor)

    def with_new_view(self) -> Session:
        """The session without results of the photo and the model that were shown."""
        return replace(self, results=Results(outlines=self.results.outlines))

    def with_active(self, index: int) -> Session:
        """Make an object active; no undo step."""
        document = self.document.with_active(index)
        return self if document is self.document else self.with_history(self.history, document)

    def with_document(self, document: Document, key: object = None) -> Session:
        """Take an undo step to another document; consecutive steps with the same ``key`` are one.
        In a sequence, poses that differ become keys of the shown frame.

        Raises:
            FloatingPointError: the model would be behind the camera, or infinitely large or far.
            SettingsError: a locked object would move.
        """
        if not is_in_sight(document):
            raise FloatingPointError(
                "that pose is behind the camera or out of all proportion; nothing was changed"
            )
        _require_unlocked(self.document, document)
        document = store_changed_poses(self.document, document)
        return self.with_history(self.history.with_step(self.document, document, key), document)

    def with_pose(self, pose: Pose) -> Session:
        """Take an undo step to another pose; fails like ``with_document``."""
        return self.with_document(self.document.at_pose(pose))


def is_in_sight(document: Document) -> bool:
    """Whether the model is in front of the camera, and neither infinitely large nor far."""
    pose = document.pose
    is_finite = bool(np.isfinite(pose.camera_from_model.translation).all())
    return is_finite and 0.0 < radius_in_photo(pose, document.mesh) < math.inf


def _require_unlocked(before: Document, now: Document) -> None:
    """Refuse to move a locked object in the photo; its camera may change."""
    has_new_pose = before.shown == now.shown and before.pose is not now.pose
    if not (has_new_pose and before.object.locked and now.object.locked):
        return
    unmoved = with_camera(before.pose, now.pose.camera, now.mesh.centre)
    pixels = [pose.project(now.mesh.vertices) for pose in (unmoved, now.pose)]
    if not np.allclose(*pixels, rtol=0.0, atol=1e-4, equal_nan=True):
        label = label_of(now.object)
        raise SettingsError(f"{label} is locked: {UNLOCK} to move it; nothing was changed")
