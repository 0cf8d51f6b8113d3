"""Jobs on all cores of this machine, a process each: a search holds Python's lock too long for
threads.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import Connection

from poseviewer.batch.job import run_job
from poseviewer.batch.job_table import Job
from poseviewer.batch.results import Batch, JobResult, save_failure

_SPAWN = multiprocessing.get_context("spawn")
"""A fork would copy the locks of other threads as they happen to be."""


def run_here(jobs: Sequence[Job], plan: Batch, processes: int) -> Iterator[JobResult]:
    """Results as they come; jobs under way when a process dies are run again, each alone."""
    waiting = deque(jobs)
    while waiting:
        suspects: list[Job] = []
        yield from _run_together(waiting, plan, min(processes, len(waiting)), suspects)
        for job in suspects:
            died_again: list[Job] = []
            yield from _run_together(deque([job]), plan, 1, died_again)
            if died_again:
                yield save_failure(
                    plan.folder,
                    job,
                    "the process that fitted it died, twice; is there memory enough for the photo "
                    "and the model?",
                )


def _run_together(
    waiting: deque[Job], plan: Batch, processes: int, suspects: list[Job]
) -> Iterator[JobResult]:
    """Run jobs until none waits, or a process dies: ``suspects`` gets those under way then."""
    reader, writer = _SPAWN.Pipe(duplex=False)
    pool = ProcessPoolExecutor(processes, _SPAWN, _begin, (reader,))
    running: dict[Future[JobResult], Job] = {}
    try:
        while waiting or running:
            # No more than can run: any of those under way may be why a process died.
            while waiting and len(running) < processes and not suspects:
                try:
                    running[pool.submit(run_job, waiting[0], plan)] = waiting[0]
                except BrokenProcessPool:
                    break
                waiting.popleft()
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                job = running.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    suspects.append(job)
            if suspects and not running:
                return
    finally:
        writer.close()
        pool.shutdown(cancel_futures=True)
        reader.close()


def _begin(reader: Connection) -> None:
    """Prepare a worker process, which ends when the pipe's other end is closed: the batch stops, or
    its process has ended, even if it was killed. What a job had not written whole is left out.
    """

    def end() -> None:
        reader.poll(None)
        os._exit(1)

    # Ctrl-C goes to all processes of a terminal; the first one tells the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end, name="end with parent", daemon=True).start()
