"""Jobs on all cores of this machine: a process each, since a search holds the interpreter a lot."""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.synchronize import Event

from poseviewer.batch.jobs import Job
from poseviewer.batch.parent import end_with_parent
from poseviewer.batch.results import JobResult, failed_result
from poseviewer.batch.work import Plan, StoppedError, run_job

_SPAWN = get_context("spawn")  # a fork would copy threads' locks in whatever state they are

_stop: Event | None = None
"""In a worker process: set when the batch is to stop."""


def run_here(jobs: Sequence[Job], plan: Plan, processes: int) -> Iterator[JobResult]:
    """The results of the jobs as they come, in no order.

    A process that dies (for want of memory, say) takes no other job along: those that were under
    way are then run alone, and fail only if they die again. To stop, stop asking: what is under
    way then ends between two evaluations.

    Raises:
        BatchError: results cannot be written.
    """
    waiting = deque(jobs)
    while waiting:
        suspects: list[Job] = []
        yield from _run_together(waiting, plan, min(processes, len(waiting)), suspects)
        for job in suspects:
            again: list[Job] = []
            yield from _run_together(deque([job]), plan, 1, again)
            if again:
                yield failed_result(
                    job,
                    "the process that fitted it died, twice; is there memory enough for the photo "
                    "and the model?",
                )


def _run_together(
    waiting: deque[Job], plan: Plan, processes: int, suspects: list[Job]
) -> Iterator[JobResult]:
    """Run jobs until none waits, or a process dies: ``suspects`` are then those under way."""
    stop = _SPAWN.Event()
    pool = ProcessPoolExecutor(processes, _SPAWN, _begin, (stop,))
    flying: dict[Future[JobResult], Job] = {}
    try:
        while waiting or flying:
            # No more than can run: what is under way when a process dies is what may have done it.
            while len(flying) < processes and not suspects:
                job = _first_ready(waiting, flying.values())
                if job is None:
                    break
                try:
                    flying[pool.submit(_work, job, plan)] = job
                except BrokenProcessPool:
                    break
                waiting.remove(job)
            if not flying:
                return
            done, _ = wait(flying, return_when=FIRST_COMPLETED)
            for future in done:
                job = flying.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    suspects.append(job)
            if suspects and not flying:
                return
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _first_ready(waiting: Iterable[Job], flying: Iterable[Job]) -> Job | None:
    """The first job that need not wait for the row above it."""
    ahead = {job.key for job in (*waiting, *flying)}
    return next((job for job in waiting if not ahead.intersection(job.above[:1])), None)


def _begin(stop: Event) -> None:
    """In a new worker process."""
    global _stop
    _stop = stop
    # Ctrl-C goes to all processes of a terminal; the first one tells the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def _work(job: Job, plan: Plan) -> JobResult:
    stop = _stop
    try:
        return run_job(job, plan, stop.is_set if stop is not None else lambda: False)
    except StoppedError:
        return failed_result(job, "stopped")
