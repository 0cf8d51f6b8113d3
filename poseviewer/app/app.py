"""The app: one main loop that owns the session, hands work to the workers, and writes the page.

Callbacks only post requests; workers only publish news. What is here runs in one thread, and waits
for nobody.
"""

from __future__ import annotations

import logging
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import viser

from poseviewer.app.page.page import Page
from poseviewer.app.page.reports import command_of, newest_drags
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state import commands as c
from poseviewer.app.state.document import History
from poseviewer.app.state.requests import (
    Annotate,
    Download,
    FindWheels,
    Greet,
    Report,
    Request,
    Restore,
    Review,
    SavePose,
    ShowHelp,
    Unfit,
    Upload,
    UseLastPose,
)
from poseviewer.app.state.session import (
    LandscapeUpdate,
    Overlay,
    OverlayRequest,
    SearchUpdate,
    Session,
)
from poseviewer.app.state.update import update
from poseviewer.app.workers import exporting
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.identifying import Identifier
from poseviewer.app.workers.jobs import OverlayDrawer
from poseviewer.app.workers.mapping import MapJob, Mapper
from poseviewer.app.workers.opening import Opened
from poseviewer.app.workers.proposing import Proposer
from poseviewer.app.workers.renderers import Renderers
from poseviewer.app.workers.tasks import Done, Exported, Found, Reviewed, Tasks
from poseviewer.app.workers.worker import Mailbox, Worker
from poseviewer.errors import PoseViewerError
from poseviewer.files.state.last_pose import keep_last_pose
from poseviewer.geometry.camera import Pose

_log = logging.getLogger(__name__)

IDLE_S, BUSY_S = 0.25, 0.03
"""The loop looks for news of search and maps at least this often."""
SEARCH_PAINT_S = 0.1
"""A search is drawn no oftener: the processor is for the search."""
SETTLED_S = 0.15
"""After so long without motion the fine drawing is begun."""
INTERPRETER_SHARE_S = 0.001
"""A thread that computes in Python lets others in after so long (Python's own: 5 ms)."""


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
        self._mailbox: Mailbox[Request] = Mailbox()
        saved = None if opened.restored else opened.document.pose
        anchor, candidates = opened.document.pose, opened.candidates
        self.session = Session(opened.document, anchor=anchor, saved=saved, candidates=candidates)
        self._renderer = opened.renderer
        self._renderers = Renderers()
        self._renderers.keep(opened.renderer)
        self._painter: Worker[Overlay] = Worker("painter", self._mailbox.notify)
        self._weigher: Worker[Overlay] = Worker("weigher", self._mailbox.notify)
        self._finisher: Worker[Overlay] = Worker("finisher", self._mailbox.notify)
        self._searcher: Worker[SearchUpdate] = Worker("searcher")
        self._mapper: Worker[LandscapeUpdate] = Worker("mapper", low_priority=True)
        self._proposer = Proposer(self._mailbox.notify)
        self._identifier = Identifier(self._mailbox.notify, self._renderers.of)
        self._tasks = Tasks(self._mailbox.notify, state)
        self._state = state
        self._review = review
        self._autosaver = review or Autosaver(state)
        self._page = Page(server, self._mailbox.post, review is not None)
        self._running = True
        self._renew_brushes()
        self._painted: OverlayRequest | None = None
        self._moved_at = 0.0
        self._search_tickets: dict[int, int] = {}
        self._mapped: MapJob | None = None
        self._page.tell_all(opened.warnings)

    def run(self) -> None:
        """Serve until ``stop``."""
        try:
            while self._running:
                self.step()
        finally:
            self._autosaver.close(self.session)
            workers = self._painter, self._weigher, self._finisher, self._searcher, self._mapper
            for worker in (*workers, self._proposer, self._identifier, self._tasks):
                worker.close()

    def stop(self) -> None:
        """End the loop; from any thread."""
        self._running = False
        self._mailbox.notify()

    def step(self) -> None:
        """Take what has come, start what is wanted, show what is new."""
        busy = self._searcher.busy or self._mapper.busy or self._unfinished()
        for request in newest_drags(self._mailbox.take(BUSY_S if busy else IDLE_S)):
            try:
                self._handle(request)
            except PoseViewerError as error:
                self._page.show_error(str(error))
            except Exception:  # noqa: BLE001 - the loop must not end
                # Whatever it is, the session goes on, and nothing of the user's is lost.
                _log.exception("request %r", request)
                self._page.show_error("Something went wrong inside; nothing was changed.")
        self._collect()
        self._start_jobs()
        state = self._review.state(self.session) if self._review is not None else None
        self._page.show(self.session, self._autosaver.where(self.session), state)
        self._autosaver.tick(self.session)

    # --- requests --------------------------------------------------------------------------------

    def _handle(self, request: Request) -> None:
        if self._review is not None and self._review.takes(request):
            self._review_row(self._review, request)
            return
        match request:
            case Report():
                meant = command_of(request, self.session)
                if meant is not None:
                    self._handle(meant)
            case Upload():
                self._tasks.add_upload(request)
                self._page.working(f"Reading {request.name[:60]} ...")
            case Unfit():
                self._page.show_error_to(request.client, request.why)
            case SavePose():
                self._save()
            case UseLastPose():
                self._tasks.add_last_pose()
            case Review() | Annotate():
                pass  # keys that mean something in a review alone
            case Download():
                self._export(request)
            case FindWheels():
                self._tasks.add_wheels()
                self._page.working("Looking for wheels ...")
            case ShowHelp():
                self._page.show_help(request.client)
            case Greet():
                self._page.greet(request.client, self._autosaver.offer())
            case Restore():
                kept = self._autosaver.take_offer(request.wanted)
                self._page.close_offer()
                if request.wanted and kept is not None:
                    self._tasks.add_restore(kept)
            case c.Command():
                self._command(request)

    def _command(self, command: c.Command) -> None:
        before = self.session
        self.session = update(before, command)
        if self.session.error_message and self.session.error_message is not before.error_message:
            self._page.show_error(self.session.error_message)
        if isinstance(command, c.AcceptSearch):
            self._autosaver.save_now(self.session)
        mesh = self.session.document.registration.mesh
        if mesh is not before.document.registration.mesh:
            self._renderer = self._renderers.of(mesh)
            self._renew_brushes()

    def _review_row(self, review: Reviewer, request: Request) -> None:
        record = exporting.record_of(self.session, self._renderer)
        self._tasks.add(review.task_for(request, self.session, self._renderer, record))

    def _save(self) -> None:
        document, record = self.session.document, exporting.record_of(self.session, self._renderer)
        assert isinstance(self._autosaver, Autosaver)  # in a review, saving is accepting
        path = self._autosaver.save_pose(self.session, record)
        keep_last_pose(record, self._state)
        self._command(c.Saved(document.pose))
        self._page.tell(f"Saved {path.name}", str(path))

    def _export(self, request: Download) -> None:
        session, renderer = self.session, self._renderer.clone()
        self._tasks.add_export(request, lambda: exporting.export(request.what, session, renderer))
        self._page.working("Drawing ..." if request.what in ("overlay", "sheet") else "")

    # --- workers ---------------------------------------------------------------------------------

    def _collect(self) -> None:
        for worker in (self._painter, self._finisher):
            latest = worker.take()
            if latest is None:
                continue
            if latest.error is not None:
                self._page.show_error(f"The model could not be drawn: {latest.error}")
            elif latest.item is not None and self._is_current(latest.item):
                self._command(c.OverlayDrawn(latest.item))
        latest = self._weigher.take()
        if latest is not None and latest.item is not None and self._is_current(latest.item):
            self._command(c.LossComputed(latest.item))
        self._collect_search()
        for latest in (self._proposer.take(), self._identifier.take()):
            if latest is not None:
                self._command(latest)
        latest = self._mapper.take()
        if latest is not None and latest.error is not None:
            self._page.maps_note(str(latest.error))
        elif latest is not None and latest.item is not None:
            self._command(c.LandscapeAdvanced(latest.item))
        for done in self._tasks.collect():
            self._finish(done)
        self._tasks.start_next(self.session, self._renderer)

    def _collect_search(self) -> None:
        latest = self._searcher.take()
        if latest is None:
            return
        number = self._search_tickets.get(latest.ticket, 0)
        if latest.item is not None:
            self._command(c.SearchAdvanced(number, latest.item))
        if latest.error is not None:
            self._command(c.SearchFailed(number, str(latest.error)))
        if latest.finished:
            self._autosaver.save_now(self.session)

    def _finish(self, done: Done) -> None:
        self._page.working("")
        if done.error is not None:
            self._page.show_error(str(done.error))
            if self._review is not None:
                self._review.gave_up()
        if isinstance(done.result, Reviewed) and self._review is not None:
            if done.result.pose is not None:
                self._command(c.Saved(done.result.pose))
            self._tasks.add(self._review.finish(done.result, self.session))
        if isinstance(done.result, Opened):
            opened = done.result
            if opened.row:
                self._autosaver.save_now(self.session)  # what was dragged while it was being read
            if opened.pose_alone:
                self._command(c.SetPose(opened.document.pose, as_start=True))
            else:
                self._renderers.keep(opened.renderer)
                self._command(c.Open(opened.document, unsaved=opened.restored))
            if opened.row and self._review is not None:
                self._review.opened(opened)
                self.session = replace(self.session, history=History())  # undo stays in the row
            elif opened.restored:
                self._autosaver.adopt(self.session)
            self._page.tell_all(opened.warnings)
        elif isinstance(done.result, Found):
            for command in done.result.commands:
                self._command(command)
            self._page.tell_all(done.result.warnings)
        elif isinstance(done.result, Exported):
            self._page.send(done.result)

    def _start_jobs(self) -> None:
        self._start_painting()
        self._mapper.hold(self._painter.busy)  # what the hand is moving comes first
        self._start_search()
        self._proposer.start(self.session, self._renderer)
        self._identifier.start(self.session)
        job = MapJob.wanted(self.session, self._in_motion())
        if job is not None and job.replaces(self._mapped, self._mapper.busy):
            self._mapped = job
            mapper = self._map_maker
            self._mapper.start(lambda: mapper.run(job))

    def _start_painting(self) -> None:
        session = self.session
        document = session.document
        request = OverlayRequest(
            document.registration,
            document.settings,
            session.shown_pose,
            session.anchor or document.pose,
            session.look.name,
            session.look.opacity,
        )
        if self._painted is None or not _same_picture(request, self._painted):
            if not self._weighed and self._painted is not None and self._may_weigh():
                self._weigh(self._painted)
            # One at a time: a drawing that is displaced before it is shown helps nobody.
            if self._painter.busy:
                return
            if session.searching and time.monotonic() - self._moved_at < SEARCH_PAINT_S:
                return
            self._painted, self._moved_at = request, time.monotonic()
            quick = self._quick
            self._finisher.stop()
            self._painter.start(lambda: islice(quick.paint(replace(request, moving=True)), 1))
            self._weighed = False
            return
        if not self._weighed and self._may_weigh():
            self._weigh(request)
        if self._unfinished() and time.monotonic() - self._moved_at > SETTLED_S:
            self._moved_at = 0.0
            fine = self._fine
            self._finisher.start(lambda: _last(fine.paint(request)))

    def _may_weigh(self) -> bool:
        return not self._weigher.busy and not self.session.searching  # which weighs by itself

    def _weigh(self, request: OverlayRequest) -> None:
        """Find the loss of what is drawn, apart from the drawing: it takes longer."""
        self._weighed = True
        scales = self._scales
        self._weigher.start(lambda: _last(scales.paint(replace(request, moving=True))))

    def _start_search(self) -> None:
        search = self.session.search
        if search is None or not search.running:
            if self._searcher.busy:
                self._searcher.stop()
            return
        if search.number in self._search_tickets.values():
            return
        document = search.before
        runner = self._search_maker
        ticket = self._searcher.start(
            lambda: runner(document.registration, document.pose, document.settings)
        )
        self._search_tickets = {ticket: search.number}

    def _unfinished(self) -> bool:
        """Whether the fine drawing of what is shown is still to be begun."""
        return self._moved_at > 0.0 and not self._in_motion() and not self._painter.busy

    def _in_motion(self) -> bool:
        return self.session.before_drag is not None or self.session.searching

    def _is_current(self, overlay: Overlay) -> bool:
        registration = self.session.document.registration
        return overlay.request.registration is registration or (
            overlay.request.registration.photo is registration.photo
            and overlay.request.registration.mesh is registration.mesh
        )

    def _renew_brushes(self) -> None:
        """Every worker draws with buffers of its own."""
        from poseviewer.app.workers.jobs import search

        self._quick = OverlayDrawer(self._renderer.clone())
        self._fine = OverlayDrawer(self._renderer.clone())
        self._scales = OverlayDrawer(self._renderer.clone())
        self._map_maker = Mapper(self._renderer.clone())
        searching = self._renderer.clone()

        def run(registration: Any, pose: Pose, settings: Any) -> Iterator[SearchUpdate]:
            return search(registration, pose, settings, searching)

        self._search_maker: Callable[..., Iterator[SearchUpdate]] = run
        self._painted = None
        self._weighed = True
        self._mapped = None


def _same_picture(one: OverlayRequest, other: OverlayRequest) -> bool:
    return (
        one.pose is other.pose
        and one.anchor is other.anchor
        and one.registration.photo is other.registration.photo
        and one.registration.mesh is other.registration.mesh
        and (one.look, one.opacity, one.settings) == (other.look, other.opacity, other.settings)
    )


def _last(paintings: Iterator[Overlay]) -> Iterator[Overlay]:
    """Only the last one: the quick ones are on the page already."""
    yield from deque(paintings, maxlen=1)
