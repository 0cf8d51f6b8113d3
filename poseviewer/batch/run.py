"""A batch from its table to its report."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from poseviewer.batch.job import BatchPlan
from poseviewer.batch.processes import run_here
from poseviewer.batch.report import save_report
from poseviewer.batch.results import (
    JobResult,
    Manifest,
    alone_in,
    known_results,
    make_folders,
    save_manifest,
    save_table,
)
from poseviewer.batch.scene import SceneOptions, load_scene_jobs, save_scene
from poseviewer.batch.table import Job, load_jobs
from poseviewer.fit.settings import FitSettings
from poseviewer.render.pool import processors


@dataclass(frozen=True, slots=True)
class Batch:
    """The rows of a table or a scene, and which of them are done."""

    manifest: Manifest
    plan: BatchPlan
    done: tuple[JobResult, ...]
    """What came of rows in an earlier run."""

    @property
    def jobs(self) -> tuple[Job, ...]:
        """In the order of their rows."""
        return self.manifest.jobs

    @property
    def to_do(self) -> tuple[Job, ...]:
        """The first job of each key that is not done: equal rows are fitted once."""
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
    scene_options: SceneOptions | None = None,
) -> Batch:
    """Read the table, or the BOP scene; make the folder of results, and read what is there."""
    table, folder = Path(table), Path(folder).resolve()
    if table.is_dir():
        scene = table.resolve()
        jobs = load_scene_jobs(scene, folder, settings, scene_options or SceneOptions())
        manifest = Manifest(jobs, settings, str(scene))
    else:
        manifest = Manifest(load_jobs(table, settings), settings)
    make_folders(folder)
    with alone_in(folder):
        save_manifest(folder, manifest)
    plan = BatchPlan(folder, settings, mask.resolve() if mask else None)
    return Batch(manifest, plan, tuple(known_results(folder, manifest, {})))


def run_batch(
    batch: Batch, *, scheduler: str | None = None, processes: int | None = None
) -> Generator[JobResult, None, None]:
    """Results of the jobs to be done as they come, from this machine or a Dask ``scheduler``."""
    if not batch.to_do:
        return
    with alone_in(batch.plan.folder):
        if scheduler is None:
            yield from run_here(batch.to_do, batch.plan, processes or processors())
            return
        from poseviewer.batch.cluster import run_on_cluster

        yield from run_on_cluster(batch.to_do, batch.plan, scheduler)


def save_outcome(batch: Batch, fresh: Iterable[JobResult]) -> list[JobResult]:
    """Write table, report and scene of all rows on disk, some reviewed since; returns the rows."""
    folder, manifest = batch.plan.folder, batch.manifest
    key_of = {job.row: job.key for job in batch.jobs}
    failed = {key_of[result.row]: result for result in fresh if result.failed}
    results = known_results(folder, manifest, failed)
    save_summaries(folder, manifest, results)
    return results


def save_summaries(folder: Path, manifest: Manifest, results: Sequence[JobResult]) -> None:
    """Write the table and the report, and for rows of a BOP scene its files."""
    save_table(folder, results)
    save_report(folder, results)
    save_scene(folder, manifest, results)
