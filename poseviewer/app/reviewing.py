"""A batch's rows in the app, one after the other; keeps what is unsaved instead of the autosaver.

All but ``open_row``, which the tasks' thread runs, is the main loop's.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from poseviewer.app.state.document import Document, SceneObject, SearchEnd
from poseviewer.app.state.objects import (
    AddObject,
    AlterObject,
    DuplicateObject,
    PickObject,
    RemoveObject,
)
from poseviewer.app.state.requests import Annotate, Request, Review, SavePose, Upload
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import picture_of
from poseviewer.app.workers.opening import Opened, open_files
from poseviewer.app.workers.tasks import Reviewed, Task
from poseviewer.app.workers.worker import Worker
from poseviewer.batch import review as r
from poseviewer.batch.table import file_stamp
from poseviewer.errors import BatchError, PoseViewerError, sentence_of
from poseviewer.files.masks import is_same_mask, mask_beside, save_pose_and_mask
from poseviewer.files.pose import PoseRecord, load_pose
from poseviewer.fit.registration import LoadedModel
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.photo import Photo
from poseviewer.starts.registration import load_model, load_registration, registered

PERIOD_S = 0.8
"""How often a draft is kept: with the main loop's rest, a second is lost to a crash."""
MODELS_KEPT = 4
MOST_SKIPPED_SAID = 3

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ReviewState:
    """What the page shows of a review."""

    place: int
    """Of the row at hand in the queue, from 1."""
    queue: r.ReviewQueue
    mended: bool
    """Whether the pose at hand is another than the row's."""
    trouble: str = ""
    """Why table and report are not up to date."""

    @property
    def row(self) -> r.ReviewRow:
        """The row at hand."""
        return self.queue.rows[self.place - 1]


class Reviewer:
    """Which row is open, and what is kept of it."""

    def __init__(self, folder: Path) -> None:
        self._queue = r.load_queue(folder)
        self._at = self._wanted = 0
        self._found: Document | None = None
        self._kept: Document | None = None
        self._next = time.monotonic() + PERIOD_S
        self._reporter: Worker[None] = Worker("review report")
        self._stale = True
        self._trouble = ""

    # --- what the autosaver does otherwise ------------------------------------------------------

    def offer(self) -> None:
        """Nothing is offered: what was being mended opens with its row."""

    def take_offer(self, wanted: bool) -> None:
        """Nothing was offered."""

    def adopt(self, session: Session) -> None:
        """The draft that was opened is kept where it is."""
        self._kept = session.document

    def tick(self, session: Session) -> str:
        """Keep what is being mended every second; bring table and report up to date."""
        if time.monotonic() >= self._next:
            self.save_now(session)
        self._report()
        return ""

    def save_now(self, session: Session) -> None:
        """Keep the pose at hand as a draft, where it is not the row's own."""
        self._next = time.monotonic() + PERIOD_S
        document = session.document
        if document is self._kept:
            return
        own = document.registration
        try:
            if self.mended(session):
                record = PoseRecord(
                    document.pose,
                    undistortion=own.photo.undistortion,
                    without=own.mesh.left_out,
                )
                save_pose_and_mask(self._queue.draft(self.row), record, own.mask)
            else:
                r.drop_draft(self._queue, self.row)
            self._kept = document
        except PoseViewerError as error:
            _log.warning("the draft was not kept: %s", error)
            self._next = time.monotonic() + 60.0  # a full disk will not be mended in seconds

    def close(self, session: Session) -> None:
        """At a clean end: keep the draft, and finish table and report."""
        self.save_now(session)
        self._reporter.close()
        try:
            r.save_reviewed(self._queue)
        except PoseViewerError as error:
            _log.warning("table and report are not up to date: %s", error)

    def where(self, session: Session) -> str:
        """The row's pose file, as it is shown."""
        del session
        return self.row.result.pose or "a new file in poses/"

    # --- the queue ------------------------------------------------------------------------------

    @property
    def row(self) -> r.ReviewRow:
        """The row at hand."""
        return self._queue.rows[self._at]

    def state(self, session: Session) -> ReviewState:
        """What the page shows."""
        return ReviewState(self._at + 1, self._queue, self.mended(session), self._trouble)

    def mended(self, session: Session) -> bool:
        """Whether the pose at hand, or what is compared there, is another than the row has."""
        own, found = session.document, self._found
        if found is None or not own.pose.is_same(found.pose):
            return True
        here, there = own.registration, found.registration
        return here.mask is not there.mask or here.mesh is not there.mesh

    def takes(self, request: Request) -> bool:
        """Whether a request is for the review."""
        match request:
            case Review() | Annotate() | SavePose():
                return True
            case PickObject() | AddObject() | DuplicateObject() | RemoveObject():
                return True
            case AlterObject():
                return request.locked is not None
            case Upload():
                return request.kind != "pose"
        return False

    def task_for(self, request: Request, session: Session, record: PoseRecord) -> Task | None:
        """What a request asks for; None where it is done at once. ``record`` is of the session.

        Raises:
            PoseViewerError: it cannot be done.
        """
        match request:
            case Upload():
                raise BatchError(
                    "In a review, photo and model are the row's; start poseviewer without `review` "
                    "to open others. A pose file can be opened here."
                )
            case PickObject():
                rows = self._queue.rows
                places = {row.job.row: place for place, row in enumerate(rows)}
                wanted = places.get(request.number, self._wanted)
                return self.step(wanted - self._wanted, session) if wanted != self._wanted else None
            case AddObject() | DuplicateObject() | RemoveObject() | AlterObject():
                raise BatchError(
                    "In a review the objects of an image are rows of the batch, and stay where "
                    "their rows have them; press one in the list to open its row."
                )
            case Annotate():
                row = next(row for row in self._queue.rows if row.job.key == request.key)
                self._renew(row, r.annotate(self._queue, row, request.note))
                return None
            case Review(what="take back"):
                self._renew(self.row, r.take_back(self._queue, self.row))
                return None
            case Review(what="next" | "previous"):
                return self.step(1 if request.what == "next" else -1, session)
        leave = isinstance(request, Review)
        if not self.mended(session):
            result = r.accept(self._queue, self.row)
            return self.finish(Reviewed(self.row, result, leave), session)
        return self._accepting(session, record, leave)

    def step(self, by: int, session: Session) -> Task:
        """To the next row, or the one before; what was being mended is kept as a draft.

        Raises:
            BatchError: there is none.
        """
        self.save_now(session)
        wanted = self._wanted + by
        if not 0 <= wanted < len(self._queue.rows):
            raise BatchError(
                f"This is the {'last' if by > 0 else 'first'} of {len(self._queue.rows)} rows; "
                f"{self._queue.accepted} are accepted."
            )
        self._wanted = wanted
        return lambda _: self.open_row(wanted, by)

    def finish(self, done: Reviewed, session: Session) -> Task | None:
        """Take what was kept of a row; gives the way to the next one not accepted, if wanted."""
        self._renew(done.row, done.result)
        if done.row.job.key == self.row.job.key and done.mended is not None:
            self._found, self._kept = done.mended, None
        if not done.leave or done.row.job.key != self.row.job.key or self._wanted != self._at:
            return None
        rows = self._queue.rows
        left = [i for i in range(self._at + 1, len(rows)) if not rows[i].result.review]
        return self.step(left[0] - self._wanted, session) if left else None

    def opened(self, opened: Opened) -> None:
        """A row has been opened: it is the one at hand now."""
        self._at = self._wanted = next(
            i for i, row in enumerate(self._queue.rows) if row.job.key == opened.row
        )
        self._found = opened.found if self.row.result.pose else None
        self._kept = opened.document

    def gave_up(self) -> None:
        """No row could be opened where one was wanted."""
        self._wanted = self._at

    def open_first(self) -> Opened:
        """Open the first row that can be opened; raises as ``open_row``."""
        opened = next(self.open_row(0, 1))
        self.opened(opened)
        return opened

    def open_row(self, index: int, step: int) -> Iterator[Opened]:
        """Open a row; one whose files cannot be used is skipped, with a word.

        Raises:
            BatchError: there is none that way that can be opened.
        """
        skipped: list[str] = []
        step = 1 if step > 0 else -1
        while 0 <= index < len(self._queue.rows):
            row = self._queue.rows[index]
            try:
                opened = self._open(row)
            except PoseViewerError as error:
                skipped.append(f"Row {row.job.row} cannot be opened: {error}")
                index += step
                continue
            more = len(skipped) - MOST_SKIPPED_SAID
            said = (*skipped[:MOST_SKIPPED_SAID], *([f"... and {more} more"] if more > 0 else []))
            yield replace(opened, warnings=(*said, *opened.warnings))
            return
        raise BatchError(" ".join(skipped[:MOST_SKIPPED_SAID]))

    # --- its own ---------------------------------------------------------------------------------

    def _open(self, row: r.ReviewRow) -> Opened:
        # Whether to keep to a start is here for a person to say.
        job, settings = row.job, replace(self._queue.manifest.settings, keep_start=False)
        model = _model(job.path(job.model), file_stamp(job.path(job.model)))
        photo, start = job.path(job.photo), self._queue.start(row)
        try:
            registration = load_registration(photo, model, start)
        except PoseViewerError:
            if row.result.pose:
                raise
            # It failed for want of a start, maybe: a person can place the model.
            registration = open_files(photo, job.path(job.model), None).document.registration
            registration = replace(registration, mesh=model.mesh, keypoints=model.keypoints)
        shown = registration.photo
        document = Document(
            registration,
            registration.start,
            settings,
            photo_path=photo,
            model_path=job.path(job.model),
            number=job.row,
            others=self._mates(row, shown),
        )
        if document.others:  # the list says of each what came of it
            document = replace(document, end=self._end(row, registration.start, shown))
        found, draft = document, self._queue.draft(row)
        restored = draft.is_file()
        if restored:
            record = load_pose(draft, shown.width, shown.height)
            mask, _ = mask_beside(draft, record, shown.width, shown.height)
            mask = registration.mask if is_same_mask(mask, registration.mask) else mask
            mesh = registration.mesh.without(record.without)
            changed = replace(document.registration, mask=mask, mesh=mesh)
            document = replace(document, registration=changed, pose=record.pose)
        said = registration.warnings
        return Opened(document, said, row=job.key, restored=restored, found=found)

    def _mates(self, row: r.ReviewRow, photo: Photo) -> tuple[SceneObject, ...]:
        """The other objects of a BOP scene's image, where their rows have them, and locked; without
        those that cannot be used, which is said when their rows are opened.
        """
        mates: list[SceneObject] = []
        for mate in self._queue.rows if self._queue.manifest.scene is not None else ():
            job, path = mate.job, self._queue.start(mate)
            if job.photo != row.job.photo or job.row == row.job.row or not mate.result.pose:
                continue
            try:
                model = _model(job.path(job.model), file_stamp(job.path(job.model)))
                record = load_pose(path, photo.width, photo.height)
                model = replace(model, mesh=model.mesh.without(record.without))
            except PoseViewerError:
                continue
            mates.append(
                SceneObject(
                    registered(photo, model, record.pose, (), None),
                    record.pose,
                    self._queue.manifest.settings,
                    model_path=job.path(job.model),
                    number=job.row,
                    locked=True,
                    end=self._end(mate, record.pose, photo),
                )
            )
        return tuple(mates)

    def _end(self, row: r.ReviewRow, pose: Pose, photo: Photo) -> SearchEnd | None:
        """How a row's search ended; None where no search led to its pose."""
        if not row.result.pose:
            return None
        record = load_pose(self._queue.start(row), photo.width, photo.height)
        return None if record.verdict is None else SearchEnd(replace(record, pose=pose))

    def _accepting(self, session: Session, record: PoseRecord, leave: bool) -> Task:
        """Draw and keep the pose at hand, away from the main loop."""
        queue, row, document = self._queue, self.row, session.document

        def run(_: Session) -> Iterator[Reviewed]:
            mask = document.registration.mask
            result = r.accept_mended(queue, row, record, picture_of(document), mask)
            yield Reviewed(row, result, leave, document)

        return run

    def _renew(self, row: r.ReviewRow, result: r.JobResult) -> None:
        self._queue = self._queue.renewed(row, result)
        self._stale = True

    def _report(self) -> None:
        """Write table and report anew, in a thread, when something has changed."""
        latest = self._reporter.take()
        if latest is not None and latest.finished:
            self._trouble = "" if latest.error is None else sentence_of(latest.error)
        if self._stale and not self._reporter.busy:
            self._stale = False
            queue = self._queue
            self._reporter.start(lambda: _reported(queue))


@lru_cache(maxsize=MODELS_KEPT)
def _model(path: Path, stamp: tuple[int, int]) -> LoadedModel:  # noqa: ARG001
    """A model, read once for the rows that share it, while its file is the same."""
    return load_model(path)


def _reported(queue: r.ReviewQueue) -> Iterator[None]:
    r.save_reviewed(queue)
    yield None
