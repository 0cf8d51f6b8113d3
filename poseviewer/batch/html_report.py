"""The report of a batch: one HTML page with its pictures inside, without scripts."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from poseviewer.batch.result_folder import (
    REPORT,
    JobResult,
    Row,
    comparison_text,
    summarise_findings,
    summarise_questions,
    worst_first,
)
from poseviewer.confidence.verdict import percent_right
from poseviewer.errors import BatchError
from poseviewer.files.writing import write_whole

_STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif; }
body { margin: 2rem auto; max-width: 88rem; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; }
th, td { border-bottom: 1px solid #8884; padding: .5rem; text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
img { display: block; max-width: 36rem; max-height: 14rem; }
.failed, .lost { color: #c62828; }
.doubtful { color: #b26a00; }
.found, .accepted { color: #2e7d32; }
.accepted, .lost, .doubtful, .found { font-weight: 600; }
ul { margin: .25rem 0 0; padding-left: 1.1rem; font-size: .9em; }
td.files { overflow-wrap: anywhere; min-width: 10rem; }
td.verdict { min-width: 20rem; }
"""
_COLUMNS = ("pose", "row", "files", "verdict", "unexplained (0 to 1), at the start", "outcome")
_WORST = "Worst first: those that failed, then by how likely the pose is to be wrong."
_AUDIT = "{}; worst first. Pictures show the photo, the given outline and the one found."
_HEAD = f"<tr>{''.join(f'<th>{name}</th>' for name in _COLUMNS)}</tr>"


def save_report(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``report.html`` with all rows, the worst first; lost pictures are left out."""
    failed = sum(row.result.failed for row in rows)
    is_audit = any(row.result.given_verdict for row in rows)
    rejected = sum(row.result.is_rejected for row in rows)
    accepted = sum(row.result.is_accepted for row in rows)
    no = "kept" if is_audit else "rejected"
    counts = f" {accepted} accepted and {rejected} {no} by a person, which are last."
    reviewed = counts if accepted or rejected else ""
    asked = f" {escape(summarise_questions(rows))}"
    lines = "\n".join(_row(folder, row) for row in worst_first(rows))
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>poseviewer batch</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{len(rows)} photos</h1>\n<p>{len(rows) - failed} fitted, {failed} failed. "
        f"{_AUDIT.format(summarise_findings(rows)) if is_audit else _WORST}{reviewed}{asked}</p>\n"
        f"<table><thead>{_HEAD}</thead><tbody>\n{lines}\n</tbody></table></body></html>\n"
    )
    write_whole(folder / REPORT, page.encode(), BatchError)


def _row(folder: Path, row: Row) -> str:
    job, result = row.job, row.result
    files = "<br>".join(escape(name) for name in (job.photo, job.model, job.start))
    if result.failed:
        picture = ""
        losses = ""
        verdict = ""
        outcome = f'<span class="failed">{escape(result.reason)}</span>'
    else:
        picture = _picture(folder / result.picture, job.photo)
        # A pose set by hand may have no loss.
        pair = (result.unexplained, result.start_unexplained)
        losses = "<br>".join("-" if share is None else f"{share:.3f}" for share in pair)
        verdict = _verdict(result)
        outcome = (
            f"{escape(result.status)}<br>{result.evaluations:,} evaluations, "
            f"{result.seconds:.1f} s<br>{escape(result.pose)}"
        )
    if result.review:
        word = "lost" if result.is_rejected else "accepted"
        outcome = f'<span class="{word}">{escape(result.review)}</span><br>{outcome}'
    if result.note:
        outcome = f"{outcome}<br><q>{escape(result.note)}</q>"
    return (
        f'<tr><td>{picture}</td><td class="number">{job.row}</td><td class="files">{files}</td>'
        f'<td class="verdict">{verdict}</td><td class="number">{losses}</td><td>{outcome}</td></tr>'
    )


def _verdict(result: JobResult) -> str:
    if not result.verdict or result.probability is None:
        return ""
    reasons = "".join(f"<li>{escape(text)}</li>" for text in result.reasons.split("\n"))
    if result.given_verdict:
        reasons = f"<li>{escape(comparison_text(result))}</li>{reasons}"
    return (
        f'<span class="{escape(result.verdict)}">{escape(result.verdict)}</span> '
        f"({percent_right(result.verdict, result.probability)} %)<ul>{reasons}</ul>"
    )


def _picture(path: Path, name: str) -> str:
    try:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError:
        return "(its picture is gone)"
    return f'<img alt="{escape(name)}" src="data:image/jpeg;base64,{data}">'
