"""Review of a batch in the app: each row is opened as a document, and tasks do the work."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import Edit, ReviewRow, open_document, set_fields
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import picture_of, scene_to_save
from poseviewer.app.workers.opening import open_sources, with_notes
from poseviewer.app.workers.tasks import QueuedTask, TaskResult
from poseviewer.app.workers.worker import Worker
from poseviewer.batch import review as r
from poseviewer.batch.result_folder import ACCEPTED, Row
from poseviewer.batch.run import save_summaries
from poseviewer.errors import BatchError, PoseViewerError
from poseviewer.files.pose import load_pose
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.opening.sources import Sources
from poseviewer.render.renderers import RendererName

MAX_NAMED = 3
"""Number of rows that are named if they cannot be opened."""


class Reviewer:
    """Queue of rows, and tasks that open and judge them."""

    def __init__(self, folder: Path, renderer: RendererName | None = None) -> None:
        """Load a batch's folder; default renderer: the batch's."""
        loaded = self.queue = r.load_queue(folder)
        batch = self.queue.batch.settings
        self.settings = replace(batch, keep_start=False, renderer=renderer or batch.renderer)
        """Settings of each row; the person decides whether the start stays."""
        self.job: Worker[r.ReviewQueue, Edit] = Worker(
            "review report", lambda _: None if self.queue is loaded else self.queue, _report
        )
        """Writes table and report after each decision or note."""

    def row_at(self, document: Document) -> int | None:
        """Index of the row of a document's photo and model; None: they are no row's."""
        files = [path and path.resolve() for path in (document.view.path, document.model.path)]
        for index, row in enumerate(self.queue.rows):
            job = row.job
            if document.object_id == job.row:
                paths = job.path(job.photo), job.path(job.model)
                return index if files == [path.resolve() for path in paths] else None
        return None

    def where(self, document: Document) -> str:
        """Name of the row's pose file; "": the document is no row's."""
        row = self.row_at(document)
        return "" if row is None else self.queue.rows[row].result.pose or "a new file in poses/"

    def open_first(self) -> Document:
        """Open the first row that can be opened.

        Raises:
            BatchError: there is none.
        """
        return self._open_from(0, 1)

    def close(self) -> None:
        """End cleanly: write table and report."""
        self.job.close()
        save_summaries(self.queue.batch)

    def make_task(self, request: ReviewRow) -> QueuedTask:
        """Make the task of a request."""
        match request.what:
            case int(index):
                return self.open_row(index)
            case "next" | "previous" as side:
                return self.step(1 if side == "next" else -1)
            case decision:
                return self.decide(decision)

    def open_row(self, index: int) -> QueuedTask:
        """Open a row of the batch."""
        return _task(lambda session: self._leave_for(session, index, 0))

    def step(self, by: int) -> QueuedTask:
        """Open the next row, or with -1 the one before."""

        def run(session: Session) -> TaskResult:
            row = self.row_at(session.document)
            return self._leave_for(session, by - 1 if row is None else row + by, by)

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
        """Keep a decision on the open row ("": none) and a corrected pose, and open the next."""

        def run(session: Session) -> TaskResult:
            document, edits = session.document, tuple[Edit, ...]()
            row = self.row_at(document)
            if row is None:
                raise BatchError("What is open is no row's; press a row in the list to open it.")
            if review == ACCEPTED and session.is_unsaved:
                active, view_index = document.active, document.view_index
                scene = scene_to_save(session)
                masks = (of(active, view_index) for of in (scene.mask, scene.occluders))
                record = pose_json(as_saved(scene), active, view_index)
                picture = picture_of(document)
                self.queue = r.save_corrected(self.queue, row, record, picture, *masks)
                edits = (set_fields(saved=document),)
            else:
                _require_saved(session)
                self.queue = r.decide(self.queue, row, review)
            rows = enumerate(self.queue.rows)
            left = [index for index, item in rows if index > row and not item.result.review]
            if not (goes_on and review and left):
                return TaskResult(edits)
            try:
                return self._open_next(left[0], 1, *edits)
            except PoseViewerError as error:
                return TaskResult(edits, (str(error),))

        return _task(run, draws=True)

    def _leave_for(self, session: Session, index: int, by: int) -> TaskResult:
        _require_saved(session)
        return self._open_next(index, by)

    def _open_next(self, index: int, by: int, *edits: Edit) -> TaskResult:
        document = self._open_from(index, by)
        return TaskResult((*edits, open_document(document, is_first=True)), document.scene.notes)

    def _open_from(self, index: int, by: int) -> Document:
        """Open a row or, if that fails, the next one in steps ``by``."""
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
        job, queue = row.job, self.queue
        sources = Sources(job.path(job.photo), model=job.path(job.model))
        pose = queue.batch.folder / row.result.pose if row.result.pose else job.path(job.start)
        try:
            document = open_sources(replace(sources, start=pose))
        except PoseViewerError:
            if row.result.pose:
                raise
            # If only the start fails, a person can place the model.
            document = open_sources(sources)
        settings = self.settings
        if queue.batch.is_audit:  # "reset to start" shows the given pose
            given = load_pose(job.path(job.start)).pose
            document = document.with_object(start=document.view.world_from_model(given))
        document = document.with_in_view(region=settings.region)
        return document.with_object(settings=replace(settings, region=None), id=str(job.row))


def _task(run: Callable[[Session], TaskResult], draws: bool = False) -> QueuedTask:
    return QueuedTask(lambda now, *_: run(now), draws=draws)


def _report(queue: r.ReviewQueue) -> Iterator[Edit]:
    save_summaries(queue.batch)
    yield from ()


def _require_saved(session: Session) -> None:
    """Refuse to lose an unsaved pose."""
    if session.is_unsaved:
        raise BatchError("The pose is changed: accept it (A), save it (S) or take it back (Z).")
