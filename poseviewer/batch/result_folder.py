"""The folder of results: a result for each row, and the batch that they belong to.

A row's result is a JSON file in ``rows/`` named by the job's key, and written last. However a batch
ended, a row without a result, or whose fit failed, is still to do. ``batch.json`` is the batch.
"""

import csv
import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field, fields, replace
from io import StringIO
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct

from poseviewer.batch.job_table import Job
from poseviewer.confidence.pose_covariance import PoseCovariance
from poseviewer.confidence.verdict import percent_right
from poseviewer.errors import BatchError, PoseViewerError
from poseviewer.files.checks import InputFile, is_there
from poseviewer.files.masks import MaskFile
from poseviewer.files.writing import lock_file, write_json, write_whole
from poseviewer.scene.settings import FitSettings, settings_as_json, settings_from_json

ROWS = "rows"
"""Subfolder of the rows' results."""
POSES = "poses"
"""Subfolder of the pose files."""
PICTURES = "pictures"
"""Subfolder of the pictures of poses."""
TABLE = "results.csv"
"""File of the table of results."""
REPORT = "report.html"
"""File of the report."""
MANIFEST = "batch.json"
"""File of the batch."""
LOCK = ".at-work"
"""File that is locked while a batch runs."""
MAX_MANIFEST_BYTES = 1_000_000_000
"""Size of ``MANIFEST``, in bytes, at most: a million rows take less."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""First characters of cells that spreadsheets compute."""
JOB_COLUMNS = ("row", "photo", "model", "start")
"""Columns of the table from the job; the others are the fields of ``JobResult``."""
ACCEPTED = "accepted"
"""Review of a pose that a person accepts."""
MENDED = "mended"
"""Review of a pose that a person has corrected."""
REJECTED = "rejected"
"""Review of a pose that a person rejects."""
KEPT = "kept"
"""Review in an audit of a given pose that a person keeps, in place of the one found."""
MOVED = "moved"
"""Finding of an audit: the search ended ``found``, farther away than the pose is uncertain."""
UNEXPLAINED = "unexplained"
"""Finding of an audit: the verdict is ``lost`` at the given pose, and where the search ended."""


@dataclass(frozen=True, slots=True)
class JobResult:
    """Result of a row: the fit or the reason of its failure, and a person's review."""

    status: str
    """End of the search in a sentence; ``Failed.`` without one."""
    reason: str = ""
    """Reason of the failure; empty for a row that was fitted."""
    loss: float | None = None
    start_loss: float | None = None
    unexplained: float | None = None
    """Loss on the scale from 0, all explained, to 1, nothing."""
    start_unexplained: float | None = None
    evaluations: int = 0
    seconds: float = 0.0
    pose: str = ""
    """Pose file, relative to the folder of results."""
    picture: str = ""
    """Picture of the pose, relative to the folder of results."""
    verdict: str = ""
    """``found``, ``doubtful`` or ``lost``; empty for a row that failed."""
    probability: float | None = None
    """Probability that the pose is right, in [0, 1]."""
    reasons: str = ""
    """Reasons of the verdict, a sentence a line."""
    depth_std: float | None = None
    """Standard deviations of the pose, if it is right (``PoseCovariance``); None: not known."""
    sideways_std: float | None = None
    degrees_std: float | None = None
    px_std: float | None = None
    scale_percent_std: float | None = None
    focal_px_std: float | None = None
    size_percent_std: float | None = None
    principal_px_std: float | None = None
    finding: str = ""
    """Finding of an audit, ``moved`` or ``unexplained``; empty: the given pose may stay."""
    moved_percent: float | None = None
    """Mean distance in the photo from the given pose of an audit, in % of the object's size."""
    moved_px: float | None = None
    moved_deviations: float | None = None
    """Distance from the given pose of an audit, in stated standard deviations; None: not known."""
    given_verdict: str = ""
    """Verdict at the given pose of an audit."""
    question: str = ""
    """Question about the row's files, which other rows may share: asked once for all."""
    review: str = ""
    """Review by a person: ``accepted``, ``mended`` by hand, ``rejected``; ``kept`` in an audit."""
    note: str = ""
    """Note of the person."""

    @property
    def failed(self) -> bool:
        """Whether the row could not be fitted."""
        return bool(self.reason)

    @property
    def is_accepted(self) -> bool:
        """Whether a person accepts the pose, as it was found or corrected."""
        return self.review in (ACCEPTED, MENDED)

    @property
    def is_rejected(self) -> bool:
        """Whether a person rejects the pose found; in an audit the given one is kept."""
        return self.review in (REJECTED, KEPT)


STDS = tuple(field.name for field in fields(JobResult) if field.name.endswith("_std"))
"""Columns of standard deviations: the names of ``PoseCovariance.deviations`` with ``_std``."""
AUDIT_COLUMNS = ("finding", "moved_percent", "moved_px", "moved_deviations", "given_verdict")
"""Columns of an audit alone."""


@dataclass(frozen=True, slots=True)
class Row:
    """A row and its result."""

    job: Job
    result: JobResult


@dataclass(frozen=True, slots=True)
class Batch:
    """The rows of a table or a BOP scene, their settings, and the folder of their results."""

    folder: Path
    """Folder of the results, absolute."""
    jobs: tuple[Job, ...]
    """Rows in the order of the table."""
    settings: FitSettings = field(default_factory=FitSettings)
    scene: str | None = None
    """Folder of the BOP scene of the rows, absolute; None: they are of a table."""
    mask: MaskFile | None = None
    """Mask of every photo; not in ``batch.json``."""
    is_audit: bool = False
    """Whether the starts are given poses, to be compared with those found."""
    sequence: str | None = None
    """Scene file of a sequence or set of photos that is audited, absolute; None: none is."""
    features: Path | None = None
    """Weights of a DINOv2 backbone for starts ``auto`` without a box; not in ``batch.json``."""

    def rows(self) -> list[Row]:
        """Read the rows that have a result, in their order."""
        results = [(job, load_result(self.folder, job.key)) for job in self.jobs]
        return [Row(job, result) for job, result in results if result is not None]

    def to_do(self) -> list[Job]:
        """Return the rows that are not fitted yet; of equal rows only the first."""
        done = {row.job.key for row in self.rows() if not row.result.failed}
        first = {job.key: job for job in reversed(self.jobs) if job.key not in done}
        return sorted(first.values(), key=lambda job: job.row)


class Manifest(Struct, kw_only=True):
    """Content of ``batch.json``."""

    format: Literal["poseviewer-batch"] = "poseviewer-batch"
    version: Literal[1] = 1
    scene: str | None
    settings: dict[str, Any]
    jobs: tuple[Job, ...]
    audit: bool = False
    sequence: str | None = None


def standard_deviations(covariance: PoseCovariance | None) -> dict[str, Any]:
    """Return the columns of ``STDS``; without a covariance their values are None."""
    known = {} if covariance is None else covariance.deviations
    return {name: known.get(name.removesuffix("_std")) for name in STDS}


def worst_first(rows: Sequence[Row]) -> list[Row]:
    """Sort rows: failed ones, those of an audit with a finding, then by the share of right poses
    that the verdict states; reviewed ones come last.
    """

    def order(row: Row) -> tuple[bool, float, int]:
        result = row.result
        rank = -math.inf
        if not result.failed and result.probability is not None:
            rank = percent_right(result.verdict, result.probability) / 100.0
        if result.finding:
            away = math.inf if result.moved_percent is None else result.moved_percent
            rank -= 1.0 if result.finding == UNEXPLAINED else 1.0 + away
        return bool(result.review), rank, row.job.row

    return sorted(rows, key=order)


def summarise_findings(rows: Sequence[Row]) -> str:
    """Return the counts of an audit's findings as text."""
    findings = [row.result.finding for row in rows]
    moved, unexplained = (findings.count(name) for name in (MOVED, UNEXPLAINED))
    return f"given poses: {moved} {MOVED}, {unexplained} {UNEXPLAINED}"


def comparison_text(result: JobResult) -> str:
    """Return what an audit says of a row as a sentence."""
    deviations, away = result.moved_deviations, "at an unknown distance"
    if result.moved_percent is not None and result.moved_px is not None:
        sure = "" if deviations is None else f", {deviations:.1f} of its standard deviations"
        away = f"{result.moved_percent:.1f} % of the object's size ({result.moved_px:.1f} px{sure})"
    finding = result.finding or "no finding"
    return f"{finding}: {away} from the given pose, whose verdict is {result.given_verdict}."


def summarise_questions(rows: Sequence[Row]) -> str:
    """Return the question that rows ask as a sentence about all of them; or nothing."""
    asking = [row for row in rows if row.result.question]
    if not asking:
        return ""
    first = asking[0]
    return f"{len(asking)} of {len(rows)} rows, as row {first.job.row}: {first.result.question}"


def summarise_failures(rows: Sequence[Row]) -> str:
    """Return why the first of the failed rows did, and how many others; or nothing."""
    failed = [row for row in rows if row.result.failed]
    if not failed:
        return ""
    others = f" ({len(failed) - 1} others: see the table)" if len(failed) > 1 else ""
    return f"row {failed[0].job.row}: {failed[0].result.reason}{others}"


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock the folder of results.

    Raises:
        BatchError: another batch runs in it.
    """
    with ExitStack() as stack:
        with suppress(OSError):  # writing the first file will say what is wrong
            lock = lock_file(folder / LOCK)
            if lock is None:
                raise BatchError(
                    f"{folder}: another batch is at work in it; wait for its end, or name another "
                    "folder of results. What is done is not done twice."
                )
            stack.enter_context(lock)
            stack.callback(_remove_lock, folder)  # while it is held
        yield


def _remove_lock(folder: Path) -> None:
    with suppress(OSError):  # Windows removes no file that is open
        (folder / LOCK).unlink()


def load_result(folder: Path, key: str) -> JobResult | None:
    """Read the result of the job with this key.

    None if the result or one of its files is missing, or a file is outside the folder.
    """
    try:
        data = InputFile(folder / ROWS / f"{key}.json").load_bytes()
        result = msgspec.json.decode(data, type=JobResult)
    except (PoseViewerError, msgspec.MsgspecError, RecursionError):
        return None
    files = () if result.failed else (result.pose, result.picture)
    paths = [(folder / name).resolve() for name in files]
    inside = all(is_there(path) and folder.resolve() in path.parents for path in paths)
    return result if inside else None


def save_result(folder: Path, job: Job, result: JobResult) -> JobResult:
    """Write a result, and return it: a job that was fitted is now done.

    Numbers that are not finite are left empty, and named in ``reasons``.
    """
    values = asdict(result).items()
    odd = [name for name, value in values if isinstance(value, float) and not math.isfinite(value)]
    if odd:
        reasons = "\n".join([*result.reasons.splitlines(), f"Not finite: {', '.join(odd)}."])
        result = replace(result, reasons=reasons, **dict.fromkeys(odd))
    write_json(folder / ROWS / f"{job.key}.json", asdict(result), BatchError)
    return result


def save_failure(folder: Path, job: Job, reason: str, question: str = "") -> JobResult:
    """Write the reason why a row could not be fitted."""
    return save_result(folder, job, JobResult("Failed.", reason, question=question))


def save_table(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``results.csv``, a line for each row."""
    text = StringIO()
    names = [*JOB_COLUMNS, *(field.name for field in fields(JobResult))]
    if not any(row.result.given_verdict for row in rows):
        names = [name for name in names if name not in AUDIT_COLUMNS]
    table = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for row in rows:
        about = {name: getattr(row.job, name) for name in JOB_COLUMNS}
        values = about | asdict(row.result)
        table.writerow({name: _as_text(value) for name, value in values.items()})
    write_whole(folder / TABLE, text.getvalue().encode(), BatchError)


def _as_text(value: Any) -> Any:
    """Quote a text that spreadsheets would compute."""
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value


def save_batch(batch: Batch) -> None:
    """Write ``batch.json``."""
    settings = settings_as_json(batch.settings)
    shared = {"scene": batch.scene, "jobs": batch.jobs, "sequence": batch.sequence}
    manifest = Manifest(settings=settings, audit=batch.is_audit, **shared)
    data = msgspec.to_builtins(manifest)
    write_json(batch.folder / MANIFEST, data, BatchError, indent=1)


def load_batch(folder: Path) -> Batch:
    """Read ``batch.json``."""
    if not (folder / MANIFEST).exists():
        raise BatchError(
            f"{folder}: no {MANIFEST} in it; name the folder of results that "
            "a batch filled (run it again if an older version did)."
        )
    try:
        data = InputFile(folder / MANIFEST, kind="batch", largest=MAX_MANIFEST_BYTES).load_bytes()
        manifest = msgspec.json.decode(data, type=Manifest)
    except (PoseViewerError, msgspec.MsgspecError, RecursionError) as error:
        raise BatchError(
            f"{folder / MANIFEST}: cannot be used ({type(error).__name__}: {error}); run the batch "
            "again, what is done is not done twice."
        ) from None
    for name in (ROWS, POSES, PICTURES):
        if (folder / name).is_symlink():
            found = f"{folder / name}: is a link, through which nothing is written"
            raise BatchError(f"{found}; put the folder itself there.")
    settings = settings_from_json(manifest.settings)
    known = {"is_audit": manifest.audit, "sequence": manifest.sequence}
    return Batch(folder, manifest.jobs, settings, manifest.scene, **known)
