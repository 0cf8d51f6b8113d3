"""A batch from its table to its report."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.batch.jobs import Job, load_jobs
from poseviewer.batch.report import save_report
from poseviewer.batch.results import JobResult, load_result, make_folders, save_table
from poseviewer.batch.work import Plan
from poseviewer.registration import FitSettings
from poseviewer.render.many import processors


@dataclass(frozen=True, slots=True)
class Batch:
    """The rows of a table, and which of them are done."""

    jobs: tuple[Job, ...]
    plan: Plan
    done: tuple[JobResult, ...]
    """What came of rows in an earlier run."""

    @property
    def to_do(self) -> tuple[Job, ...]:
        """The first job of each key that is not done: rows alike are fitted once."""
        rows = {result.row for result in self.done}
        first: dict[str, Job] = {}
        for job in self.jobs:
            if job.row not in rows:
                first.setdefault(job.key, job)
        return tuple(first.values())


def open_batch(
    table: str | Path, folder: str | Path, settings: FitSettings, mask: Path | None = None
) -> Batch:
    """Read the table, make the folder, and see what is there already.

    Raises:
        BatchError: the table cannot be used, or the folder not made.
    """
    jobs = load_jobs(table, settings)
    folder = Path(folder).resolve()
    make_folders(folder)
    found = (load_result(folder, job) for job in jobs)
    plan = Plan(folder, settings, mask.resolve() if mask else None)
    return Batch(jobs, plan, tuple(result for result in found if result is not None))


def run_batch(
    batch: Batch, *, scheduler: str | None = None, processes: int | None = None
) -> Generator[JobResult, None, None]:
    """Results of the jobs that are to do, as they come; to stop, stop asking.

    On all cores of this machine, or on the Dask cluster of a ``scheduler``.

    Raises:
        BatchError: results cannot be written; there is no such scheduler.
    """
    if not batch.to_do:
        return
    if scheduler is None:
        from poseviewer.batch.local import run_here

        yield from run_here(batch.to_do, batch.plan, processes or processors())
        return
    from poseviewer.batch.cluster import run_on_cluster

    yield from run_on_cluster(batch.to_do, batch.plan, scheduler)


def save_outcome(batch: Batch, fresh: Sequence[JobResult]) -> list[JobResult]:
    """Write the table and the report of all rows that are known; returns them in their order.

    Raises:
        BatchError: they cannot be written.
    """
    by_row = {result.row: result for result in (*batch.done, *fresh)}
    key_of = {job.row: job.key for job in batch.jobs}
    by_key = {key_of[row]: result for row, result in by_row.items()}
    results = [
        replace(by_key[job.key], row=job.row, photo=job.photo, model=job.model, start=job.start)
        for job in batch.jobs
        if job.key in by_key
    ]
    save_table(batch.plan.folder, results)
    save_report(batch.plan.folder, results)
    return results
