"""Background threads, and the mailbox that the main loop reads; no other module knows threads.

A worker makes items from one request at a time, and publishes the newest in the mailbox. A new
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
from itertools import chain
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from poseviewer.app.state.session import Session

_log = logging.getLogger(__name__)

WAKE_S = 0.03
"""Least time between two items of a worker that wake the main loop; the end always does."""
LET_GO_S = 0.005
"""Period in which a job lets other threads use the interpreter, which costs it 0.1 ms."""

T = TypeVar("T")
A = TypeVar("A")


class Mailbox(Generic[T]):
    """Requests to the main loop, in order, and the newest items of each other source."""

    def __init__(self) -> None:
        self._items: SimpleQueue[T | None] = SimpleQueue()
        self._newest: dict[object, tuple[T, ...]] = {}
        self._change, self._posted = threading.Lock(), 0
        self.taken = 0
        """Number of the last request that was taken."""

    def post(self, item: T) -> int:
        """Add a request, from any thread, without waiting; gives its number."""
        with self._change:
            self._items.put(item)
            self._posted += 1
            return self._posted

    def publish(self, source: object, *items: T, adds: bool = False) -> None:
        """Put items in place of those of a source that still wait, or (``adds``) behind them."""
        with self._change:
            self._newest[source] = (*self._newest.get(source, ()), *items) if adds else items

    def has_news(self, source: object) -> bool:
        """Whether items of a source wait to be taken."""
        return bool(self._newest.get(source))

    def notify(self) -> None:
        """Wake the reader, from any thread or signal handler."""
        self._items.put(None)

    def take(self, timeout: float) -> list[T]:
        """Take all requests and then items, or wait for a request or ``notify``, ``timeout`` s."""
        requests: list[T | None] = []
        with suppress(Empty):
            requests.append(self._items.get(timeout=timeout))
            while True:
                requests.append(self._items.get_nowait())
        taken = [item for item in requests if item is not None]
        self.taken += len(taken)
        with self._change:
            newest, self._newest = self._newest, {}
        return [*taken, *chain.from_iterable(newest.values())]


class Worker(Generic[A, T]):
    """A background thread for requests of the session; the newest request wins."""

    def __init__(
        self,
        name: str,
        request_of: Callable[[Session], A | None],
        make: Callable[[A], Iterator[T]],
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
            failed: makes a last item after an error, before the error itself.
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
        self._thread = ThreadPoolExecutor(1, name, lower_priority if low_priority else None)
        self._change = threading.Condition()
        self._begun: A | None = None
        self._begun_at = -math.inf
        self._running: object = None
        self._held = False
        self._let_go = self._woken = 0.0
        self.mailbox: Mailbox[Any] = Mailbox()
        """Mailbox that items and errors are published in; its own until it gets another one."""

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
            self.mailbox.publish(self)
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

    def close(self) -> None:
        """End the thread after the current item."""
        self.stop()
        self._thread.shutdown()

    def _work(self, request: A, run: object) -> None:
        last: tuple[T | Exception, ...] = ()
        self._wait_while_held(run)
        if self._running is not run:
            return
        try:
            for item in self._make(request):
                if not self._publish(run, item):
                    return
                self._wait_while_held(run)
        except Exception as error:  # noqa: BLE001 - the user is told of any
            _log.debug("%s", threading.current_thread().name, exc_info=error)
            last = () if self._failed is None else (self._failed(request, error),)
            last += (error.with_traceback(None),)  # its frames keep the request in memory
        self._publish(run, *last, is_over=True)

    def _wait_while_held(self, run: object) -> None:
        if self._held:
            with self._change:
                self._change.wait_for(lambda: not self._held or self._running is not run)
        elif time.monotonic() > self._let_go + LET_GO_S:
            time.sleep(0.0)  # other threads may be waiting for the interpreter
            self._let_go = time.monotonic()

    def _publish(self, run: object, *items: T | Exception, is_over: bool = False) -> bool:
        """Publish an item, or how the work ended; False: another request has displaced this one."""
        now = time.monotonic()
        with self._change:
            if self._running is not run:
                return False
            self.mailbox.publish(self, *items, adds=is_over)
            self._running = None if is_over else run
        if is_over or now > self._woken + WAKE_S:
            self._woken = now
            self.mailbox.notify()
        return True


def lower_priority() -> None:
    """Lower the priority of this thread, on Linux, where threads have their own."""
    if hasattr(os, "setpriority") and os.uname().sysname == "Linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)
