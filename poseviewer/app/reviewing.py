"""The rows of a batch in the app, each an ordinary document; tasks do what is requested."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

from poseviewer.app.state.display_edits import set_fields
from poseviewer.app.state.document import Document
from poseviewer.app.state.document_edits import open_document
from poseviewer.app.state.edits import Edit, ReviewRow
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import picture_of, scene_to_save
from poseviewer.app.workers.opening import open_files, with_notes
from poseviewer.app.workers.tasks import QueuedTask, TaskResult
from poseviewer.app.workers.worker import Worker
from poseviewer.batch import review as r
from poseviewer.batch.result_folder import ACCEPTED, Row
from poseviewer.batch.run import save_summaries
from poseviewer.errors import BatchError, PoseViewerError
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.render.renderers import RendererName

MAX_NAMED = 3
"""Rows that could not be opened and are named; the list marks all that failed."""


class Reviewer:
    """The queue of rows, and the reports on them."""

    def __init__(self, folder: Path, renderer: RendererName | None = None) -> None:
        """``renderer``: by default the batch's."""
        loaded = self.queue = r.load_queue(folder)
        batch = self.queue.batch.settings
        self.settings = replace(batch, keep_start=False, renderer=renderer or batch.renderer)
        """Settings of each row; whether to keep to a start is here for a person to say."""
        self.job: Worker[r.ReviewQueue, Edit] = Worker(
            "review report", lambda _: None if self.queue is loaded else self.queue, _report
        )
        """Writes table and report after each word on a row."""

    def row_at(self, document: Document) -> int | None:
        """The index of the row whose photo and object are at hand; None: they are no row's."""
        here = [path and path.resolve() for path in (document.view.path, document.model.path)]
        for index, row in enumerate(self.queue.rows):
            job = row.job
            if document.number == job.row:
                paths = job.path(job.photo), job.path(job.model)
                return index if here == [path.resolve() for path in paths] else None
        return None

    def where(self, document: Document) -> str:
        """The row's pose file, as it is shown; "": what is open is no row's."""
        at = self.row_at(document)
        return "" if at is None else self.queue.rows[at].result.pose or "a new file in poses/"

    def open_first(self) -> Document:
        """Open the first row that can be opened; raises as ``_open_from``."""
        return self._open_from(0, 1)

    def close(self) -> None:
        """Write table and report at a clean end."""
        self.job.close()
        save_summaries(self.queue.batch)

    def make_task(self, request: ReviewRow) -> QueuedTask:
        """The task of a request."""
        match request.what:
            case int(index):
                return self.open_row(index)
            case "next" | "previous" as side:
                return self.step(1 if side == "next" else -1)
            case decision:
                return self.decide(decision)

    def open_row(self, index: int) -> QueuedTask:
        """Open a row of the batch."""
        return _task(lambda now: self._going(now, index, 0))

    def step(self, by: int) -> QueuedTask:
        """Open the next row, or with -1 the one before."""

        def run(now: Session) -> TaskResult:
            at = self.row_at(now.document)
            return self._going(now, by - 1 if at is None else at + by, by)

        return _task(run)

    def annotate(self, index: int, note: str) -> QueuedTask:
        """Keep a note on a row."""

        def run(_: Session) -> TaskResult:
            self.queue = r.annotate(self.queue, index, note)
            return TaskResult()

        return _task(run)

    def decide(
        self, review: Literal["accepted", "rejected", ""], goes_on: bool = True
    ) -> QueuedTask:
        """Keep a decision on the open row ("": none), and a pose that was corrected; go on."""

        def run(now: Session) -> TaskResult:
            document = now.document
            at = self.row_at(now.document)
            done = tuple[Edit, ...]()
            if at is None:
                raise BatchError("What is open is no row's; press a row in the list to open it.")
            if review == ACCEPTED and now.is_unsaved:
                mask = document.scene.mask(document.active, document.view_index)
                record = pose_json(
                    as_saved(scene_to_save(now)), document.active, document.view_index
                )
                picture = picture_of(document)
                self.queue = r.save_corrected(self.queue, at, record, picture, mask)
                done = (set_fields(saved=document),)
            else:
                _require_saved(now)
                self.queue = r.decide(self.queue, at, review)
            left = [i for i, row in enumerate(self.queue.rows) if i > at and not row.result.review]
            if not (goes_on and review and left):
                return TaskResult(done)
            try:
                return self._opening(left[0], 1, *done)
            except PoseViewerError as error:
                return TaskResult(done, (str(error),))

        return _task(run, draws=True)

    def _going(self, now: Session, index: int, by: int) -> TaskResult:
        """Leave the row that is open for another one; raises as ``_open_from``."""
        _require_saved(now)
        return self._opening(index, by)

    def _opening(self, index: int, by: int, *done: Edit) -> TaskResult:
        """Open a row after what is ``done``; raises as ``_open_from``."""
        document = self._open_from(index, by)
        return TaskResult((*done, open_document(document, is_first=True)), document.scene.notes)

    def _open_from(self, index: int, by: int) -> Document:
        """Open a row, or, where it cannot be opened, the next one in steps ``by``.

        Raises:
            BatchError: there is none.
        """
        rows, skipped = self.queue.rows, list[str]()
        for row in rows[index : None if by else index + 1 : by or 1] if index >= 0 else ():
            try:
                document = self._open(row)
            except PoseViewerError as error:
                skipped.append(f"Row {row.job.row} cannot be opened: {error}")
            else:
                return with_notes(document, skipped[:MAX_NAMED])
        end = f"This is the {'last' if by > 0 else 'first'} of {len(rows)} rows."
        raise BatchError(" ".join(skipped[:MAX_NAMED]) or end)

    def _open(self, row: Row) -> Document:
        """Photo, model and pose of a row."""
        job, queue = row.job, self.queue
        photo, model = job.path(job.photo), job.path(job.model)
        pose = queue.batch.folder / row.result.pose if row.result.pose else job.path(job.start)
        try:
            document = open_files(photo, model, pose)
        except PoseViewerError:
            if row.result.pose:
                raise
            # It failed for want of a start, maybe: a person can place the model.
            document = open_files(photo, model, None)
        settings = self.settings
        document = document.with_own(region=settings.region)
        return document.with_object(settings=replace(settings, region=None), id=str(job.row))


def _task(run: Callable[[Session], TaskResult], draws: bool = False) -> QueuedTask:
    return QueuedTask(lambda now, _: run(now), draws=draws)


def _report(queue: r.ReviewQueue) -> Iterator[Edit]:
    save_summaries(queue.batch)
    yield from ()


def _require_saved(session: Session) -> None:
    """Raise where going on would lose a pose that is not saved."""
    if session.is_unsaved:
        raise BatchError("The pose is changed: accept it (A), save it (S) or take it back (Z).")
