"""Many trials on all processors, each as soon as one is free."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import TypeVar

from poseviewer.errors import EXIT_INTERRUPTED, SettingsError

Task = TypeVar("Task")
Row = TypeVar("Row")


def run_all(work: Callable[[Task], Row], tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    """The rows of all tasks as they are done, in any order; one job runs them here, in order.

    Processes, not threads: between two kernel calls a search spends a fifth of its time in Python.
    They are new ones, not forked, as this one may hold an OpenGL context.

    Raises:
        SettingsError: one of the processes was ended from outside, as for want of memory.
    """
    if jobs == 1 or len(tasks) < 2:
        yield from map(work, tasks)
        return
    pool = ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_end_quietly)
    try:
        for done in as_completed([pool.submit(work, task) for task in tasks]):
            yield done.result()
    except BrokenProcessPool:
        raise SettingsError(
            "a process of the study was ended from outside, perhaps for want of memory; what was "
            "done is kept: run the same again, with fewer --jobs"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _end_quietly() -> None:
    """On Ctrl-C: the study's own process says what there is to say."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(EXIT_INTERRUPTED))
