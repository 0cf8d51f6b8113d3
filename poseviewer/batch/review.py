"""A person's words on the rows of a batch: verdict and note in the row's own file (``results``), a
corrected pose in the row's pose file, beside the one that was found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from poseviewer.batch.job import result_files, smaller
from poseviewer.batch.results import (
    ACCEPTED,
    MENDED,
    PICTURES,
    POSES,
    ROWS,
    JobResult,
    Manifest,
    known_results,
    load_failures,
    load_manifest,
    make_folders,
    save_result,
    standard_deviations,
    worst_first,
)
from poseviewer.batch.run import save_summaries
from poseviewer.batch.scene import require_scene_camera
from poseviewer.batch.table import Job
from poseviewer.errors import BatchError
from poseviewer.files.masks import save_pose_and_mask
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.mask import Mask
from poseviewer.render.overlay.looks import Picture

DRAFTS = "review"
"""The folder in which version 0.1.0 kept poses that were being corrected."""
BY_HAND = "Set by hand."


@dataclass(frozen=True, slots=True)
class ReviewRow:
    """A row, and what came of it so far."""

    job: Job
    result: JobResult


@dataclass(frozen=True, slots=True)
class ReviewQueue:
    """The rows in the order in which they are shown: the worst first, those reviewed last."""

    folder: Path
    manifest: Manifest
    rows: tuple[ReviewRow, ...]

    def renewed(self, index: int, result: JobResult) -> ReviewQueue:
        """The queue with another result of a row, in the same order."""
        row = replace(self.rows[index], result=result)
        return replace(self, rows=(*self.rows[:index], row, *self.rows[index + 1 :]))


def load_queue(folder: Path) -> ReviewQueue:
    """The rows of a batch that were fitted, or failed."""
    folder = folder.resolve()
    manifest = load_manifest(folder)
    jobs = {job.row: job for job in manifest.jobs}
    results = worst_first(known_results(folder, manifest, load_failures(folder, manifest)))
    first = {jobs[result.row].key: result for result in reversed(results)}
    rows = [ReviewRow(jobs[r.row], r) for r in results if first[jobs[r.row].key] is r]
    if not rows:
        raise BatchError(f"{folder}: no row of the batch is done yet; nothing to review.")
    make_folders(folder, (ROWS, POSES, PICTURES))
    return ReviewQueue(folder, manifest, tuple(rows))


def decide(queue: ReviewQueue, row: ReviewRow, review: str) -> JobResult:
    """Accept the pose in the row's file, reject it, or ("") take either back."""
    if row.result.failed and review == ACCEPTED:
        raise BatchError(f"Row {row.job.row} has no pose; place the model first.")
    is_mended = review == ACCEPTED and row.result.review == MENDED
    return _save(queue, row, review=MENDED if is_mended else review)


def save_corrected(
    queue: ReviewQueue,
    row: ReviewRow,
    record: PoseRecord,
    picture: Picture,
    mask: Mask | None = None,
) -> JobResult:
    """Save a person's pose, and mask, as the row's; the fitted one is kept as ``.fitted.json``."""
    require_scene_camera(queue.manifest, row.job.photo, record.pose.camera)
    pose, drawn = result_files(row.job)
    path, fitted = queue.folder / pose, queue.folder / pose.replace(".json", ".fitted.json")
    if path.is_file() and not fitted.exists():
        write_whole(fitted, path.read_bytes(), BatchError)
    save_pose_and_mask(path, record, mask)
    save_image(queue.folder / drawn, smaller(picture))
    return _save(
        queue,
        row,
        status=BY_HAND if row.result.failed else row.result.status,
        reason="",
        loss=record.loss,
        unexplained=record.unexplained,
        pose=pose,
        picture=drawn,
        review=MENDED,
        **standard_deviations(record.covariance),
    )


def annotate(queue: ReviewQueue, row: ReviewRow, note: str) -> JobResult:
    """Save a note on a row; one on a row that failed stands in the table alone."""
    return _save(queue, row, note=" ".join(note.split()))


def _save(queue: ReviewQueue, row: ReviewRow, **changes: Any) -> JobResult:
    """The row's result with changes; one that failed has no file to be kept in."""
    result = replace(row.result, **changes)
    if not result.failed:
        save_result(queue.folder, row.job, result)
    return result


def save_reviewed(queue: ReviewQueue) -> None:
    """Write table, report and BOP scene anew from the rows' own files."""
    failed = {row.job.key: row.result for row in queue.rows if row.result.failed}
    save_summaries(
        queue.folder, queue.manifest, known_results(queue.folder, queue.manifest, failed)
    )
