"""What a batch found, row by row for a person: accept, mend, note.

Everything is kept in the folder of results. What a person says of a row goes into the row's own
file (``results``), a mended pose into its pose file, with the fitted one kept beside it; a pose
that is being mended is a draft in ``review/``.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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
from poseviewer.files.masks import mask_path, save_pose_and_mask
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord
from poseviewer.geometry.mask import Mask
from poseviewer.render.overlay.looks import Picture

DRAFTS = "review"
BY_HAND = "Set by hand."


@dataclass(frozen=True, slots=True)
class ReviewRow:
    """A row, and what came of it so far."""

    job: Job
    result: JobResult


@dataclass(frozen=True, slots=True)
class ReviewQueue:
    """The rows in the order in which they are shown: the worst first, those accepted last."""

    folder: Path
    manifest: Manifest
    rows: tuple[ReviewRow, ...]
    failed: Mapping[str, JobResult] = field(default_factory=dict)
    """The rows without a pose, by their jobs' keys."""

    @property
    def accepted(self) -> int:
        """How many rows a person has accepted."""
        return sum(bool(row.result.review) for row in self.rows)

    def draft(self, row: ReviewRow) -> Path:
        """Where a pose that is being mended is kept."""
        return self.folder / DRAFTS / f"{row.job.key}.json"

    def start(self, row: ReviewRow) -> Path:
        """The pose that a row opens with: the one found, or, where it failed, its start."""
        return self.folder / row.result.pose if row.result.pose else row.job.path(row.job.start)

    def renewed(self, row: ReviewRow, result: JobResult) -> ReviewQueue:
        """The queue with another result of a row, in the same order."""
        rows = tuple(
            replace(one, result=result) if one.job.key == row.job.key else one for one in self.rows
        )
        failed = {key: value for key, value in self.failed.items() if key != row.job.key}
        if result.failed:
            failed[row.job.key] = result
        return replace(self, rows=rows, failed=failed)


def load_queue(folder: Path) -> ReviewQueue:
    """The rows of a batch that were fitted, or failed.

    Raises:
        BatchError: the folder holds no batch, or nothing in it is done yet.
    """
    folder = folder.resolve()
    manifest = load_manifest(folder)
    failed = load_failures(folder, manifest)
    jobs = {job.row: job for job in manifest.jobs}
    results = worst_first(known_results(folder, manifest, failed))
    first = {jobs[result.row].key: result for result in reversed(results)}
    rows = [ReviewRow(jobs[r.row], r) for r in results if first[jobs[r.row].key] is r]
    if not rows:
        raise BatchError(f"{folder}: no row of the batch is done yet; nothing to review.")
    make_folders(folder, (ROWS, POSES, PICTURES, DRAFTS))
    return ReviewQueue(folder, manifest, tuple(rows), failed)


def accept(queue: ReviewQueue, row: ReviewRow) -> JobResult:
    """Accept the pose that was found.

    Raises:
        BatchError: the row has no pose, or it cannot be written.
    """
    if row.result.failed:
        raise BatchError(f"Row {row.job.row} has no pose; place the model first.")
    return _save(queue, row, review=row.result.review or ACCEPTED)


def accept_mended(
    queue: ReviewQueue,
    row: ReviewRow,
    record: PoseRecord,
    picture: Picture,
    mask: Mask | None = None,
) -> JobResult:
    """Accept a pose that a person set, in place of the one found, which is kept beside it; with the
    mask by which it is compared.

    Raises:
        PoseViewerError: it is by another camera than its BOP scene's, or cannot be written.
    """
    require_scene_camera(queue.manifest, row.job.photo, record.pose.camera)
    pose, drawn = result_files(row.job)
    path, fitted = queue.folder / pose, queue.folder / pose.replace(".json", ".fitted.json")
    if path.is_file() and not fitted.exists():
        try:
            shutil.copyfile(path, fitted)
        except OSError as error:
            raise BatchError(
                f"{fitted}: cannot be written ({error.strerror}); nothing was changed."
            ) from None
    save_pose_and_mask(path, record, mask)
    for path in (queue.folder / drawn, *_pictures_of_mates(queue, row)):
        save_image(path, smaller(picture))
    result = _save(
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
    drop_draft(queue, row)
    return result


def _pictures_of_mates(queue: ReviewQueue, row: ReviewRow) -> list[Path]:
    """The pictures of the other rows that were fitted together with a row: each shows them all."""
    return [
        queue.folder / one.result.picture
        for one in queue.rows
        if queue.manifest.together and one.job.photo == row.job.photo and one.result.picture
    ]


def take_back(queue: ReviewQueue, row: ReviewRow) -> JobResult:
    """Take an acceptance back; a pose that was mended stays."""
    return _save(queue, row, review="")


def annotate(queue: ReviewQueue, row: ReviewRow, note: str) -> JobResult:
    """Keep a person's words about a row. Those about a row that failed stand in the table alone."""
    return _save(queue, row, note=" ".join(note.split()))


def _save(queue: ReviewQueue, row: ReviewRow, **changes: Any) -> JobResult:
    """The row's result with changes; one that failed has no file to be kept in."""
    result = replace(row.result, **changes)
    if not result.failed:
        save_result(queue.folder, row.job, result)
    return result


def drop_draft(queue: ReviewQueue, row: ReviewRow) -> None:
    """Forget a pose that was being mended; nothing happens where there is none."""
    try:
        for path in (queue.draft(row), mask_path(queue.draft(row))):
            path.unlink(missing_ok=True)
    except OSError as error:
        raise BatchError(
            f"{queue.draft(row)}: cannot be removed ({error.strerror}); remove it by hand."
        ) from None


def save_reviewed(queue: ReviewQueue) -> None:
    """Write table, report and BOP scene anew from the rows' own files."""
    results = known_results(queue.folder, queue.manifest, queue.failed)
    save_summaries(queue.folder, queue.manifest, results)
