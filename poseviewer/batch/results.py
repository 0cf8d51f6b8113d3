"""The folder of results: what came of each row, and the batch that it belongs to.

A row's result is a JSON file in ``rows/`` named by the job's key. It is written whole or not at
all, after the pose and the picture that it names: where it is, the row is done, and where it is
not, the row is still to be done, however the batch ended. ``batch.json`` says what the batch is.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from io import StringIO
from pathlib import Path
from typing import Any

from poseviewer.batch.table import Job
from poseviewer.errors import BatchError
from poseviewer.files.writing import lock_file, make_folder, write_json, write_whole
from poseviewer.fit.settings import FitSettings, settings_as_json, settings_from_json
from poseviewer.geometry.pose_covariance import PoseCovariance

ROWS, POSES, PICTURES = "rows", "poses", "pictures"
TABLE, REPORT, MANIFEST = "results.csv", "report.html", "batch.json"
LOCK = ".at-work"
ACCEPTED, MENDED, REJECTED = "accepted", "mended", "rejected"
STDS = (
    *("depth_std", "sideways_std", "degrees_std", "px_std"),
    *("scale_percent_std", "focal_px_std", "size_percent_std"),
)
"""Columns of standard deviations: attributes of ``PoseCovariance`` with an ending."""
FORMAT, VERSION = "poseviewer-batch", 1


@dataclass(frozen=True, slots=True)
class Manifest:
    """The rows of a batch, and how they are fitted."""

    jobs: tuple[Job, ...]
    """In the order of their rows."""
    settings: FitSettings = field(default_factory=FitSettings)
    scene: str | None = None
    """The BOP scene that the rows are from, absolute; None for those of a table."""


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
    unexplained: float | None = None
    """The loss on the scale from 0, all explained, to 1, nothing."""
    start_unexplained: float | None = None
    evaluations: int = 0
    seconds: float = 0.0
    pose: str = ""
    """The pose file, relative to the folder of results."""
    picture: str = ""
    """The picture of the pose, relative to the folder of results."""
    verdict: str = ""
    """``found``, ``doubtful`` or ``lost``; empty where the row was not fitted."""
    probability: float | None = None
    """That the pose is right, in [0, 1]."""
    reasons: str = ""
    """Of the verdict, a sentence a line."""
    depth_std: float | None = None
    """Standard deviations of the pose, if it is right: of its depth, and sideways, in the model's
    unit; in degrees; and in the photo, px (``PoseCovariance``). None where they are not known."""
    sideways_std: float | None = None
    degrees_std: float | None = None
    px_std: float | None = None
    scale_percent_std: float | None = None
    """In place of the depth's, under parallel projection; of a focal length that was free; of the
    model's size among cameras of unknown scale."""
    focal_px_std: float | None = None
    size_percent_std: float | None = None
    review: str = ""
    """Review of the pose by a person: ``accepted``, ``mended`` by hand, or ``rejected``."""
    note: str = ""
    """The person's own words."""

    @property
    def failed(self) -> bool:
        """Whether there is no pose."""
        return bool(self.reason)


def standard_deviations(covariance: PoseCovariance | None) -> dict[str, Any]:
    """The columns of ``STDS``; None each where there is no covariance."""
    return {name: covariance and getattr(covariance, name.removesuffix("_std")) for name in STDS}


def failed_result(job: Job, reason: str) -> JobResult:
    """A row that could not be fitted."""
    return JobResult(job.row, job.photo, job.model, job.start, "Failed.", reason)


def worst_first(results: Sequence[JobResult]) -> list[JobResult]:
    """Those that failed, then by the probability of the verdict; reviewed ones are last."""

    def order(result: JobResult) -> tuple[bool, float, int]:
        unknown = result.failed or result.probability is None
        return bool(result.review), -1.0 if unknown else result.probability or 0.0, result.row

    return sorted(results, key=order)


def make_folders(folder: Path, names: Iterable[str] = (ROWS, POSES, PICTURES)) -> None:
    """Make the folder of results and those in it."""
    for name in names:
        make_folder(folder / name, BatchError)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Lock the folder of results; raises BatchError while another batch is at work in it."""
    with ExitStack() as stack:
        with suppress(OSError):  # what cannot be written to is said by who writes
            lock = lock_file(folder / LOCK)
            if lock is None:
                raise BatchError(
                    f"{folder}: another batch is at work in it; wait for its end, or name another "
                    "folder for --out. What is done is not done twice."
                )
            stack.enter_context(lock)
        yield


def load_result(folder: Path, key: str) -> JobResult | None:
    """The result of the job with this key; None where it or one of its files is not there."""
    try:
        found = JobResult(**json.loads((folder / ROWS / f"{key}.json").read_bytes()))
    except (OSError, ValueError, TypeError):
        return None
    return found if all((folder / n).is_file() for n in (found.pose, found.picture)) else None


def as_row_of(job: Job, result: JobResult) -> JobResult:
    """The same result under the job's row: rows move when a table is edited."""
    return replace(result, row=job.row, photo=job.photo, model=job.model, start=job.start)


def save_result(folder: Path, job: Job, result: JobResult) -> None:
    """Keep a result: from here on the job is done."""
    write_json(folder / ROWS / f"{job.key}.json", asdict(result), BatchError)


def known_results(
    folder: Path, manifest: Manifest, failed: Mapping[str, JobResult]
) -> list[JobResult]:
    """Results in the order of the rows: those on disk, else the ``failed`` ones, by key."""
    found = ((job, load_result(folder, job.key) or failed.get(job.key)) for job in manifest.jobs)
    return [as_row_of(job, result) for job, result in found if result is not None]


def save_table(folder: Path, results: Sequence[JobResult]) -> None:
    """Write ``results.csv``: a line for each row, in their order."""
    text = StringIO()
    table = csv.DictWriter(text, [f.name for f in fields(JobResult)], lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(result) for result in sorted(results, key=lambda r: r.row))
    write_whole(folder / TABLE, text.getvalue().encode(), BatchError)


def load_failures(folder: Path, manifest: Manifest) -> dict[str, JobResult]:
    """The rows that failed, by their jobs' keys, as the table of results has them."""
    try:
        with (folder / TABLE).open(encoding="utf-8", newline="") as file:
            rows = {row["row"]: row for row in csv.DictReader(file) if row["reason"]}
    except (OSError, ValueError, KeyError, csv.Error):
        return {}
    return {
        job.key: replace(failed_result(job, row["reason"]), note=row.get("note") or "")
        for job in manifest.jobs
        if (row := rows.get(str(job.row))) is not None and row["photo"] == job.photo
    }


def save_manifest(folder: Path, manifest: Manifest) -> None:
    """Write ``batch.json``."""
    data = {
        "format": FORMAT,
        "version": VERSION,
        "scene": manifest.scene,
        "settings": settings_as_json(manifest.settings),
        "jobs": [asdict(job) for job in manifest.jobs],
    }
    write_json(folder / MANIFEST, data, BatchError, indent=1)


def load_manifest(folder: Path) -> Manifest:
    """What ``save_manifest`` wrote."""
    try:
        data = json.loads((folder / MANIFEST).read_bytes())
        if (data["format"], data["version"]) != (FORMAT, VERSION):
            raise ValueError(f"{data['format']} {data['version']}")
        names = [one.name for one in fields(Job)]
        jobs = tuple(Job(**{name: job[name] for name in names}) for job in data["jobs"])
        return Manifest(jobs, settings_from_json(data["settings"]), data["scene"])
    except FileNotFoundError:
        raise BatchError(
            f"{folder}: no {MANIFEST} in it; name the folder of results that "
            "`poseviewer batch ... --out` filled (run it again if an older version did)."
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BatchError(
            f"{folder / MANIFEST}: cannot be used ({type(error).__name__}: {error}); run the batch "
            "again, what is done is not done twice."
        ) from None
