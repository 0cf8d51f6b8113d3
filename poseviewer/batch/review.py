"""Review of a batch by a person; corrected poses are saved beside fitted ones."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from poseviewer.batch.bop_rows import require_scene_camera
from poseviewer.batch.result_folder import (
    ACCEPTED,
    KEPT,
    MENDED,
    REJECTED,
    Batch,
    Row,
    load_batch,
    save_result,
    standard_deviations,
    worst_first,
)
from poseviewer.batch.run_row import result_files, shrink_picture
from poseviewer.errors import BatchError
from poseviewer.files.masks import save_pose_and_masks
from poseviewer.files.photo import save_image
from poseviewer.files.pose import PoseRecord
from poseviewer.files.writing import write_whole
from poseviewer.geometry.mask import Mask
from poseviewer.render.overlay.styles import Picture

BY_HAND = "Set by hand."
"""Status of a row that failed and got its pose from a person."""


@dataclass(frozen=True, slots=True)
class ReviewQueue:
    """The rows in the order of review: the worst first, reviewed ones last."""

    batch: Batch
    rows: tuple[Row, ...]


def load_queue(folder: Path) -> ReviewQueue:
    """Load the rows of a batch that have a result."""
    batch = load_batch(folder.resolve())
    rows = worst_first(batch.rows())
    first = {row.job.key: row for row in reversed(rows)}
    rows = [row for row in rows if first[row.job.key] is row]
    if not rows:
        raise BatchError(f"{folder}: no row of the batch is done yet; nothing to review.")
    return ReviewQueue(batch, tuple(rows))


def decide(queue: ReviewQueue, index: int, review: str) -> ReviewQueue:
    """Accept or reject a row's pose, or withdraw the review by ``""``.

    In an audit the given pose is kept in place of a rejected one.
    """
    row = queue.rows[index]
    if review == REJECTED and queue.batch.is_audit:
        review = KEPT
    if row.result.failed and review == ACCEPTED:
        raise BatchError(f"Row {row.job.row} has no pose; place the model first.")
    is_mended = review == ACCEPTED and row.result.review == MENDED
    return _save(queue, index, review=MENDED if is_mended else review)


def save_corrected(
    queue: ReviewQueue, index: int, record: PoseRecord, picture: Picture, *masks: Mask | None
) -> ReviewQueue:
    """Save a corrected pose, and keep the fitted one as ``.fitted.json``.

    Args:
        queue: rows under review.
        index: index of the row in the queue.
        record: content of the pose file.
        picture: (height, width, 3): picture of the pose.
        masks: the user's mask of the photo, and the occluders.
    """
    row = queue.rows[index]
    require_scene_camera(queue.batch, row.job.photo, record.pose.camera)
    pose, drawn = result_files(row.job)
    path = queue.batch.folder / pose
    fitted = path.with_suffix(".fitted.json")
    if path.is_file() and not fitted.exists():
        write_whole(fitted, path.read_bytes(), BatchError)
    save_pose_and_masks(path, record, *masks)
    save_image(queue.batch.folder / drawn, shrink_picture(picture))
    return _save(
        queue,
        index,
        status=BY_HAND if row.result.failed else row.result.status,
        reason="",
        loss=record.loss,
        unexplained=record.unexplained,
        pose=pose,
        picture=drawn,
        review=MENDED,
        **standard_deviations(record.covariance),
    )


def annotate(queue: ReviewQueue, index: int, note: str) -> ReviewQueue:
    """Save a note on a row."""
    return _save(queue, index, note=" ".join(note.split()))


def _save(queue: ReviewQueue, index: int, **changes: Any) -> ReviewQueue:
    """Write a changed result of a row; the queue keeps its order."""
    row = queue.rows[index]
    result = save_result(queue.batch.folder, row.job, replace(row.result, **changes))
    row = replace(row, result=result)
    return replace(queue, rows=(*queue.rows[:index], row, *queue.rows[index + 1 :]))
