"""The background threads, and the mailbox that the main loop reads. Nothing else knows of threads.

A worker runs one job at a time, an iterator, and publishes its newest item by one assignment. A new
job displaces the old one between two items; no thread waits for another.
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import Session

_log = logging.getLogger(__name__)

LET_GO_S = 0.005
"""After so long a job lets others use the interpreter. That takes a tenth of a millisecond: after
each evaluation of a search it would be a fifth of its time."""

T = TypeVar("T")
A = TypeVar("A")


@dataclass(frozen=True, slots=True)
class JobUpdate(Generic[T]):
    """The newest item of a job, or why it failed."""

    item: T | None
    error: Exception | None = None
    finished: bool = False


class Mailbox(Generic[T]):
    """Requests of the main loop, in the order in which they came. A signal's handler may
    come in the middle of it: a ``SimpleQueue`` bears that, an ``Event`` would wait for itself.
    """

    def __init__(self) -> None:
        self._items: SimpleQueue[T | None] = SimpleQueue()

    def post(self, item: T) -> None:
        """Put an item in; from any thread, at once."""
        self._items.put(item)

    def notify(self) -> None:
        """Wake the reader without an item."""
        self._items.put(None)

    def take(self, timeout: float) -> list[T]:
        """All items, at once if there are any; else after ``notify``, or ``timeout`` seconds."""
        found: list[T | None] = []
        with suppress(Empty):
            found.append(self._items.get(timeout=timeout))
            while True:
                found.append(self._items.get_nowait())
        return [item for item in found if item is not None]


class Worker(Generic[T]):
    """One background thread for jobs of one kind; the newest job wins."""

    def __init__(
        self, name: str, notify: Callable[[], None] | None = None, low_priority: bool = False
    ) -> None:
        """``notify`` is called at every item; with ``low_priority`` the processor is left to others
        where the system lets it.
        """
        self._notify = notify
        self._thread = ThreadPoolExecutor(1, name, lower_priority if low_priority else None)
        self._change = threading.Condition()
        self._wanted: Callable[[], Iterator[T]] | None = None
        self._latest: JobUpdate[T] | None = None
        self._held = False
        self._let_go = 0.0

    @property
    def busy(self) -> bool:
        """Whether a job runs or waits to."""
        return self._wanted is not None

    def start(self, make: Callable[[], Iterator[T]]) -> None:
        """Run the iterator that ``make`` gives, in the worker's thread, instead of what runs."""
        self._want(make)
        self._thread.submit(self._work, make)

    def stop(self) -> None:
        """Let go of the job after the item it is at; its updates are dropped."""
        self._want(None)

    def _want(self, make: Callable[[], Iterator[T]] | None) -> None:
        with self._change:
            self._wanted, self._latest = make, None
            self._change.notify_all()

    def hold(self, held: bool) -> None:
        """Pause the job between two items, or let it go on."""
        if held is not self._held:
            with self._change:
                self._held = held
                self._change.notify_all()

    def wait_for(self, holds: Callable[[], bool], seconds: float) -> bool:
        """Wait until something holds that a new job or ``stop`` can bring about; False: in vain."""
        with self._change:
            return self._change.wait_for(holds, seconds)

    def take(self) -> JobUpdate[T] | None:
        """The newest item, once; None if there is none since the last time."""
        with self._change:
            latest, self._latest = self._latest, None
            return latest

    def close(self) -> None:
        """End the thread, after the item it is at."""
        self.stop()
        self._thread.shutdown()

    def _work(self, make: Callable[[], Iterator[T]]) -> None:
        item: T | None = None
        error: Exception | None = None
        if self._wanted is not make:
            return
        try:
            for item in make():
                if not self._publish(make, JobUpdate(item)):
                    return
                self._wait_while_held(make)
        except Exception as raised:  # noqa: BLE001 - whatever it is, the user is to be told
            _log.debug("%s", threading.current_thread().name, exc_info=raised)
            error = raised.with_traceback(None)  # its frames hold what was worked on
        self._publish(make, JobUpdate(item, error, finished=True))

    def _wait_while_held(self, make: Callable[[], Iterator[T]]) -> None:
        if self._held:
            with self._change:
                self._change.wait_for(lambda: not self._held or self._wanted is not make)
        elif time.monotonic() > self._let_go + LET_GO_S:
            time.sleep(0.0)  # let go of the interpreter: others may be waiting for it
            self._let_go = time.monotonic()

    def _publish(self, make: Callable[[], Iterator[T]], latest: JobUpdate[T]) -> bool:
        """False if the job has been displaced."""
        with self._change:
            if self._wanted is not make:
                return False
            self._latest = latest
            if latest.finished:
                self._wanted = None
        if self._notify is not None:
            self._notify()
        return True


class Job(Generic[A]):
    """A worker for what the session asks for: the newest request wins, and publishes edits."""

    def __init__(
        self,
        name: str,
        asked: Callable[[Session], A | None],
        make: Callable[[A], Iterator[Edit]],
        notify: Callable[[], None] | None = None,
        *,
        failed: Callable[[A, Exception], Edit] | None = None,
        serves: Callable[[A, A, bool], bool] = lambda begun, asked, _: begun is asked,
        period_s: Callable[[Session], float] = lambda _: 0.0,
        low_priority: bool = False,
    ) -> None:
        """``asked`` gives what a session asks for (None: nothing), ``make`` the edits that come of
        it, and ``failed`` an edit for where it ends in an error.

        ``serves(begun, asked, busy)``: whether what was begun, and is under way or done, will do
        for what is asked for; ``period_s``: least time between two that are begun.
        """
        self._worker: Worker[Edit] = Worker(name, notify, low_priority)
        self._asked, self._make, self._failed = asked, make, failed
        self._serves, self._period_s = serves, period_s
        self._begun: A | None = None
        self._begun_at = -math.inf
        self.hold = self._worker.hold

    @property
    def busy(self) -> bool:
        """Whether something that was asked for is under way."""
        return self._worker.busy

    def follow(self, session: Session) -> None:
        """Begin what the session asks for by now; stop what it does not ask for any more."""
        asked, begun, now = self._asked(session), self._begun, time.monotonic()
        if asked is None:
            self._begun = None
            self._worker.stop()
        elif begun is not None and self._serves(begun, asked, self.busy):
            return
        elif now >= self._begun_at + self._period_s(session):
            self._begun, self._begun_at = asked, now
            self._worker.start(lambda: self._make(asked))

    def require_asked(self, asked: A, seconds: float = 0.0) -> None:
        """Raise unless this is still asked for after so long; from any thread."""
        if self._worker.wait_for(lambda: self._begun is not asked, seconds):
            raise RuntimeError("it is not asked for any more")

    def take(self) -> Iterator[Edit]:
        """Give what is new since the last time; raises the error that the work ended in."""
        update = self._worker.take()
        if update is None:
            return
        if update.item is not None:
            yield update.item
        if update.error is not None:
            if self._failed is not None and self._begun is not None:
                yield self._failed(self._begun, update.error)
            raise update.error

    def close(self) -> None:
        """End the thread, after the item it is at."""
        self._begun = None
        self._worker.close()


def lower_priority() -> None:
    """Give this thread a lower priority: on Linux, threads have one of their own."""
    if hasattr(os, "setpriority") and os.uname().sysname == "Linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)
