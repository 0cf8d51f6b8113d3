"""Background threads, and the mailbox that the main loop reads; no other module knows threads.

A worker makes items from one request at a time, and publishes the newest by one assignment. A new
request displaces the old one between two items; no thread waits for another.
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
"""Period in which a job lets other threads use the interpreter, which costs it 0.1 ms."""

T = TypeVar("T")
A = TypeVar("A")


class Mailbox(Generic[T]):
    """Queue of requests to the main loop; ``notify`` is safe also in signal handlers."""

    def __init__(self) -> None:
        self._items: SimpleQueue[T | None] = SimpleQueue()
        self._posting, self._posted = threading.Lock(), 0
        self.taken = 0
        """Number of the last item that was taken."""

    def post(self, item: T) -> int:
        """Add an item, from any thread, without waiting; gives its number."""
        with self._posting:
            self._items.put(item)
            self._posted += 1
            return self._posted

    def notify(self) -> None:
        """Wake the reader without an item."""
        self._items.put(None)

    def take(self, timeout: float) -> list[T]:
        """Take all items, or wait for one, for ``notify`` or for ``timeout`` s."""
        items: list[T | None] = []
        with suppress(Empty):
            items.append(self._items.get(timeout=timeout))
            while True:
                items.append(self._items.get_nowait())
        taken = [item for item in items if item is not None]
        self.taken += len(taken)
        return taken


class Worker(Generic[A, T]):
    """A background thread for requests of the session; the newest request wins."""

    def __init__(
        self,
        name: str,
        request_of: Callable[[Session], A | None],
        make: Callable[[A], Iterator[T]],
        notify: Callable[[], None] | None = None,
        *,
        failed: Callable[[A, Exception], T] | None = None,
        serves: Callable[[A, A, bool], bool] = lambda begun, request, _: begun is request,
        period_s: Callable[[Session], float] = lambda _: 0.0,
        low_priority: bool = False,
    ) -> None:
        """Start a thread.

        Args:
            name: of the thread.
            request_of: gives the request of a session; None: there is none.
            make: makes items, mostly edits, from a request.
            notify: is called after every item.
            failed: makes a last item after an error.
            serves: ``serves(begun, request, busy)`` tells whether a request that was begun, and is
                under way (``busy``) or done, also answers another one.
            period_s: gives the least time between the starts of two requests.
            low_priority: whether other threads go first.
        """
        self._request_of = request_of
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
        """Whether a request is under way."""
        return self._running is not None

    def follow(self, session: Session) -> None:
        """Begin the request of a session, unless the last one serves it; stop if there is none."""
        request, begun = self._request_of(session), self._begun
        if request is None:
            self.stop()
        elif begun is not None and self._serves(begun, request, self.busy):
            return
        elif time.monotonic() >= self._begun_at + self._period_s(session):
            self.begin(request)

    def begin(self, request: A) -> None:
        """Work on a request instead of the one under way."""
        self._begun_at, run = time.monotonic(), object()
        self._set(request, run)
        self._thread.submit(self._work, request, run)

    def stop(self) -> None:
        """Stop after the current item, and drop all items."""
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

    def require_current(self, request: A, seconds: float = 0.0) -> None:
        """Wait, from any thread, and check that a request is still the current one.

        Raises:
            RuntimeError: it is not.
        """
        with self._change:
            if self._change.wait_for(lambda: self._begun is not request, seconds):
                raise RuntimeError("it is not asked for any more")

    def take(self) -> Iterator[T]:
        """Yield the newest item since the last call.

        Raises:
            Exception: the work ended in it.
        """
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
        """End the thread after the current item."""
        self.stop()
        self._thread.shutdown()

    def _work(self, request: A, run: object) -> None:
        error: Exception | None = None
        self._wait_while_held(run)
        if self._running is not run:
            return
        try:
            for item in self._make(request):
                if not self._publish(run, item):
                    return
                self._wait_while_held(run)
        except Exception as raised:  # noqa: BLE001 - the user is told of any
            _log.debug("%s", threading.current_thread().name, exc_info=raised)
            error = raised.with_traceback(None)  # its frames keep the request in memory
        self._publish(run, None, error)

    def _wait_while_held(self, run: object) -> None:
        if self._held:
            with self._change:
                self._change.wait_for(lambda: not self._held or self._running is not run)
        elif time.monotonic() > self._let_go + LET_GO_S:
            time.sleep(0.0)  # other threads may be waiting for the interpreter
            self._let_go = time.monotonic()

    def _publish(self, run: object, item: T | None, error: Exception | None = None) -> bool:
        """Publish an item or, with None, the end; False: another request has displaced this one."""
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
    """Lower the priority of this thread, on Linux, where threads have their own."""
    if hasattr(os, "setpriority") and os.uname().sysname == "Linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)
