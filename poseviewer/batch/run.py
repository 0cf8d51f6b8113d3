"""A batch from its table to its report."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from poseviewer.batch.audit import load_given_jobs, load_scene_file_jobs, save_audited
from poseviewer.batch.bop_rows import load_scene_jobs, save_bop_poses
from poseviewer.batch.html_report import save_report
from poseviewer.batch.job_table import Job, load_jobs
from poseviewer.batch.result_folder import (
    MANIFEST,
    PICTURES,
    POSES,
    REPORT,
    ROWS,
    TABLE,
    Batch,
    JobResult,
    Row,
    lock_folder,
    save_batch,
    save_failure,
    save_table,
)
from poseviewer.batch.run_row import run_row
from poseviewer.cluster import run_on_cluster
from poseviewer.errors import BatchError
from poseviewer.files.masks import MaskFile
from poseviewer.files.writing import make_folder, require_replaceable
from poseviewer.opening.sources import is_scene_file
from poseviewer.processes import run_in_processes
from poseviewer.render.pool import processors
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.automatic import AUTOMATIC
from poseviewer.starts.dino_features import PatchEncoder

DIED = "each process that fitted it died; is there memory enough for the photo and the model?"
"""Reason of a row whose processes ended without a result."""


def open_batch(
    table: str | Path,
    folder: str | Path,
    settings: FitSettings,
    mask: MaskFile | None = None,
    models: Path | None = None,
    objects: Sequence[int] = (),
    is_audit: bool = False,
    features: Path | None = None,
) -> Batch:
    """Read a table or a BOP scene, and make the folder of results.

    Args:
        table: table of jobs, or folder of a BOP scene; in an audit also the folder of a batch's
            results, or the scene file of a sequence or of several photos.
        folder: folder of the results.
        settings: settings of the fits.
        mask: mask of every photo.
        models: folder of a BOP scene's models.
        objects: numbers of a BOP scene's objects to fit; empty: all with poses.
        is_audit: whether the starts are given poses, to be compared with those found.
        features: weights of a DINOv2 backbone, for starts ``auto`` without a box.

    Raises:
        SettingsError: the weights cannot be used.
        BatchError: the table or scene has no rows, or the folder cannot be used.
    """
    table = Path(table)
    folder = Path(folder).resolve()
    scene = None
    is_batch = is_audit and (table / MANIFEST).exists()
    is_of_scene = is_audit and (table.suffix.lower() == ".json" or is_scene_file(table))
    if table.is_dir() and not is_batch:
        scene = str(table.resolve())
        jobs = load_scene_jobs(table.resolve(), folder, settings, models, objects)
    elif models is not None or objects:
        raise BatchError(
            f"models or objects with {table.name}, which is no BOP scene: "
            "they are for the folder of a BOP scene; leave them out, or name such a folder."
        )
    elif is_of_scene:
        jobs = load_scene_file_jobs(table.resolve(), folder, settings)
    elif is_batch:
        jobs = load_given_jobs(table.resolve(), settings)
    else:
        jobs = load_jobs(table, settings)
    if features is not None:
        PatchEncoder.load(features)  # an error is told before anything is written
        if not any(job.start == AUTOMATIC and not job.box for job in jobs):
            raise BatchError(
                f"features with {table.name}, where no row has the start {AUTOMATIC} without a "
                "box: leave them out."
            )
    if folder.exists() and folder.samefile(scene or table):
        raise BatchError(f"{folder}: is what is read; name another folder for the results.")
    if is_audit:  # the same rows of a batch have other results
        jobs = tuple(replace(job, key=f"audit-{job.key}") for job in jobs)
    for name in (TABLE, REPORT, MANIFEST, *([table.name] if is_of_scene else [])):
        require_replaceable(folder / name, BatchError)
    sequence = str(table.resolve()) if is_of_scene else None
    mask = mask and replace(mask, path=mask.path.resolve())
    given = scene, mask, is_audit, sequence, features and features.resolve()
    batch = Batch(folder, jobs, settings, *given)
    for name in (ROWS, POSES, PICTURES):
        make_folder(folder / name, BatchError)
    with lock_folder(folder):
        save_batch(batch)
    return batch


def run_batch(
    batch: Batch,
    jobs: Sequence[Job],
    *,
    scheduler: str | None = None,
    processes: int | None = None,
    run: Callable[..., JobResult] = run_row,
    tick: Callable[[], object] = lambda: None,
) -> Generator[JobResult, None, None]:
    """Run jobs, and yield their results as they come.

    Args:
        batch: batch of the jobs.
        jobs: rows to fit.
        scheduler: address of a Dask scheduler; None: run on this machine.
        processes: number of processes; None: one for each processor.
        run: function of a job and ``plan``, the batch; it writes the result last.
        tick: called now and then while jobs run on this machine.
    """
    if not jobs:
        return
    plan = replace(batch, jobs=())  # small, as it is sent with each job
    fit, processes = partial(run, plan=plan), processes or processors()
    with lock_folder(batch.folder):
        if scheduler is None:
            results = run_in_processes(fit, jobs, processes, tick)
        else:
            names = [f"poseviewer-{job.key}-{batch.folder}" for job in jobs]
            results = run_on_cluster(fit, dict(zip(names, jobs, strict=True)), scheduler)
        for job, result in results:
            yield result or save_failure(batch.folder, job, DIED)


def save_summaries(batch: Batch) -> list[Row]:
    """Write table and report, and a BOP scene or an audit's table of jobs; return the rows."""
    rows = batch.rows()
    save_table(batch.folder, rows)
    save_report(batch.folder, rows)
    save_bop_poses(batch, rows)
    if batch.is_audit and batch.scene is None:
        save_audited(batch, rows)
    return rows
