"""What a page asks of the main loop beyond the session: files in and out, help, a review."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, dataclass_transform

from poseviewer.batch.results import JobResult
from poseviewer.files.file_set import Kind

Export = Literal["pose", "overlay", "sheet", "maps-npz"]


@dataclass_transform(frozen_default=True)
class Request:
    """Anything that is asked of the main loop; see ``commands`` for what changes the session. Each
    kind is a frozen dataclass, told from others of its kind by identity with ``eq=False``.
    """

    def __init_subclass__(cls, eq: bool = True) -> None:
        dataclass(frozen=True, eq=eq)(cls)

    def given(self, *names: str) -> dict[str, Any]:
        """The fields of these names that are not None."""
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}


class Upload(Request, eq=False):
    """Files that a page sent together."""

    kind: Kind | None
    """What the user called them; None: whatever they are."""
    name: str
    data: bytes
    """See ``files.state.uploads.pack``."""
    adds: bool = False
    """Whether models are added as further objects, instead of replacing the active one."""


class Unfit(Request):
    """A page has a file that cannot be uploaded."""

    client: int
    why: str


class SavePose(Request):
    """Write the pose beside the photo."""


class FindWheels(Request):
    """Look for both wheels in the region that is drawn."""


class Download(Request):
    """Send a file to one page."""

    what: Export
    client: int


class ShowHelp(Request):
    """Open the panel with the keys on one page."""

    client: int


class Restore(Request):
    """Open what an earlier session left behind (or forget it)."""

    wanted: bool


class Report(Request, eq=False):
    """What a page's own script reports."""

    content: dict[str, Any]
    client: int


class Greet(Request):
    """A page has connected."""

    client: int


class OpenRow(Request):
    """Open a row of the batch that is reviewed."""

    index: int


class StepRow(Request):
    """Open the next row, or with -1 the one before."""

    by: int


class Decide(Request):
    """A person's verdict on the row that is open ("": none); the next row follows."""

    review: Literal["accepted", "rejected", ""]


class Annotate(Request):
    """A note on a row."""

    index: int
    note: str


class RowSaved(Request, eq=False):
    """Show the review of a row, once its file holds it."""

    index: int
    result: JobResult
