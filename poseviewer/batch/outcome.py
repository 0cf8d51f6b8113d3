"""The files about all rows of a batch, made anew from what each row left."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from poseviewer.batch.bop_outcome import save_scene
from poseviewer.batch.manifest import Manifest
from poseviewer.batch.report import save_report
from poseviewer.batch.results import TABLE, JobResult, failed_result, load_result, save_table


def known_results(
    folder: Path, manifest: Manifest, failed: Mapping[str, JobResult]
) -> list[JobResult]:
    """What came of the rows, in their order: what is on disk, else how they ``failed``, by key.

    Rows that are still to do are left out.
    """
    found = []
    for job in manifest.jobs:
        result = load_result(folder, job)
        if result is None and job.key in failed:
            result = replace(
                failed[job.key], row=job.row, photo=job.photo, model=job.model, start=job.start
            )
        if result is not None:
            found.append(result)
    return found


def save_outcome_files(folder: Path, manifest: Manifest, results: Iterable[JobResult]) -> None:
    """Write the table and the report, and for rows of a BOP scene its files.

    Raises:
        PoseViewerError: they cannot be written.
    """
    results = list(results)
    save_table(folder, results)
    save_report(folder, results)
    save_scene(folder, manifest, results)


def load_failures(folder: Path, manifest: Manifest) -> dict[str, JobResult]:
    """The rows that failed, by their jobs' keys, as the table of results has them."""
    try:
        with (folder / TABLE).open(encoding="utf-8", newline="") as file:
            reasons = {row["row"]: row for row in csv.DictReader(file) if row["reason"]}
    except (OSError, ValueError, KeyError, csv.Error):
        return {}
    failures = {}
    for job in manifest.jobs:
        row = reasons.get(str(job.row))
        if row is not None and row["photo"] == job.photo:
            failures[job.key] = replace(
                failed_result(job, row["reason"]), note=row.get("note") or ""
            )
    return failures
