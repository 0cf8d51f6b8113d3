"""What a page asks of the main loop beyond the session: files in and out, help, a review."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from poseviewer.files.file_set import Kind
from poseviewer.files.set_questions import Choosing

Becomes = Literal["at hand", "candidate", "object"]
"""What models that come are: the one at hand, candidates for it, or objects beside it."""
Export = Literal["pose", "overlay", "sheet", "maps-npz", "maps-csv"]


class Request:
    """Anything that is asked of the main loop; see ``commands`` for what changes the session."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class Upload(Request):
    """Files that a page sent together."""

    kind: Kind | None
    """What the user called them; None: whatever they are."""
    name: str
    data: bytes
    """See ``files.state.uploads.pack``."""
    client: int
    becomes: Becomes = "at hand"


@dataclass(frozen=True, slots=True, eq=False)
class Answer(Request):
    """What a user says of files that say nothing themselves."""

    choosing: Choosing
    answer: str
    client: int


@dataclass(frozen=True, slots=True)
class Unfit(Request):
    """A page has a file that cannot be uploaded."""

    client: int
    why: str


@dataclass(frozen=True, slots=True)
class SavePose(Request):
    """Write the pose beside the photo."""


@dataclass(frozen=True, slots=True)
class FindWheels(Request):
    """Look for both wheels in the region that is drawn."""


@dataclass(frozen=True, slots=True)
class Download(Request):
    """Send a file to one page."""

    what: Export
    client: int


@dataclass(frozen=True, slots=True)
class ShowHelp(Request):
    """Open the panel with the keys on one page."""

    client: int


@dataclass(frozen=True, slots=True)
class Restore(Request):
    """Open what an earlier session left behind (or forget it)."""

    wanted: bool


@dataclass(frozen=True, slots=True, eq=False)
class Report(Request):
    """What a page's own script reports."""

    content: dict[str, Any]
    client: int


@dataclass(frozen=True, slots=True)
class Greet(Request):
    """A page has connected."""

    client: int


@dataclass(frozen=True, slots=True)
class UseLastPose(Request):
    """Start from the pose that was saved last."""


@dataclass(frozen=True, slots=True)
class Review(Request):
    """What is to become of the row under review; ``accept`` goes on to the next one."""

    what: Literal["next", "previous", "accept", "take back"]


@dataclass(frozen=True, slots=True)
class Annotate(Request):
    """A note on the row of a key."""

    key: str
    note: str
