"""Work that takes a moment and must all be done, in order: opening files, drawing exports."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.app.state.commands import AddCandidate, Command, LayWheels, SetTool
from poseviewer.app.state.requests import Download, Upload
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import export
from poseviewer.app.workers.opening import (
    Opened,
    open_candidate,
    open_model,
    open_photo,
    open_pose,
)
from poseviewer.app.workers.worker import Worker
from poseviewer.batch.results import JobResult
from poseviewer.batch.review import ReviewRow
from poseviewer.errors import PoseViewerError, QuickStartError
from poseviewer.files.state.folder import last_pose
from poseviewer.files.state.uploads import display_name, keep_upload
from poseviewer.geometry.camera import Pose
from poseviewer.starts.registration import StartInputs
from poseviewer.starts.wheels import find_wheels


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """Files for a page."""

    client: int
    files: Mapping[str, bytes]
    """Their contents, by their names."""


@dataclass(frozen=True, slots=True, eq=False)
class Reviewed:
    """What a person said of a row is kept."""

    row: ReviewRow
    """As it was."""
    result: JobResult
    leave: bool
    """Whether the next row is wanted."""
    pose: Pose | None = None
    """The one that was mended, which is the row's now."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What the session is to be told."""

    commands: tuple[Command, ...]
    warnings: tuple[str, ...] = ()


Result = Opened | Exported | Found | Reviewed
Task = Callable[[Session], Iterator[Result]]
"""Work on what is open when it begins."""


class Tasks:
    """A queue of tasks, and the thread that does them."""

    def __init__(self, notify: Callable[[], None], state: Path) -> None:
        self._worker: Worker[Result] = Worker("tasks", notify)
        self._state = state
        self._waiting: deque[Task] = deque()

    def add(self, task: Task | None) -> None:
        """Do a task (None: nothing) when those before it are done."""
        if task is not None:
            self._waiting.append(task)

    def add_upload(self, upload: Upload) -> None:
        """Keep an uploaded file, and open it on what is open by then."""

        def run(session: Session) -> Iterator[Opened | Found]:
            folder = self._state / "uploads"
            path = keep_upload(folder, upload.name, upload.data, upload.kind, in_use=session.paths)
            now, name = session.document, display_name(upload.name)
            if upload.kind == "photo":
                opened = open_photo(now, path, name)
            elif upload.beside:
                opened = _add_candidate(path, name)
            elif upload.kind == "model":
                opened = open_model(now, path, name)
            else:
                opened = open_pose(now, path)
            return _under_its_name(opened, path.name, name)

        self.add(run)

    def add_last_pose(self) -> None:
        """Open the pose that was saved last, as a start on what is open by then."""
        self.add(lambda now: open_pose(now.document, last_pose(self._state)))

    def add_export(self, request: Download, session: Session) -> None:
        """Make files of the session for a page."""

        def run(_: Session) -> Iterator[Exported]:
            yield Exported(request.client, export(request.what, session))

        self.add(run)

    def collect(self) -> tuple[Result | None, Exception | None] | None:
        """How a task has ended since the last time: its result, or why there is none."""
        update = self._worker.take()
        return None if update is None or not update.finished else (update.item, update.error)

    def start_next(self, now: Session) -> None:
        """Begin the next task, on what is open ``now``, unless one is running."""
        if self._waiting and not self._worker.busy:
            task = self._waiting.popleft()
            self._worker.start(lambda: task(now))

    def close(self) -> None:
        """End the thread."""
        self._waiting.clear()
        self._worker.close()


def find_wheels_in_region(session: Session) -> Iterator[Found]:
    """Look for wheels in the region that is drawn, for the camera at hand.

    Raises:
        QuickStartError: there is no region, or there are no wheels in it.
    """
    document = session.document
    own, region = document.registration, document.settings.region
    if region is None:
        raise QuickStartError("Draw a region about the car first; wheels are sought in it.")
    photo, camera = own.photo, document.pose.camera
    is_guess = camera == photo.default_camera() and photo.focal_length_35mm is None
    found = find_wheels(StartInputs(photo, own.mesh, own.keypoints), region, camera, is_guess)
    laid = LayWheels(own, found.wheels.rear, found.wheels.front, found.fit.pose)
    yield Found((SetTool("wheels"), laid))


def _add_candidate(path: Path, name: str) -> Iterator[Found]:
    candidate, notes = open_candidate(path, name)
    yield Found((AddCandidate(candidate),), notes)


def _under_its_name(
    opened: Iterator[Opened] | Iterator[Found], kept: str, name: str
) -> Iterator[Opened | Found]:
    """What is said of an uploaded file calls it as its user does, not as it was ``kept``."""
    try:
        for item in opened:
            warnings = tuple(warning.replace(kept, name, 1) for warning in item.warnings)
            yield replace(item, warnings=warnings)
    except PoseViewerError as error:
        raise type(error)(str(error).replace(kept, name, 1)) from error
