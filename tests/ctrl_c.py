"""Processes that Ctrl-C ends, wherever the tests were started from."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ctrl_c_ends_them() -> Iterator[None]:
    """Let processes that are started inside heed SIGINT, which a shell's background jobs ignore. In
    the main thread only.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
