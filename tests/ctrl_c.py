"""Processes that Ctrl-C ends, wherever the tests were started from."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ctrl_c_ends_them() -> Iterator[None]:
    """What is started in here heeds SIGINT: a shell's background jobs ignore it, and so would
    whatever the tests start there. In the main thread only.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
