"""What came of each row: kept one by one as it comes, gathered in a table at the end.

A result is a JSON file in ``rows/`` named by the job's key. It is written last, after the pose and
the picture it names, whole or not at all: where it is, the row is done, and where it is not, the
row is to be done, whenever a batch was killed.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from io import StringIO
from pathlib import Path
from typing import Any

from poseviewer.batch.jobs import Job
from poseviewer.errors import BatchError
from poseviewer.files.writing import write_whole

ROWS, POSES, PICTURES = "rows", "poses", "pictures"
TABLE, REPORT = "results.csv", "report.html"
ACCEPTED, MENDED = "accepted", "mended"


@dataclass(frozen=True, slots=True)
class JobResult:
    """A row that was fitted, or why it was not."""

    row: int
    photo: str
    model: str
    start: str
    status: str
    """How the search ended, in a sentence; ``Failed.``"""
    reason: str = ""
    """Why the row failed; empty where it was fitted."""
    loss: float | None = None
    start_loss: float | None = None
    evaluations: int = 0
    seconds: float = 0.0
    pose: str = ""
    """The pose file, from the folder of results."""
    picture: str = ""
    """The picture of the pose, from the folder of results."""
    verdict: str = ""
    """``found``, ``doubtful`` or ``lost``; empty where the row was not fitted."""
    probability: float | None = None
    """That the pose is right, in [0, 1]."""
    reasons: str = ""
    """Of the verdict, a sentence a line."""
    review: str = ""
    """What a person said of the pose: ``accepted``, or ``mended`` by hand and then accepted."""
    note: str = ""
    """The person's own words."""

    @property
    def failed(self) -> bool:
        """Whether there is no pose."""
        return bool(self.reason)


def failed_result(job: Job, reason: str) -> JobResult:
    """A row that could not be fitted."""
    return JobResult(job.row, job.photo, job.model, job.start, "Failed.", reason)


def distrust(result: JobResult) -> float:
    """How little to trust a row, in [0, 1]; the report starts with the greatest.

    The verdict's probability that the pose is wrong. Rows that failed come first.
    """
    if result.failed or result.probability is None:
        return float("inf")
    return 1.0 - result.probability


def worst_first(results: Sequence[JobResult]) -> list[JobResult]:
    """By ``distrust``, rows alike in that in their order; those that a person accepted are last."""
    return sorted(results, key=lambda r: (bool(r.review), -distrust(r), r.row))


def make_folders(folder: Path) -> None:
    """Make the folder of results and those in it.

    Raises:
        BatchError: they cannot be made.
    """
    try:
        for name in (ROWS, POSES, PICTURES):
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BatchError(
            f"{folder}: cannot be made ({error.strerror}); name a folder of yours."
        ) from None


def load_result(folder: Path, job: Job) -> JobResult | None:
    """What came of a job before; None if it is to be done, or what it left is no longer there."""
    found = load_result_of(folder, job.key)
    return None if found is None else _as_row_of(job, found)


def load_result_of(folder: Path, key: str) -> JobResult | None:
    """The same by the job's key alone, under the row that it had when it was fitted."""
    try:
        data = dict(json.loads((folder / ROWS / f"{key}.json").read_bytes()))
        known = {field.name for field in fields(JobResult)} - {"review", "note"}
        said = {key: str(data.get(key, "")) for key in ("review", "note")}
        values: dict[str, Any] = {key: data[key] for key in known} | said
        found = JobResult(**values)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if not all((folder / name).is_file() for name in (found.pose, found.picture)):
        return None
    return found


def save_result(folder: Path, job: Job, result: JobResult) -> None:
    """Keep a result: from here on the job is done.

    Raises:
        BatchError: it cannot be written.
    """
    text = json.dumps(asdict(result), indent=2, ensure_ascii=False)
    write_whole(folder / ROWS / f"{job.key}.json", (text + "\n").encode(), BatchError)


def save_table(folder: Path, results: Sequence[JobResult]) -> None:
    """Write ``results.csv``: a line for each row, in their order.

    Raises:
        BatchError: it cannot be written.
    """
    text = StringIO()
    table = csv.DictWriter(text, [f.name for f in fields(JobResult)], lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(result) for result in sorted(results, key=lambda r: r.row))
    write_whole(folder / TABLE, text.getvalue().encode(), BatchError)


def _as_row_of(job: Job, result: JobResult) -> JobResult:
    """The same result under the job's row: rows move when a table is edited."""
    values = asdict(result) | {
        "row": job.row, "photo": job.photo, "model": job.model, "start": job.start
    }  # fmt: skip
    return JobResult(**values)
