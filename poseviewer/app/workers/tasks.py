"""Work that takes a moment and must all be done, in order: opening files, drawing exports."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.app.state.commands import AddCandidate, Command, LayWheels, SetTool
from poseviewer.app.state.requests import Download, Upload
from poseviewer.app.state.session import Session
from poseviewer.app.workers.opening import (
    Opened,
    open_candidate,
    open_model,
    open_photo,
    open_pose,
    restore,
)
from poseviewer.app.workers.worker import Worker
from poseviewer.batch.results import JobResult
from poseviewer.batch.review import ReviewRow
from poseviewer.errors import PoseViewerError, QuickStartError
from poseviewer.files.state.autosave import AutosavedSession
from poseviewer.files.state.last_pose import last_pose
from poseviewer.files.state.uploads import display_name, keep_upload
from poseviewer.geometry.camera import Pose
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import StartInputs
from poseviewer.starts.wheels import find_wheels


@dataclass(frozen=True, slots=True, eq=False)
class Exported:
    """A file for a page."""

    client: int
    name: str
    content: bytes


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


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """A task that has ended, one way or the other."""

    result: Result | None
    error: Exception | None = None


Task = Callable[[Session, SoftwareRenderer], Iterator[Result]]


class Tasks:
    """A queue of tasks, and the thread that does them."""

    def __init__(self, notify: Callable[[], None], state: Path) -> None:
        self._worker: Worker[Result] = Worker("tasks", notify)
        self._state = state
        self._uploads = state / "uploads"
        self._waiting: deque[Task] = deque()

    def add_upload(self, upload: Upload) -> None:
        """Keep an uploaded file, and open it on what is open by then."""

        def run(session: Session, renderer: SoftwareRenderer) -> Iterator[Opened | Found]:
            path = keep_upload(
                self._uploads, upload.name, upload.data, upload.kind, in_use=session.paths
            )
            now, name = session.document, display_name(upload.name)
            if upload.kind == "photo":
                opened = open_photo(now, renderer, path, name)
            elif upload.beside:
                opened = _candidate(path, name)
            elif upload.kind == "model":
                opened = open_model(now, path, name)
            else:
                opened = open_pose(now, renderer, path)
            return _under_its_name(opened, path.name, name)

        self._waiting.append(run)

    def add(self, task: Task | None) -> None:
        """Do a task (None: nothing) when those before it are done."""
        if task is not None:
            self._waiting.append(task)

    def add_last_pose(self) -> None:
        """Open the pose that was saved last, as a start on what is open by then."""
        self.add(lambda now, renderer: open_pose(now.document, renderer, last_pose(self._state)))

    def add_restore(self, kept: AutosavedSession) -> None:
        """Open what an earlier session left."""
        self._waiting.append(lambda *_: restore(kept))

    def add_export(self, request: Download, make: Callable[[], tuple[str, bytes]]) -> None:
        """Make a file for a page."""

        def run(*_: object) -> Iterator[Exported]:
            name, content = make()
            yield Exported(request.client, name, content)

        self._waiting.append(run)

    def add_wheels(self) -> None:
        """Look for wheels in the region that is drawn by then, for the camera at hand."""

        def run(session: Session, _: SoftwareRenderer) -> Iterator[Found]:
            document = session.document
            registration, region = document.registration, document.settings.region
            if region is None:
                raise QuickStartError("Draw a region about the car first; wheels are sought in it.")
            material = StartInputs(registration.photo, registration.mesh, registration.keypoints)
            photo, camera = registration.photo, document.pose.camera
            is_guess = camera == photo.default_camera() and photo.focal_length_35mm is None
            found = find_wheels(material, region, camera, is_guess)
            wheels = found.wheels
            laid = LayWheels(registration, wheels.rear, wheels.front, found.fit.pose)
            yield Found((SetTool("wheels"), laid))

        self._waiting.append(run)

    def collect(self) -> list[Done]:
        """What has ended since the last time."""
        latest = self._worker.take()
        if latest is None or not latest.finished:
            return []
        return [Done(latest.item, latest.error)]

    def start_next(self, now: Session, renderer: SoftwareRenderer) -> None:
        """Begin the next task, on what is open ``now``, unless one is running."""
        if self._waiting and not self._worker.busy:
            task = self._waiting.popleft()
            self._worker.start(lambda: task(now, renderer))

    def close(self) -> None:
        """End the thread."""
        self._waiting.clear()
        self._worker.close()


def _candidate(path: Path, name: str) -> Iterator[Found]:
    """A model for the line-up."""
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
