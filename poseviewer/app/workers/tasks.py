"""Work that takes a moment and must all be done, in order: opening files, drawing exports."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.document_edits import open_document
from poseviewer.app.state.edits import Edit, ReviewRow, SavePose, ShowHelp
from poseviewer.app.state.hiding import Stroke, mask_pixels
from poseviewer.app.state.marking import lay_wheels
from poseviewer.app.state.objects import add_object
from poseviewer.app.state.pointer_edits import set_tool
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import Export, export
from poseviewer.app.workers.opening import has_demo_model, open_autosaved, open_file_set
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import FileSetError, QuickStartError
from poseviewer.files.file_set import Kind, files_below, sort_set
from poseviewer.files.scene_assets import load_model
from poseviewer.files.state.autosave import AutosavedSession
from poseviewer.files.state.uploads import MAX_UPLOAD_BYTES, display_name, gather, keep_set
from poseviewer.geometry.camera import size_at_scale
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import LensModel
from poseviewer.starts.loading import StartInputs, notes_of
from poseviewer.starts.wheels import likely_wheels


@dataclass(frozen=True, slots=True, eq=False)
class TaskResult:
    """Result of a task for the main loop."""

    edits: tuple[Edit, ...] = ()
    notes: tuple[str, ...] = ()
    """Sentences for all pages."""
    files: Mapping[str, bytes] = field(default_factory=dict)
    """Contents by names, for one page."""
    client: int = -1
    """That page."""


@dataclass(frozen=True, slots=True, eq=False)
class QueuedTask:
    """Work that takes a moment."""

    run: Callable[[Session, Path], TaskResult]
    """Does it, on what is open when it begins; the path is that of the app's state."""
    working: str = ""
    """Sentence on the page meanwhile."""
    draws: bool = False
    """Whether it waits until the model can be drawn."""
    size: int = 0
    """Bytes that it holds until it begins."""


@dataclass(frozen=True, slots=True)
class Restore:
    """Open what an earlier session left behind (or forget it)."""

    wanted: bool


Request = Edit | QueuedTask | SavePose | ShowHelp | ReviewRow | Restore
"""Requests of pages to the main loop."""


class TaskQueue(Worker[tuple[QueuedTask, Session], TaskResult]):
    """A queue of tasks, and the thread that does them."""

    def __init__(self, notify: Callable[[], None], state: Path) -> None:
        def do(asked: tuple[QueuedTask, Session]) -> Iterator[TaskResult]:
            task, now = asked
            yield task.run(now, state)

        super().__init__("tasks", lambda _: None, do, notify, failed=lambda *_: TaskResult())
        self._waiting: list[QueuedTask] = []

    def add(self, task: QueuedTask) -> None:
        """Do a task when those before it are done; raises ``FileSetError``: too much waits."""
        held = sum(waiting.size for waiting in self._waiting)
        if held and held + task.size > MAX_UPLOAD_BYTES:
            raise FileSetError(
                "Other uploads are still being read; wait for their end, then drop it again."
            )
        self._waiting.append(task)

    def follow(self, session: Session) -> None:
        """Begin the next task, on what is open, once the one before is done and taken."""
        held = session.preparation is not None and not session.preparation.trouble
        task = next((task for task in self._waiting if not (task.draws and held)), None)
        is_free = not self.busy and self._item is None and self._error is None
        if task is not None and is_free:
            self._waiting.remove(task)
            self.begin((task, session))

    def drop(self) -> bool:
        """Forget all tasks, and what comes of the one that is running; False: there are none."""
        dropped = bool(self._waiting) or self.busy
        self._waiting.clear()
        self.stop()
        return dropped


def upload(
    kind: Kind | None,
    name: str,
    data: bytes,
    adds: bool = False,
    lens_model: LensModel | None = None,
) -> QueuedTask:
    """Keep files that a page sent together, and open them.

    Args:
        kind: what the user called the files; None: whatever they are.
        name: the file, or the first of them, as its user sees it.
        data: a file, or a zip of several.
        adds: models are further objects, and replace none.
        lens_model: OpenCV's model of a lens in a file of cameras that does not say it.
    """

    def run(now: Session, state: Path) -> TaskResult:
        uploads = state / "uploads"
        root = keep_set(uploads, data)
        files = sort_set(files_below(root), kind, None if adds else now.document.model.path)
        models = [gather(uploads, model) for model in files.models]
        if not adds:
            document = open_file_set(now.document, files, models, root, lens_model)
            looks = not has_demo_model(document)
            return TaskResult((open_document(document, looks=looks),), document.scene.notes)
        if not models:
            raise FileSetError(f"{display_name(name)}: holds no model; choose one.")
        loaded = [load_model(model) for model in models]
        notes = (note for model in loaded for note in notes_of(model))
        return TaskResult(tuple(map(add_object, loaded)), (*notes, *files.notes))

    return QueuedTask(run, f"Reading {name[:60]} ...", size=len(data))


def restore(kept: AutosavedSession) -> QueuedTask:
    """Open what an earlier session left."""

    def run(*_: object) -> TaskResult:
        document = open_autosaved(kept)
        return TaskResult((open_document(document, unsaved=True),), document.scene.notes)

    return QueuedTask(run)


def download(what: Export, client: int, unit: str = "") -> QueuedTask:
    """Make files of the session for a page; ``unit``: the model's, where it is known."""
    working = "Drawing ..." if what in ("overlay", "sheet") else ""

    def run(now: Session, _: Path) -> TaskResult:
        return TaskResult(files=export(what, now, unit), client=client)

    return QueuedTask(run, working, draws=what == "overlay")


def find_wheels_in_region() -> QueuedTask:
    """Look for wheels in the region that is drawn, for the camera at hand; refused without one."""

    def run(session: Session, _: Path) -> TaskResult:
        own, region = session.document, session.document.own.region
        if region is None:
            raise QuickStartError("Draw a region about the car first; wheels are sought in it.")
        inputs = StartInputs(own.photo, own.mesh, own.model.keypoints, own.mask)
        photo, camera = own.photo, own.pose.camera
        is_guess = camera == photo.default_camera() and photo.focal_length_35mm is None
        best = likely_wheels(inputs, region, camera, is_guess)[0]
        return TaskResult((set_tool("wheels"), lay_wheels(own, best)))

    return QueuedTask(run, "Looking for wheels ...", draws=True)


REACH = 1.0
"""Reach of the neighbourhood beyond the scribble's box, in its longer side."""
MIN_REACH = 0.05
"""Least reach, in the photo's longer side: a thing that was merely tapped."""
SIDE_PX = 320
"""Longer side of the picture that is cut: GrabCut takes half a second there."""
ROUNDS = 5
"""Rounds of GrabCut: more change next to nothing."""


def grow(stroke: Stroke) -> QueuedTask:
    """Hide the thing below a scribble, to its edge, or bring it back."""

    def run(session: Session, _: Path) -> TaskResult:
        photo = session.document.photo
        return TaskResult((mask_pixels(photo, grown(photo, stroke), stroke.erase),))

    return QueuedTask(run, "Finding its edge ...")


def grown(photo: Photo, stroke: Stroke) -> NDArray[np.bool_]:
    """(height, width): the thing that a scribble lies on, to its edge, as the colours of the
    neighbourhood tell it (C. Rother, V. Kolmogorov, A. Blake, *GrabCut*, 2004).

    Raises:
        QuickStartError: the scribble is not on the photo.
    """
    drawn = stroke.covers(photo.width, photo.height)
    if not drawn.any():
        raise QuickStartError("That scribble is beside the photo; draw it on the thing in front.")
    low, high = stroke.points.min(axis=0), stroke.points.max(axis=0)
    reach = max(REACH * max(high - low), MIN_REACH * max(photo.width, photo.height))
    (left, top), (right, bottom) = (low - reach).astype(int), (high + reach).astype(int) + 1
    part = slice(max(top, 0), bottom), slice(max(left, 0), right)
    height, width = drawn[part].shape
    size = size_at_scale(width, height, min(1.0, SIDE_PX / max(height, width)))
    small = np.ascontiguousarray(replace(photo, pixels=photo.pixels[part]).as_rgb8(*size))
    seeds = cv2.resize(drawn[part].astype(np.float32), size, interpolation=cv2.INTER_AREA)
    seeded = seeds >= min(0.5, float(seeds.max()))
    # What lies at the neighbourhood's border is not of the thing; the photo's own may cut it off.
    labels = np.full(seeds.shape, cv2.GC_BGD, np.uint8)
    rows = slice(int(top > 0), size[1] - int(bottom < photo.height))
    labels[rows, int(left > 0) : size[0] - int(right < photo.width)] = cv2.GC_PR_BGD
    labels[seeded] = cv2.GC_FGD
    if not np.all(seeded):
        cv2.setRNGSeed(0)
        models = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.grabCut(small, labels, (0, 0, 1, 1), *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    thing = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    _, pieces = cv2.connectedComponents(thing, connectivity=4)
    thing *= np.isin(pieces, np.unique(pieces[seeded]))
    thing = cv2.dilate(thing, np.ones((3, 3), np.uint8)).astype(np.float32)  # the edge is blurred
    cut = cv2.resize(thing, (width, height), interpolation=cv2.INTER_LINEAR) >= 0.5
    drawn[part] |= cut
    return drawn
