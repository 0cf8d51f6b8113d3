"""Queue of tasks that are all done, in order: opening files, drawing downloads."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.document import Document, in_few_views
from poseviewer.app.state.edits import (
    AskNumbers,
    AskStill,
    Edit,
    ReviewRow,
    SavePose,
    ShowHelp,
    open_document,
)
from poseviewer.app.state.hiding import Stroke, mask_pixels
from poseviewer.app.state.marking import lay_wheels
from poseviewer.app.state.objects import add_object, take_painting
from poseviewer.app.state.pointer_edits import set_tool
from poseviewer.app.state.results import Pace
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import OF_FRAMES, Export, export
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.opening import has_demo_model, open_autosaved, open_file_set
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import FileSetError, QuickStartError, SettingsError, percent
from poseviewer.files.formats.conversion import ConvertOptions
from poseviewer.files.image_sequence import ImageSequence, load_sequence
from poseviewer.files.scene_assets import load_model
from poseviewer.files.state.session_file import AutosavedSession
from poseviewer.files.video import survey_video
from poseviewer.fit.painting import paint_object
from poseviewer.geometry.camera import size_at_scale
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import LensModel
from poseviewer.opening.scenes import notes_of
from poseviewer.opening.sources import Kind, Sources, files_below, sort_set
from poseviewer.opening.uploads import (
    MAX_UPLOAD_BYTES,
    call_missing,
    display_name,
    gather,
    keep_set,
)
from poseviewer.starts.start import StartInputs
from poseviewer.starts.wheels import likely_wheels

LONG_VIDEO = 300
"""Frames of a video above which it is asked how many are taken: ten seconds of a phone's film."""
TELL_S = 0.2
"""Least time between two reports of a task's progress, s: people read no faster."""


@dataclass(frozen=True, slots=True, eq=False)
class TaskResult:
    """Result of a task for the main loop."""

    edits: tuple[Edit, ...] = ()
    notes: tuple[str, ...] = ()
    """Sentences for all pages."""
    files: Mapping[str, bytes] = field(default_factory=dict)
    """Contents by names, for one page."""
    client: int = -1
    """Id of that page's client."""
    question: LongVideo | UnsavedPose | None = None
    """Question to that page, whose answer goes on."""


@dataclass(frozen=True, slots=True, eq=False)
class LongVideo:
    """Question how many frames of a long video are taken."""

    name: str
    frames: int
    """Number of its frames."""
    seconds: float
    """About how long it takes to read them, s."""
    open: Callable[[int], QueuedTask]
    """Makes the task that opens every N-th frame."""


@dataclass(frozen=True, slots=True, eq=False)
class UnsavedPose:
    """Question whether files are opened that replace a pose which is in no file."""

    name: str
    """Name of the first file."""
    open: QueuedTask


@dataclass(frozen=True, slots=True)
class TaskProgress:
    """Progress of a task."""

    working: str
    """Sentence on the page meanwhile."""
    pace: Pace


Tell = Callable[..., object]
"""Is given the number of frames that are done, and that of all, and maybe another sentence on the
page; raises where the task is dropped.
"""


@dataclass(frozen=True, slots=True, eq=False)
class QueuedTask:
    """Work that takes a moment."""

    run: Callable[[Session, Path, Tell], TaskResult]
    """Does the work on the session of that moment; the path is the folder of the app's state."""
    working: str = ""
    """Sentence on the page meanwhile."""
    draws: bool = False
    """Whether the task waits until the model can be drawn."""
    size: int = 0
    """Bytes that the task holds until it begins."""


@dataclass(frozen=True, slots=True)
class Restore:
    """Request to open the autosave of an earlier session, or to drop it."""

    wanted: bool


Request = Edit | QueuedTask | SavePose | ShowHelp | AskNumbers | AskStill | ReviewRow | Restore
"""Request of a page to the main loop."""


class TaskQueue(Worker[tuple[QueuedTask, Session], TaskResult]):
    """Queue of tasks, and the thread that does them."""

    def __init__(self, state: Path) -> None:
        def do(request: tuple[QueuedTask, Session]) -> Iterator[TaskResult]:
            task, session = request
            began, told = time.monotonic(), 0.0

            def tell(done: float, total: int, working: str = task.working) -> None:
                nonlocal told
                self.require_current(request)
                now = time.monotonic()
                if now > told + TELL_S:
                    told = now
                    pace = Pace(done, total, now - began)
                    self.mailbox.publish(task, TaskProgress(working, pace))
                    self.mailbox.notify()

            yield task.run(session, state, tell)

        super().__init__("tasks", lambda _: None, do, failed=lambda *_: TaskResult())
        self._waiting: list[QueuedTask] = []

    def add(self, task: QueuedTask) -> None:
        """Add a task.

        Raises:
            FileSetError: too many bytes are waiting.
        """
        size = sum(waiting.size for waiting in self._waiting)
        if size and size + task.size > MAX_UPLOAD_BYTES:
            raise FileSetError(
                "Other uploads are still being read; wait for their end, then drop it again."
            )
        self._waiting.append(task)

    def follow(self, session: Session) -> None:
        """Begin the next task once the result of the one before is taken."""
        cannot_draw = session.preparation is not None and not session.preparation.trouble
        task = next((task for task in self._waiting if not (task.draws and cannot_draw)), None)
        is_free = not self.busy and not self.mailbox.has_news(self)
        if task is not None and is_free:
            self._waiting.remove(task)
            self.begin((task, session))

    def drop(self) -> bool:
        """Drop all tasks, also the running one; False: there were none."""
        has_tasks = bool(self._waiting) or self.busy
        self._waiting.clear()
        self.stop()
        return has_tasks


def upload(
    kind: Kind | None,
    name: str,
    data: bytes,
    adds: bool = False,
    lens_model: LensModel | None = None,
    client: int = -1,
    missing: Sequence[str] = (),
) -> QueuedTask:
    """Store files that a page sent together, and open them; ask first how many frames of a long
    video are taken, and where a pose would be replaced that is in no file.

    Args:
        kind: what the user chose them as; None: any.
        name: of the first file, for the user.
        data: a file, or a zip of several.
        adds: whether models become further objects.
        lens_model: OpenCV's lens model, if the file of cameras does not name one.
        client: id of the page's client.
        missing: names of files that the open model misses; any other is taken for the first.
    """
    working = f"Reading {name[:60]} ..."

    def open_kept(
        root: Path, every: int | None, is_sure: bool, now: Session, state: Path, tell: Tell
    ) -> TaskResult:
        uploads = state / "uploads"
        files = sort_set(files_below(root), kind, None if adds else now.document.model.path)
        models = [gather(uploads, model) for model in files.models]
        if not adds:
            if isinstance(files.frames, tuple) and len(files.frames) == 1:
                (video,) = files.frames
                count, seconds = survey_video(video)
                if count > LONG_VIDEO and every is None:
                    question = LongVideo(video.name, count, count * seconds, ask_again(root))
                    return TaskResult(client=client, question=question)
                files = replace(files, frames=read_video(video, count, every or 1, tell))
            document = open_file_set(now.document, files, models, root, lens_model)
            if not is_sure and _loses_pose(now, document, files):
                again = QueuedTask(partial(open_kept, root, every, True), working)
                return TaskResult(client=client, question=UnsavedPose(display_name(name), again))
            looks = not has_demo_model(document)
            return TaskResult((open_document(document, looks=looks),), document.scene.notes)
        if not models:
            raise FileSetError(f"{display_name(name)}: holds no model; choose one.")
        loaded = [load_model(model) for model in models]
        notes = (note for model in loaded for note in notes_of(model))
        return TaskResult(tuple(map(add_object, loaded)), (*notes, *files.notes))

    def ask_again(root: Path) -> Callable[[int], QueuedTask]:
        return lambda every: QueuedTask(partial(open_kept, root, every, False), working)

    def run(now: Session, state: Path, tell: Tell) -> TaskResult:
        root = keep_set(state / "uploads", call_missing(data, missing))
        return open_kept(root, None, False, now, state, tell)

    return QueuedTask(run, working, size=len(data))


def _loses_pose(now: Session, opened: Document, files: Sources) -> bool:
    """Whether what is opened replaces a pose that is in no file."""
    if not (now.is_unsaved and any(item.is_placed for item in now.document.scene.objects)):
        return False
    is_model_alone = replace(files, models=(), unused=()) == Sources()
    if is_model_alone and [model.path for model in files.models] == [now.document.model.path]:
        return False  # it is completed, and keeps its pose
    shown, after = (
        ([view.path for view in d.scene.views], [item.model.path for item in d.scene.objects])
        for d in (now.document, opened)
    )
    return shown != after or files.start is not None


def read_video(video: Path, count: int, every: int, tell: Tell) -> ImageSequence:
    """Read every N-th frame of a video of ``count`` frames, and tell of each."""
    taken = max(-(-count // every), 1)

    def show(share: float) -> None:
        tell(min(int(taken * share) + 1, taken), taken)

    return load_sequence((video,), every, progress=show)


def restore(autosave: AutosavedSession) -> QueuedTask:
    """Open the autosave of an earlier session."""

    def run(*_: object) -> TaskResult:
        document = open_autosaved(autosave)
        return TaskResult((open_document(document, unsaved=True),), document.scene.notes)

    return QueuedTask(run)


def download(what: Export, client: int, numbers: ConvertOptions | None = None) -> QueuedTask:
    """Make files of the session for a page, in BOP with numbers."""
    working = "Drawing ..." if what in ("overlay", "sheet", "bop", *OF_FRAMES) else ""

    def run(now: Session, _: Path, tell: Tell) -> TaskResult:
        notes: list[str] = []
        files = export(what, now, notes, numbers, tell)
        return TaskResult(notes=tuple(notes), files=files, client=client)

    return QueuedTask(run, working, draws=what == "overlay")


def paint_active() -> QueuedTask:
    """Paint the active object's model from the photos that show it, or from the keys."""

    def run(session: Session, *_: object) -> TaskResult:
        document, item = session.document, session.document.object
        if not item.is_placed:
            raise SettingsError("Place the model first; it is painted from where it is.")
        painting = paint_object(in_few_views(document.scene, document.active), document.active)
        for mesh in (painting.mesh, painting.contrast):
            renderer_of(mesh)
        count, share = len(painting.photos), f"{percent(painting.share)} of the surface is painted"
        note = f"{share}, from {count} photo{'s' * (count > 1)}."
        return TaskResult((take_painting(item.id, painting),), (note,))

    return QueuedTask(run, "Painting ...", draws=True)


def find_wheels_in_region() -> QueuedTask:
    """Find wheels in the region by the current camera."""

    def run(session: Session, *_: object) -> TaskResult:
        document, region = session.document, session.document.in_view.region
        if region is None:
            raise QuickStartError("Draw a region about the car first; wheels are sought in it.")
        inputs = StartInputs(document.photo, document.mesh, document.model.keypoints, document.mask)
        photo, camera = document.photo, document.pose.camera
        is_guess = camera == photo.default_camera() and photo.focal_length_35mm is None
        best = likely_wheels(inputs, region, camera, is_guess)[0]
        return TaskResult((set_tool("wheels"), lay_wheels(document, best)))

    return QueuedTask(run, "Looking for wheels ...", draws=True)


MARGIN = 1.0
"""Margin of the cut-out around the scribble's box, in the box's longer side."""
MIN_MARGIN = 0.05
"""Least margin, in the photo's longer side, for a mere tap."""
CUT_OUT_PX = 320
"""Longer side to which the cut-out is resized: GrabCut takes half a second there."""
ROUNDS = 5
"""Rounds of GrabCut: more change next to nothing."""


def grow(stroke: Stroke) -> QueuedTask:
    """Mask or unmask the thing under a scribble."""

    def run(session: Session, *_: object) -> TaskResult:
        photo = session.document.photo
        return TaskResult((mask_pixels(photo, segment(photo, stroke), stroke.erase),))

    return QueuedTask(run, "Finding its edge ...")


def segment(photo: Photo, stroke: Stroke) -> NDArray[np.bool_]:
    """Segment the thing under a scribble by its colours: (height, width), GrabCut (Rother,
    Kolmogorov, Blake 2004).

    Raises:
        QuickStartError: the scribble is not on the photo.
    """
    drawn = stroke.covers(photo.width, photo.height)
    if not drawn.any():
        raise QuickStartError("That scribble is beside the photo; draw it on the thing in front.")
    low, high = stroke.points.min(axis=0), stroke.points.max(axis=0)
    margin = max(MARGIN * max(high - low), MIN_MARGIN * max(photo.width, photo.height))
    (left, top), (right, bottom) = (low - margin).astype(int), (high + margin).astype(int) + 1
    part = slice(max(top, 0), bottom), slice(max(left, 0), right)
    height, width = drawn[part].shape
    size = size_at_scale(width, height, min(1.0, CUT_OUT_PX / max(height, width)))
    small = np.ascontiguousarray(replace(photo, pixels=photo.pixels[part]).as_rgb8(*size))
    seeds = cv2.resize(drawn[part].astype(np.float32), size, interpolation=cv2.INTER_AREA)
    seeded = seeds >= min(0.5, float(seeds.max()))
    # The cut-out's border is background, but where it is the photo's border.
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
