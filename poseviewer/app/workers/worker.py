"""The background threads, and the mailbox that the main loop reads. Nothing else knows of threads.

A job works on one request at a time, an iterator, and publishes its newest item by one assignment.
A new request displaces the old one between two items; no thread waits for another.
"""

import logging
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from poseviewer.app.state.session import Session

_log = logging.getLogger(__name__)

LET_GO_S = 0.005
"""After so long, s, a job lets others use the interpreter, which costs it 0.1 ms."""

T = TypeVar("T")
A = TypeVar("A")


class Mailbox(Generic[T]):
    """Requests of the main loop in their order, by a queue that bears a signal's handler."""

    def __init__(self) -> None:
        self._items: SimpleQueue[T | None] = SimpleQueue()

    def post(self, item: T) -> None:
        """Put an item in; from any thread, at once."""
        self._items.put(item)

    def notify(self) -> None:
        """Wake the reader without an item."""
        self._items.put(None)

    def take(self, timeout: float) -> list[T]:
        """Take all items, at once if there are any, else after ``notify`` or ``timeout`` s."""
        items: list[T | None] = []
        with suppress(Empty):
            items.append(self._items.get(timeout=timeout))
            while True:
                items.append(self._items.get_nowait())
        return [item for item in items if item is not None]


class Worker(Generic[A, T]):
    """A background thread for requests of the session; the newest request wins."""

    def __init__(
        self,
        name: str,
        asked: Callable[[Session], A | None],
        make: Callable[[A], Iterator[T]],
        notify: Callable[[], None] | None = None,
        *,
        failed: Callable[[A, Exception], T] | None = None,
        serves: Callable[[A, A, bool], bool] = lambda begun, asked, _: begun is asked,
        period_s: Callable[[Session], float] = lambda _: 0.0,
        low_priority: bool = False,
    ) -> None:
        """``asked`` gives what a session asks for (None: nothing), ``make`` the items that come of
        it (mostly edits), ``failed`` a last one after an error; ``notify`` is called at every item.

        ``serves(begun, asked, busy)``: whether what was begun, under way or done, will do for what
        is asked for; ``period_s``: least time between two that are begun.
        """
        self._asked = asked
        self._make = make
        self._failed = failed
        self._serves = serves
        self._period_s = period_s
        self._notify = notify
        self._thread = ThreadPoolExecutor(1, name, lower_priority if low_priority else None)
        self._change = threading.Condition()
        self._begun: A | None = None
        self._begun_at = -math.inf
        self._running: object = None
        self._item: T | None = None
        self._error: Exception | None = None
        self._held = False
        self._let_go = 0.0

    @property
    def busy(self) -> bool:
        """Whether something that was asked for is under way."""
        return self._running is not None

    def follow(self, session: Session) -> None:
        """Begin what the session asks for by now; stop what it does not ask for any more."""
        asked, begun = self._asked(session), self._begun
        if asked is None:
            self.stop()
        elif begun is not None and self._serves(begun, asked, self.busy):
            return
        elif time.monotonic() >= self._begun_at + self._period_s(session):
            self.begin(asked)

    def begin(self, asked: A) -> None:
        """Work on a request, in the job's thread, instead of what is under way."""
        self._begun_at, run = time.monotonic(), object()
        self._set(asked, run)
        self._thread.submit(self._work, asked, run)

    def stop(self) -> None:
        """Let go of the work after the item it is at; its items are dropped."""
        self._set(None, None)

    def _set(self, begun: A | None, run: object) -> None:
        with self._change:
            self._begun = begun
            self._running = run
            self._item = None
            self._error = None
            self._change.notify_all()

    def hold(self, held: bool) -> None:
        """Pause the work before its next item, or let it go on."""
        if held is not self._held:
            with self._change:
                self._held = held
                self._change.notify_all()

    def require_current(self, asked: A, seconds: float = 0.0) -> None:
        """Raise unless this is still asked for after so long; from any thread."""
        with self._change:
            if self._change.wait_for(lambda: self._begun is not asked, seconds):
                raise RuntimeError("it is not asked for any more")

    def take(self) -> Iterator[T]:
        """Give what is new since the last time; raises the error that the work ended in."""
        with self._change:
            item = self._item
            error = self._error
            self._item = None
            self._error = None
        if item is not None:
            yield item
        if error is not None:
            if self._failed is not None and self._begun is not None:
                yield self._failed(self._begun, error)
            raise error

    def close(self) -> None:
        """End the thread, after the item it is at."""
        self.stop()
        self._thread.shutdown()

    def _work(self, asked: A, run: object) -> None:
        error: Exception | None = None
        self._wait_while_held(run)
        if self._running is not run:
            return
        try:
            for item in self._make(asked):
                if not self._publish(run, item):
                    return
                self._wait_while_held(run)
        except Exception as raised:  # noqa: BLE001 - whatever it is, the user is to be told
            _log.debug("%s", threading.current_thread().name, exc_info=raised)
            error = raised.with_traceback(None)  # its frames hold what was worked on
        self._publish(run, None, error)

    def _wait_while_held(self, run: object) -> None:
        if self._held:
            with self._change:
                self._change.wait_for(lambda: not self._held or self._running is not run)
        elif time.monotonic() > self._let_go + LET_GO_S:
            time.sleep(0.0)  # let go of the interpreter: others may be waiting for it
            self._let_go = time.monotonic()

    def _publish(self, run: object, item: T | None, error: Exception | None = None) -> bool:
        """Publish an item, or (None) the end; False if the work has been displaced."""
        with self._change:
            if self._running is not run:
                return False
            if item is None:
                self._running, self._error = None, error
            else:
                self._item = item
        if self._notify is not None:
            self._notify()
        return True


def lower_priority() -> None:
    """Give this thread a lower priority: on Linux, threads have one of their own."""
    if hasattr(os, "setpriority") and os.uname().sysname == "Linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)
