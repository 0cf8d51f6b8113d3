"""A batch from its table to its report."""

from collections.abc import Generator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from poseviewer.batch.bop_rows import load_scene_jobs, save_bop_poses
from poseviewer.batch.html_report import save_report
from poseviewer.batch.job import run_job
from poseviewer.batch.job_table import Job, load_jobs
from poseviewer.batch.results import (
    MANIFEST,
    PICTURES,
    POSES,
    REPORT,
    ROWS,
    TABLE,
    Batch,
    JobResult,
    Row,
    alone_in,
    save_batch,
    save_failure,
    save_table,
)
from poseviewer.cluster import run_on_cluster
from poseviewer.errors import BatchError
from poseviewer.files.writing import make_folder, require_replaceable
from poseviewer.processes import run_in_processes
from poseviewer.render.pool import processors
from poseviewer.scene.settings import FitSettings

DIED = "each process that fitted it died; is there memory enough for the photo and the model?"


def open_batch(
    table: str | Path,
    folder: str | Path,
    settings: FitSettings,
    mask: Path | None = None,
    models: Path | None = None,
    objects: Sequence[int] = (),
) -> Batch:
    """Read the table, or the BOP scene; and make the folder of results."""
    table = Path(table)
    folder = Path(folder).resolve()
    scene = None
    if table.is_dir():
        scene = str(table.resolve())
        jobs = load_scene_jobs(table.resolve(), folder, settings, models, objects)
    elif models is not None or objects:
        raise BatchError(
            f"--models or --objects with {table.name}, which is a table: they are for the folder "
            "of a BOP scene; leave them out, or name such a folder."
        )
    else:
        jobs = load_jobs(table, settings)
    if folder.exists() and folder.samefile(scene or table):
        raise BatchError(f"--out {folder}: is the BOP scene itself; name another folder.")
    for name in (TABLE, REPORT, MANIFEST):
        require_replaceable(folder / name, BatchError)
    batch = Batch(folder, jobs, settings, scene, mask.resolve() if mask else None)
    for name in (ROWS, POSES, PICTURES):
        make_folder(folder / name, BatchError)
    with alone_in(folder):
        save_batch(batch)
    return batch


def run_batch(
    batch: Batch, jobs: Sequence[Job], *, scheduler: str | None = None, processes: int | None = None
) -> Generator[JobResult, None, None]:
    """Results of jobs as they come, from this machine or a Dask ``scheduler``."""
    if not jobs:
        return
    plan = replace(batch, jobs=())  # as each job takes it along
    fit, processes = partial(run_job, plan=plan), processes or processors()
    with alone_in(batch.folder):
        if scheduler is None:
            results = run_in_processes(fit, jobs, processes)
        else:
            names = [f"poseviewer-{job.key}-{batch.folder}" for job in jobs]
            results = run_on_cluster(fit, dict(zip(names, jobs, strict=True)), scheduler)
        for job, result in results:
            yield result or save_failure(batch.folder, job, DIED)


def save_summaries(batch: Batch) -> list[Row]:
    """Write table and report of the rows that have a result, and a BOP scene; return the rows."""
    rows = batch.rows()
    save_table(batch.folder, rows)
    save_report(batch.folder, rows)
    save_bop_poses(batch, rows)
    return rows
