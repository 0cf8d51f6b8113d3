"""The app: a main loop that owns the session, feeds the workers, and writes the page.

Callbacks only post requests, and workers only publish edits.
"""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import viser

from poseviewer.app.page.page import Page
from poseviewer.app.page.reports import newest_drags
from poseviewer.app.page.texts import pace_text
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state.document import Document, verdict_of
from poseviewer.app.state.edits import (
    AskNumbers,
    AskStill,
    Edit,
    ReviewRow,
    SavePose,
    ShowHelp,
    cancel_drag,
    set_fields,
    update,
)
from poseviewer.app.state.hiding import forget_strokes
from poseviewer.app.state.results import Preparation
from poseviewer.app.state.search_edits import preparation_advanced
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import has_renderer, preparing, proposing, searching
from poseviewer.app.workers.maps import mapping
from poseviewer.app.workers.outlines import outlining
from poseviewer.app.workers.overlay import drawing, picturing, reading, refining
from poseviewer.app.workers.saving import Autosaver
from poseviewer.app.workers.tasks import (
    LongVideo,
    QueuedTask,
    Request,
    Restore,
    TaskProgress,
    TaskQueue,
    TaskResult,
    UnsavedPose,
    restore,
)
from poseviewer.app.workers.tracking import frame_reading, tracking
from poseviewer.app.workers.worker import Mailbox
from poseviewer.errors import PoseViewerError, sentence_of

_log = logging.getLogger(__name__)

ENDS = "Esc stops it"
"""Note below what is being done."""
LOST_SAVED = "Verdict lost: saved all the same."
IDLE_S = 0.25
"""Longest period of the loop: a drawing or an autosave may be due by then."""
SWITCH_INTERVAL_S = 0.001
"""Interval of thread switches, below Python's 5 ms, so that the page stays responsive."""


class App:
    """Main loop, workers and page."""

    def __init__(
        self,
        server: viser.ViserServer,
        document: Document,
        state: Path,
        review: Reviewer | None = None,
        features: Path | None = None,
    ) -> None:
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._mailbox: Mailbox[Request | TaskResult | TaskProgress | Exception] = Mailbox()
        self.session = Session(document, anchor=document.scene, saved=document).with_first_proposals
        self._tasks = TaskQueue(state)
        self._review = review
        self._autosaver = Autosaver(state)
        self._page = Page(server, self._mailbox.post, self.session, review)
        self._drawer, self._searcher, self._mapper = drawing(), searching(), mapping()
        self._proposer = proposing(features)
        makers = refining, picturing, reading, outlining, preparing, frame_reading, tracking
        workers = self._autosaver.job, self._drawer, self._proposer, self._searcher, self._mapper
        workers += () if review is None else (review.job,)
        self._workers = (*workers, *(make() for make in makers))
        for worker in (*self._workers, self._tasks):
            worker.mailbox = self._mailbox
        self._running, self._failed = True, False
        self._page.tell("Note", *document.scene.notes)
        if self._autosaver.offer is not None:
            self._page.offer(self._autosaver.offer)
        self._mailbox.notify()  # the page is shown at once

    def run(self) -> None:
        """Serve until ``stop``."""
        try:
            while self._running:
                self.step()
        finally:
            self._autosaver.close(self.session)
            for worker in (*self._workers, self._tasks):
                worker.close()
            if self._review is not None:
                self._review.close()

    def stop(self) -> None:
        """End the loop; from any thread."""
        self._running = False
        self._mailbox.notify()

    def step(self) -> None:
        """Handle requests, run the workers, and show the session."""
        for request in newest_drags(self._mailbox.take(IDLE_S)):
            with self._report_errors():
                self._handle(request)
        try:
            self._work()
            document, review = self.session.document, self._review
            row = "" if review is None else review.where(document)
            where = row or self._autosaver.where(self.session)
            self._page.show(self.session, self._mailbox.taken, where)
            self._failed = False
        except Exception:  # noqa: BLE001 - the loop must not end
            if not self._failed:
                _log.exception("step")
                self._page.show_error("Something went wrong inside. Undo or save, and go on.")
            self._failed = True

    @contextmanager
    def _report_errors(self) -> Iterator[None]:
        """Show errors on the page, and go on."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - the loop must not end
            if not isinstance(error, PoseViewerError):
                _log.exception("step")
            self._page.show_error(sentence_of(error))

    def _handle(self, request: Request | TaskResult | TaskProgress | Exception) -> None:
        match request:
            case Exception():
                raise request
            case TaskResult():
                self._finish(request)
            case Edit():
                self._edit(request)
                if request.calls(cancel_drag) and self._tasks.drop():
                    self._show_work("")
            case QueuedTask():
                self._tasks.add(request)
                if request.working:
                    self._show_work(request.working, ENDS)
            case TaskProgress(working, pace):
                if self._tasks.busy:
                    self._show_work(working, f"{pace_text(pace)}\n{ENDS}".strip())
            case SavePose(on_taken, then):
                self._save(on_taken)
                if then is not None:
                    self._handle(then)
            case ShowHelp(client):
                self._page.show_help(client)
            case AskStill(client):
                self._page.ask_still(client)
            case AskNumbers(what, client):
                self._page.ask_numbers(what, client)
            case ReviewRow() if self._review is not None:
                self._tasks.add(self._review.make_task(request))
            case Restore(wanted):
                autosave = self._autosaver.take_offer(wanted)
                self._page.close_offer()
                if wanted and autosave is not None:
                    self._tasks.add(restore(autosave))

    def _edit(self, edit: Edit) -> None:
        self.session = update(self.session, edit)

    def _save(self, on_taken: str) -> None:
        if self._review is not None and self._review.row_at(self.session.document) is not None:
            self._tasks.add(self._review.decide("accepted", goes_on=False))
            return
        self._page.close_question()
        existing = self._autosaver.file_to_replace(self.session.document)
        if existing is not None and on_taken == "ask":
            self._page.ask_to_replace(existing)
            return
        if on_taken == "leave":
            return
        path, *wheels = self._autosaver.save(self.session, on_taken == "beside")
        beside = (f"The model's wheels, marked by hand: {file}" for file in wheels)
        verdicts = {verdict_of(item) for item in self.session.document.scene.objects}
        doubt = (LOST_SAVED,) if "lost" in verdicts else ()
        self._page.tell(f"Saved {path.name}", *doubt, str(path), *beside)
        self._edit(set_fields(saved=self.session.document))

    def _work(self) -> None:
        """Let the workers begin the session's requests."""
        ready = has_renderer(self.session.document.mesh)
        if ready is not (self.session.preparation is None):
            self._edit(preparation_advanced(None if ready else Preparation()))
        # By priority: a drag, tasks and proposals, a search, a propagation, maps.
        self._tasks.follow(self.session)
        is_awaited = self._tasks.busy or self._proposer.busy
        self._searcher.hold(is_awaited)
        self._mapper.hold(self._drawer.busy or is_awaited or self.session.is_propagating)
        for worker in self._workers:
            worker.follow(self.session)

    def _finish(self, result: TaskResult) -> None:
        """Take the result of a task."""
        self._show_work("")
        self._edit(forget_strokes())
        for edit in result.edits:
            with self._report_errors():
                self._edit(edit)
        self._page.tell("Note", *result.notes)
        self._page.send(result)
        match result.question:
            case LongVideo():
                self._page.ask_every(result.question, result.client)
            case UnsavedPose():
                self._page.ask_to_open(result.question, result.client)

    def _show_work(self, what: str, note: str = "") -> None:
        """Say that a task is done that takes a moment; "" when it is over."""
        self._page.working(what, note)
        if bool(what) is not self.session.is_at_work:
            self._edit(set_fields(is_at_work=bool(what)))
