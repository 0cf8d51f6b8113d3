"""What the page asks for beyond the session: files in and out, and help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from poseviewer.app.state.commands import Command
from poseviewer.files.state.uploads import Kind

Export = Literal["pose", "overlay", "sheet", "maps-npz", "maps-csv"]


@dataclass(frozen=True, slots=True, eq=False)
class Upload:
    """A file that a page sent."""

    kind: Kind
    name: str
    data: bytes
    beside: bool = False
    """Of a model: whether it goes into the line-up, and the one at hand stays."""


@dataclass(frozen=True, slots=True)
class Unfit:
    """A page has a file that cannot be uploaded."""

    client: int
    why: str


@dataclass(frozen=True, slots=True)
class SavePose:
    """Write the pose beside the photo."""


@dataclass(frozen=True, slots=True)
class FindWheels:
    """Look for both wheels in the region that is drawn."""


@dataclass(frozen=True, slots=True)
class Download:
    """Send a file to one page."""

    what: Export
    client: int


@dataclass(frozen=True, slots=True)
class ShowHelp:
    """Open the panel with the keys on one page."""

    client: int


@dataclass(frozen=True, slots=True)
class Restore:
    """Open what an earlier session left behind (or forget it)."""

    wanted: bool


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """What a page's own script reports."""

    content: dict[str, Any]
    client: int


@dataclass(frozen=True, slots=True)
class Greet:
    """A page has connected."""

    client: int


@dataclass(frozen=True, slots=True)
class UseLastPose:
    """Start from the pose that was saved last."""


@dataclass(frozen=True, slots=True)
class Review:
    """What is to become of the row under review; ``accept`` goes on to the next one."""

    what: Literal["next", "previous", "accept", "take back"]


@dataclass(frozen=True, slots=True)
class Annotate:
    """A note on the row of a key."""

    key: str
    note: str


Request = (
    Command
    | Upload
    | Unfit
    | SavePose
    | FindWheels
    | Download
    | ShowHelp
    | Restore
    | Report
    | Greet
    | UseLastPose
    | Review
    | Annotate
)
