"""A batch from its table to its report."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from poseviewer.batch.bop_jobs import SceneRule, load_scene_jobs
from poseviewer.batch.jobs import Job, load_jobs
from poseviewer.batch.manifest import Manifest, save_manifest
from poseviewer.batch.outcome import known_results, save_outcome_files
from poseviewer.batch.results import JobResult, load_result, make_folders
from poseviewer.batch.work import Plan
from poseviewer.fit.settings import FitSettings
from poseviewer.render.pool import processors


@dataclass(frozen=True, slots=True)
class Batch:
    """The rows of a table, and which of them are done."""

    jobs: tuple[Job, ...]
    plan: Plan
    done: tuple[JobResult, ...]
    """What came of rows in an earlier run."""
    scene: str | None = None
    """The BOP scene that the rows are from."""

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
    table: str | Path,
    folder: str | Path,
    settings: FitSettings,
    mask: Path | None = None,
    rule: SceneRule | None = None,
) -> Batch:
    """Read the table, or the BOP scene; make the folder, and see what is there already.

    Raises:
        PoseViewerError: the table or the scene cannot be used, or the folder not made.
    """
    folder, scene = Path(folder).resolve(), None
    if Path(table).is_dir():
        scene = Path(table).resolve()
        jobs = load_scene_jobs(scene, folder, settings, rule or SceneRule())
    else:
        jobs = load_jobs(table, settings)
    make_folders(folder)
    save_manifest(folder, Manifest(jobs, settings, None if scene is None else str(scene)))
    found = (load_result(folder, job) for job in jobs)
    plan = Plan(folder, settings, mask.resolve() if mask else None)
    done = tuple(result for result in found if result is not None)
    return Batch(jobs, plan, done, None if scene is None else str(scene))


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

    What was done is read from the folder: it may have been reviewed in the meantime.

    Raises:
        PoseViewerError: they cannot be written.
    """
    folder, manifest = batch.plan.folder, Manifest(batch.jobs, batch.plan.settings, batch.scene)
    key_of = {job.row: job.key for job in batch.jobs}
    failed = {key_of[result.row]: result for result in fresh if result.failed}
    results = known_results(folder, manifest, failed)
    save_outcome_files(folder, manifest, results)
    return results
