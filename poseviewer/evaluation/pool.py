"""Many trials on all processors, each as soon as one is free."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, parent_process
from typing import Any, Protocol

from poseviewer.errors import EXIT_INTERRUPTED, SettingsError


class Runnable(Protocol):
    """A task that another process can run."""

    def run(self) -> Any:
        """Its row."""
        ...


def run_all(tasks: Sequence[Runnable], jobs: int) -> Iterator[Any]:
    """The rows of all tasks as they are done, in any order; one job runs them here, in order.

    Processes, not threads: between two kernel calls a search spends a fifth of its time in Python.
    They are new ones, not forked, as this one may hold an OpenGL context.

    Raises:
        SettingsError: one of the processes was ended from outside, as for want of memory.
    """
    if jobs == 1 or len(tasks) < 2:
        yield from (task.run() for task in tasks)
        return
    pool = ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_end_with_the_study)
    try:
        for done in as_completed([pool.submit(task.run) for task in tasks]):
            yield done.result()
    except BrokenProcessPool:
        raise SettingsError(
            "a process of the study was ended from outside, perhaps for want of memory; what was "
            "done is kept: run the same again, with fewer --jobs"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _end_with_the_study() -> None:
    """End silently on Ctrl-C, which the study's own process reports; and when that process has
    ended, for which a process of a pool would wait for ever.
    """
    signal.signal(signal.SIGINT, lambda *_: os._exit(EXIT_INTERRUPTED))
    threading.Thread(target=_wait_for_the_end, daemon=True).start()


def _wait_for_the_end() -> None:
    study = parent_process()
    if study is not None:
        study.join()
        os._exit(EXIT_INTERRUPTED)
