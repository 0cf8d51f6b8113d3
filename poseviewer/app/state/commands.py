"""What a user, or a worker, asks of the session. Points are photo px, pixel centres at i + 0.5."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from poseviewer.app.state.document import Document
from poseviewer.app.state.identify_commands import IdentifyCommand
from poseviewer.app.state.session import LandscapeUpdate, Overlay, SearchUpdate
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Pose
from poseviewer.vehicle.ellipses import Ellipse

Projection = Literal["perspective", "parallel"]
Tool = Literal["pose", "region", "box", "pairs", "wheels"]


@dataclass(frozen=True, slots=True)
class Press:
    """The main button went down at a point of the photo."""

    x: float
    y: float
    zoom: float = 1.0
    """Screen px per photo px: what is near is told on the screen."""
    shift: bool = False
    ctrl: bool = False


@dataclass(frozen=True, slots=True)
class DragTo:
    """The pointer moved, the button down."""

    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Release:
    """The button went up."""


@dataclass(frozen=True, slots=True)
class CancelDrag:
    """The drag is to be forgotten: the pose goes back to where it was."""


@dataclass(frozen=True, slots=True)
class DoublePress:
    """Pin the surface point seen there, or take the pin there away."""

    x: float
    y: float
    zoom: float = 1.0


@dataclass(frozen=True, slots=True)
class Nudge:
    """A small step of the pose, as from a key."""

    kind: Literal["move", "turn", "roll", "scale"]
    x: float = 0.0
    """Steps: to the right, about the vertical, clockwise, or larger."""
    y: float = 0.0
    """Steps: downwards, or about the horizontal."""


@dataclass(frozen=True, slots=True)
class SetNumber:
    """One number of the chart, by its name."""

    name: str
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class SetPose:
    """Another pose: a picked point of a map, or a file's."""

    pose: Pose
    as_start: bool = False
    """Whether ``reset`` goes back to it from now on."""


@dataclass(frozen=True, slots=True)
class ResetToStart:
    """Back to the start pose."""


@dataclass(frozen=True, slots=True)
class MakeStart:
    """The pose at hand becomes the start pose."""


@dataclass(frozen=True, slots=True)
class LookFrom:
    """The model as a whole in the middle of the photo, seen from one of its sides."""

    side: str


@dataclass(frozen=True, slots=True)
class Undo:
    """One step back."""


@dataclass(frozen=True, slots=True)
class Redo:
    """One step on again."""


@dataclass(frozen=True, slots=True, eq=False)
class AlterSettings:
    """Some of the settings, as they are by then: what was changed just before stays changed."""

    alter: Callable[[FitSettings], FitSettings]


@dataclass(frozen=True, slots=True)
class SetProjection:
    """Perspective or parallel; the model stays where it is and as large."""

    projection: Projection


@dataclass(frozen=True, slots=True)
class SetCamera:
    """Intrinsics in px, as OpenCV has them (pixel centres at integers)."""

    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True, slots=True)
class SetFieldOfView:
    """Equal focal lengths from the view of the photo's longer side; the centre stays."""

    degrees: float


@dataclass(frozen=True, slots=True, eq=False)
class Open:
    """Another photo, model or both, read and ready."""

    document: Document
    unsaved: bool = False
    """Whether its pose stands in no file."""


@dataclass(frozen=True, slots=True)
class SetTool:
    """What a press does: the pose, the rectangle of the region or about the object, a point pair,
    or a wheel's rim.
    """

    tool: Tool


@dataclass(frozen=True, slots=True)
class RemoveMark:
    """Take the last mark of the tool at hand away: half a point pair, or a point of a rim."""


@dataclass(frozen=True, slots=True)
class ClearMarks:
    """Take all marks of the tool at hand away."""


@dataclass(frozen=True, slots=True, eq=False)
class LayWheels:
    """Ellipses that were found: marks on both rims, and the pose that they give."""

    registration: Registration
    """The photo and the model that they were found for."""
    rear: Ellipse
    front: Ellipse
    pose: Pose


@dataclass(frozen=True, slots=True)
class ProposeStarts:
    """Look for start poses, in the rectangle about the object or in the whole photo."""


@dataclass(frozen=True, slots=True, eq=False)
class StartsProposed:
    """What came of the ``number``-th asking: poses, the likeliest first."""

    number: int
    poses: tuple[Pose, ...]


@dataclass(frozen=True, slots=True)
class ProposingFailed:
    """Why nothing came of the ``number``-th asking."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True)
class StepProposals:
    """Show another proposal: the one so many places on."""

    by: int = 1


@dataclass(frozen=True, slots=True)
class TakeProposal:
    """The proposal that is shown becomes the start pose."""


@dataclass(frozen=True, slots=True)
class ChangeView:
    """How the model is shown; None leaves as it is."""

    look: str | None = None
    opacity: float | None = None
    wipe: float | None = None
    hidden: bool | None = None
    rings: bool | None = None
    before: bool | None = None


@dataclass(frozen=True, slots=True)
class ChangeLandscape:
    """How the maps are drawn; None leaves as it is."""

    half_width: float | None = None
    shared_scale: bool | None = None
    large: tuple[int, int] | None = None
    close_large: bool = False
    surface: bool | None = None


@dataclass(frozen=True, slots=True)
class PickInLandscape:
    """A point (u, v) of a map, in [0, 1] from its lower left corner: the pose goes there."""

    first: int
    second: int
    u: float
    v: float


@dataclass(frozen=True, slots=True)
class StartSearch:
    """Search from the pose at hand."""


@dataclass(frozen=True, slots=True)
class StopSearch:
    """Stop; the best pose so far is kept."""


@dataclass(frozen=True, slots=True)
class AcceptSearch:
    """Keep what the search found, and close its books."""


@dataclass(frozen=True, slots=True)
class RevertSearch:
    """Back to the pose before the search."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchAdvanced:
    """A worker's news of search ``search``."""

    search: int
    latest: SearchUpdate


@dataclass(frozen=True, slots=True, eq=False)
class SearchFailed:
    """Search ``search`` could not be run."""

    search: int
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class LandscapeAdvanced:
    """A worker's news of the maps."""

    latest: LandscapeUpdate


@dataclass(frozen=True, slots=True, eq=False)
class OverlayDrawn:
    """A worker has drawn the model, and knows the loss there."""

    overlay: Overlay


@dataclass(frozen=True, slots=True, eq=False)
class LossComputed:
    """A worker knows the loss of a pose that is, or a moment ago was, drawn."""

    overlay: Overlay


@dataclass(frozen=True, slots=True, eq=False)
class Saved:
    """``pose`` stands in a file."""

    pose: Pose


Command = (
    Press
    | DragTo
    | Release
    | CancelDrag
    | DoublePress
    | Nudge
    | SetNumber
    | SetPose
    | ResetToStart
    | MakeStart
    | LookFrom
    | Undo
    | Redo
    | AlterSettings
    | SetProjection
    | SetCamera
    | SetFieldOfView
    | Open
    | SetTool
    | RemoveMark
    | ClearMarks
    | LayWheels
    | ProposeStarts
    | StartsProposed
    | ProposingFailed
    | StepProposals
    | TakeProposal
    | ChangeView
    | ChangeLandscape
    | PickInLandscape
    | StartSearch
    | StopSearch
    | AcceptSearch
    | RevertSearch
    | SearchAdvanced
    | SearchFailed
    | LandscapeAdvanced
    | OverlayDrawn
    | LossComputed
    | Saved
    | IdentifyCommand
)
