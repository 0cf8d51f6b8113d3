"""Processes that Ctrl-C ends, wherever the tests were started from."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ctrl_c_ends_them() -> Iterator[None]:
    """Let processes that are started inside heed SIGINT, which background jobs ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
