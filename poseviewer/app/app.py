"""The app: one main loop that owns the session, hands work to the workers, and writes the page.

Callbacks only post requests; workers only publish updates. What is here runs in one thread, and
waits for nobody.
"""

from __future__ import annotations

import logging
import sys
import time
from pathlib import Path

import viser

from poseviewer.app.page.page import Page
from poseviewer.app.page.reports import newest_drags, request_of
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state import commands as c
from poseviewer.app.state import requests as r
from poseviewer.app.state.hiding import Grow
from poseviewer.app.state.session import LandscapeUpdate, Preparation, SearchUpdate, Session
from poseviewer.app.state.update import update
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.jobs import (
    has_renderer,
    prepare,
    propose_starts,
    renderer_of,
    run_search,
)
from poseviewer.app.workers.maps import MapJob, MapMaker
from poseviewer.app.workers.opening import Opened, restore
from poseviewer.app.workers.outlines import OutlineWorker
from poseviewer.app.workers.overlay import OverlayWorkers
from poseviewer.app.workers.tasks import (
    Exported,
    Found,
    Result,
    Tasks,
    find_wheels_in_region,
    grow,
)
from poseviewer.app.workers.worker import JobUpdate, Mailbox, NumberedWorker, Worker
from poseviewer.errors import PoseViewerError, sentence_of
from poseviewer.geometry.camera import Pose

_log = logging.getLogger(__name__)

IDLE_S, BUSY_S = 0.25, 0.03
"""The loop looks for updates of search and maps at least this often."""
SEARCH_MAPS_S = 0.5
"""Seconds between maps that follow a search: the processor is for the search."""
STOPPED_BY = "Esc stops it"
"""Said of tasks."""
INTERPRETER_SHARE_S = 0.001
"""A thread that computes in Python lets others in after so long (Python's own: 5 ms)."""
COMPILING_FAILED = (
    "The model cannot be compared with the photo: its kernels could not be compiled; "
    "restart poseviewer, or install numba again"
)


class App:
    """Everything that runs while the page is served."""

    def __init__(
        self,
        server: viser.ViserServer,
        opened: Opened,
        state: Path,
        review: Reviewer | None = None,
    ) -> None:
        sys.setswitchinterval(INTERPRETER_SHARE_S)
        self._mailbox: Mailbox[r.Request] = Mailbox()
        document = opened.document
        saved = None if opened.restored else document
        self.session = Session(document, anchor=document.scene, saved=saved)
        notify = self._mailbox.notify
        self._overlay = OverlayWorkers(notify)
        self._outlines = OutlineWorker(notify)
        self._searcher: NumberedWorker[SearchUpdate] = NumberedWorker("search")
        self._proposer: NumberedWorker[tuple[Pose, ...]] = NumberedWorker("proposals", notify)
        self._preparer: Worker[Preparation] = Worker("preparation", notify)
        self._mapper: Worker[tuple[LandscapeUpdate, ...]] = Worker("maps", low_priority=True)
        self._map_job: MapJob | None = None
        self._mapped_at = 0.0
        self._tasks = Tasks(notify, state)
        self._review = review
        self._autosaver = Autosaver(state)
        self._page = Page(server, self._mailbox.post, review)
        self._running, self._failed = True, False
        self._use_model()
        self._page.tell_all(opened.warnings)
        notify()  # the page is shown at once

    def run(self) -> None:
        """Serve until ``stop``."""
        try:
            while self._running:
                self.step()
        finally:
            self._autosaver.close(self.session)
            if self._review is not None:
                self._review.close()
            workers = self._searcher, self._mapper, self._proposer, self._preparer
            for worker in (self._overlay, self._outlines, *workers, self._tasks):
                worker.close()

    def stop(self) -> None:
        """End the loop; from any thread."""
        self._running = False
        self._mailbox.notify()

    def step(self) -> None:
        """Take what has come, start what is wanted, show what is new."""
        busy = self._searcher.busy or self._mapper.busy
        busy = busy or self._overlay.is_unfinished(self._is_moving())
        for request in newest_drags(self._mailbox.take(BUSY_S if busy else IDLE_S)):
            try:
                self._handle(request)
            except PoseViewerError as error:
                self._page.show_error(str(error))
            except Exception:  # noqa: BLE001 - the loop must not end
                # Whatever it is, the session goes on, and nothing of the user's is lost.
                _log.exception("request %r", request)
                self._page.show_error("Something went wrong inside; nothing was changed.")
        try:
            self._collect()
            self._start_jobs()
            self._page.show(self.session, self._where())
            self._failed = False
        except Exception:  # noqa: BLE001 - the loop must not end
            if not self._failed:
                _log.exception("step")
                self._page.show_error("Something went wrong inside. Undo or save, and go on.")
            self._failed = True
        trouble = self._autosaver.tick(self.session)
        if trouble:
            self._page.show_error(trouble)

    # --- requests --------------------------------------------------------------------------------

    def _handle(self, request: r.Request) -> None:
        if self._review is not None and self._review.takes(request, self.session):
            draws = isinstance(request, r.Decide | r.SavePose)
            self._tasks.add(self._review.task_for(request), draws)
            return
        match request:
            case c.Command():
                self._command(request)
            case r.Report():
                meant = request_of(request, self.session)
                if meant is not None:
                    self._handle(meant)
            case r.Upload():
                self._tasks.add_upload(request)
                self._page.working(f"Reading {request.name[:60]} ...", STOPPED_BY)
            case r.Unfit():
                self._page.show_error_to(request.client, request.why)
            case r.SavePose():
                self._save()
            case r.Download():
                self._tasks.add_export(request, self.session)
                drawn = "Drawing ..." if request.what in ("overlay", "sheet") else ""
                self._page.working(drawn, STOPPED_BY)
            case r.FindWheels():
                self._tasks.add(find_wheels_in_region, draws=True)
                self._page.working("Looking for wheels ...", STOPPED_BY)
            case Grow():
                self._tasks.add(grow(request))
                self._page.working("Finding its edge ...", STOPPED_BY)
            case r.ShowHelp():
                self._page.show_help(request.client)
            case r.Greet():
                self._page.greet(request.client, self._autosaver.offer())
            case r.Restore():
                kept = self._autosaver.take_offer(request.wanted)
                self._page.close_offer()
                if request.wanted and kept is not None:
                    self._tasks.add(lambda _: restore(kept))
            case _:
                pass  # keys that mean something in a review alone

    def _command(self, command: c.Command) -> None:
        before = self.session
        self.session = update(before, command)
        if self.session.error_message and self.session.error_message is not before.error_message:
            self._page.show_error(self.session.error_message)
        if isinstance(command, c.CancelDrag) and self._tasks.drop():
            self._page.working("")
        if self.session.document.mesh is not before.document.mesh:
            self._use_model()

    def _where(self) -> str:
        """Say where the pose will be saved."""
        row = "" if self._review is None else self._review.where(self.session.document)
        return row or self._autosaver.where(self.session)

    def _save(self) -> None:
        path = self._autosaver.save(self.session)
        self._page.tell(f"Saved {path.name}", str(path))
        self._command(c.Saved(self.session.document))

    # --- workers ---------------------------------------------------------------------------------

    def _collect(self) -> None:
        """Tell the session what the workers have found out since the last time."""
        for command in self._overlay.take(self.session, self._page.show_error):
            self._command(command)
        for command in self._outlines.take():
            self._command(command)
        prepared = self._preparer.take()
        if prepared is not None:
            self._take_preparation(prepared)
        for command in self._searcher.take_as(c.SearchAdvanced, c.SearchFailed):
            self._command(command)
        for command in self._proposer.take_as(c.StartsProposed, c.ProposingFailed):
            self._command(command)
        maps = self._mapper.take()
        if maps is not None and maps.error is not None:
            self._page.maps_note(sentence_of(maps.error))
        elif maps is not None and maps.item is not None:
            self._command(c.LandscapeAdvanced(maps.item))
        ended = self._tasks.collect()
        if ended is not None:
            self._finish(*ended)
        self._tasks.start_next(self.session)

    def _finish(self, result: Result | None, error: Exception | None) -> None:
        """Take what a task has brought."""
        self._page.working("")
        self._page.forget_strokes()
        if error is not None:
            self._page.show_error(sentence_of(error))
        match result:
            case Opened():
                self._open(result)
                self._page.tell_all(result.warnings)
            case Found():
                for request in result.requests:
                    self._handle(request)
                self._page.tell_all(result.warnings)
            case Exported():
                self._page.send(result)

    def _open(self, opened: Opened) -> None:
        self._command(c.Open(opened.document, unsaved=opened.restored))
        if opened.restored:
            self._autosaver.adopt(self.session)

    def _start_jobs(self) -> None:
        """Let the workers begin what the session asks for by now, and stop what it does not."""
        session = self.session
        self._overlay.start(session, self._is_moving())
        self._outlines.start(session, self._is_moving())
        ready = session.preparation is None
        self._searcher.follow(session.search, run_search, ready)
        self._proposer.follow(session.proposals, propose_starts, ready)
        if not ready:
            return
        self._mapper.hold(self._overlay.busy)  # what the hand is moving comes first
        job = MapJob.wanted(session, self._is_moving())
        now, before = time.monotonic(), self._map_job
        follows = session.searching and before is not None and before.moving
        is_due = not follows or now - self._mapped_at > SEARCH_MAPS_S
        if is_due and job.replaces(self._map_job, self._mapper.busy):
            self._map_job, self._mapped_at = job, now
            maker = self._map_maker
            self._mapper.start(lambda: maker.run(job))

    def _is_moving(self) -> bool:
        return self.session.before_drag is not None or self.session.searching

    def _use_model(self) -> None:
        """Every worker draws the model at hand with buffers of its own; until there is a renderer
        of it, the overlay alone.
        """
        mesh = self.session.document.mesh
        self._map_job = None
        if not has_renderer(mesh):
            self._overlay.use(None)
            self._mapper.stop()
            self._command(c.PreparationAdvanced(self.session.preparation or Preparation()))
            self._preparer.start(lambda: prepare(mesh))
            return
        renderer = renderer_of(mesh)
        self._overlay.use(renderer)
        self._map_maker = MapMaker(renderer.clone())
        self._command(c.PreparationAdvanced(None))

    def _take_preparation(self, update: JobUpdate[Preparation]) -> None:
        """Show how far it is; go on with what waits for it."""
        if update.error is not None:
            sentence = f"{COMPILING_FAILED} ({sentence_of(update.error)})."
            self._command(c.PreparationAdvanced(Preparation(trouble=sentence)))
        elif update.finished:
            self._use_model()
        elif update.item is not None:
            self._command(c.PreparationAdvanced(update.item))
