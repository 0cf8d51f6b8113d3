"""The rows of a batch in the app, each an ordinary document. What is asked of the review is done by
tasks, one after the other; their results are taken into the queue by the main loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from poseviewer.app.state import requests as q
from poseviewer.app.state.commands import mark_saved, open_document
from poseviewer.app.state.document import Document
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import picture_of, saved_scene
from poseviewer.app.workers.opening import Opened, open_files
from poseviewer.app.workers.tasks import Found, Task
from poseviewer.app.workers.worker import Worker
from poseviewer.batch import review as r
from poseviewer.batch.results import ACCEPTED, Row
from poseviewer.errors import BatchError, PoseViewerError
from poseviewer.starts.loading import pose_record

MOST_SAID = 3
"""Rows that could not be opened and are named; the list marks all that failed."""


class Reviewer:
    """The queue of rows, and the reports on them."""

    def __init__(self, folder: Path) -> None:
        self.queue = r.load_queue(folder)
        self._reporter: Worker[None] = Worker("review report")

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

    def open_first(self) -> Opened:
        """Open the first row that can be opened; raises as ``_open_from``."""
        return self._open_from(0, 1)

    def close(self) -> None:
        """Write table and report at a clean end."""
        self._reporter.finish()
        r.save_reviewed(self.queue)

    def takes(self, request: q.Request, session: Session) -> bool:
        """Whether a request is for the review."""
        if isinstance(request, q.SavePose):
            return self.row_at(session.document) is not None
        kinds = q.OpenRow, q.StepRow, q.Decide, q.Annotate, q.RowSaved
        return isinstance(request, kinds)

    def task_for(self, request: q.Request) -> Task | None:
        """The task that a request asks for; None where it is done at once."""
        if not isinstance(request, q.RowSaved):
            return lambda now: self._answer(request, now)
        self.queue = queue = self.queue.renewed(request.index, request.result)

        def report() -> Iterator[None]:
            r.save_reviewed(queue)
            yield

        self._reporter.start(report)
        return None

    def _answer(self, request: q.Request, now: Session) -> Iterator[Found]:
        """Do what is asked of the row that is open by now.

        Raises:
            PoseViewerError: it cannot be done.
        """
        queue, at = self.queue, self.row_at(now.document)
        match request:
            case q.OpenRow(index):
                _require_saved(now)
                yield self._opening(index, 0)
            case q.StepRow(by):
                _require_saved(now)
                yield self._opening(by - 1 if at is None else at + by, by)
            case q.Annotate(index, note):
                yield Found((q.RowSaved(index, r.annotate(queue, queue.rows[index], note)),))
            case _ if at is None:
                raise BatchError("What is open is no row's; press a row in the list to open it.")
            case q.SavePose():
                yield Found(self._decided(now, at, "accepted"))
            case q.Decide(review):
                done = self._decided(now, at, review)
                rows = list(enumerate(queue.rows))[at + 1 :]
                left = [index for index, row in rows if not row.result.review]
                try:
                    yield self._opening(left[0], 1, *done) if review and left else Found(done)
                except PoseViewerError as error:
                    yield Found(done, (str(error),))

    def _decided(self, now: Session, index: int, review: str) -> tuple[q.Request, ...]:
        """Keep a person's verdict; a pose that is changed and accepted is the row's from now on."""
        queue, row, document = self.queue, self.queue.rows[index], now.document
        if review == ACCEPTED and now.unsaved:
            mask = document.scene.mask(document.active, document.at)
            record = pose_record(saved_scene(now), document.active, document.at)
            result = r.save_corrected(queue, row, record, picture_of(document), mask)
            return mark_saved(document), q.RowSaved(index, result)
        _require_saved(now)
        return (q.RowSaved(index, r.decide(queue, row, review)),)

    def _opening(self, index: int, by: int, *done: q.Request) -> Found:
        """Open a row after what is ``done``; raises as ``_open_from``."""
        opened = self._open_from(index, by)
        return Found((*done, open_document(opened.document, is_first=True)), opened.warnings)

    def _open_from(self, index: int, by: int) -> Opened:
        """Open a row, or, where it cannot be opened, the next one in steps ``by``.

        Raises:
            BatchError: there is none.
        """
        rows, skipped = self.queue.rows, list[str]()
        for row in rows[index : None if by else index + 1 : by or 1] if index >= 0 else ():
            try:
                opened = self._open(row)
            except PoseViewerError as error:
                skipped.append(f"Row {row.job.row} cannot be opened: {error}")
            else:
                return replace(opened, warnings=(*skipped[:MOST_SAID], *opened.warnings))
        end = f"This is the {'last' if by > 0 else 'first'} of {len(rows)} rows."
        raise BatchError(" ".join(skipped[:MOST_SAID]) or end)

    def _open(self, row: Row) -> Opened:
        """Photo, model and pose of a row."""
        job, queue = row.job, self.queue
        photo, model = job.path(job.photo), job.path(job.model)
        pose = queue.batch.folder / row.result.pose if row.result.pose else job.path(job.start)
        try:
            opened = open_files(photo, model, pose)
        except PoseViewerError:
            if row.result.pose:
                raise
            # It failed for want of a start, maybe: a person can place the model.
            opened = open_files(photo, model, None)
        # Whether to keep to a start is here for a person to say.
        settings = replace(queue.batch.settings, keep_start=False)
        document = opened.document.with_own(region=settings.region)
        changes = {"settings": replace(settings, region=None), "id": str(job.row)}
        document = document.with_object(**changes)
        draft, notes = queue.batch.folder / r.DRAFTS / f"{job.key}.json", opened.warnings
        if draft.is_file():
            note = f"{draft} has a correction that was not accepted: drop it on the page to go on."
            notes = (*notes, note)
        return replace(opened, document=document, warnings=notes)


def _require_saved(session: Session) -> None:
    """Raise where going on would lose a pose that is not saved."""
    if session.unsaved:
        raise BatchError("The pose is changed: accept it (A), save it (S) or take it back (Z).")
