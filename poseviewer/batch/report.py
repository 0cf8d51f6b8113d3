"""The results of a batch as one HTML page: pictures inside, no script, nothing from elsewhere."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from poseviewer.batch.results import REPORT, JobResult, distrust, worst_first
from poseviewer.errors import BatchError
from poseviewer.files.writing import write_whole

_STYLE = """
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif; }
body { margin: 2rem auto; max-width: 72rem; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; }
th, td { border-bottom: 1px solid #8884; padding: .5rem; text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
img { display: block; max-width: 20rem; max-height: 14rem; }
.failed { color: #c62828; }
"""
_HEAD = "<tr><th>pose</th><th>row</th><th>files</th><th>loss / start</th><th>outcome</th></tr>"


def save_report(folder: Path, results: Sequence[JobResult]) -> None:
    """Write ``report.html``: all rows, the least to be trusted first.

    Raises:
        BatchError: it cannot be written.
    """
    write_whole(folder / REPORT, report_html(folder, results).encode(), BatchError)


def report_html(folder: Path, results: Sequence[JobResult]) -> str:
    """The page; pictures are read from ``folder``, and left out where they are gone."""
    failed = sum(result.failed for result in results)
    rows = "\n".join(_row(folder, result) for result in worst_first(results))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>poseviewer batch</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{len(results)} photos</h1>\n<p>{len(results) - failed} fitted, {failed} failed. "
        "Worst first: those that failed, then by what is left of the loss at the start.</p>\n"
        f"<table><thead>{_HEAD}</thead><tbody>\n{rows}\n</tbody></table></body></html>\n"
    )


def _row(folder: Path, result: JobResult) -> str:
    files = "<br>".join(escape(name) for name in (result.photo, result.model, result.start))
    if result.failed:
        picture, losses = "", ""
        outcome = f'<span class="failed">{escape(result.reason)}</span>'
    else:
        picture = _picture(folder, result)
        losses = f"{result.loss:.4f} / {result.start_loss:.4f}<br>{distrust(result):.0%}"
        outcome = (
            f"{escape(result.status)}<br>{result.evaluations:,} evaluations, "
            f"{result.seconds:.1f} s<br>{escape(result.pose)}"
        )
    return (
        f'<tr><td>{picture}</td><td class="number">{result.row}</td><td>{files}</td>'
        f'<td class="number">{losses}</td><td>{outcome}</td></tr>'
    )


def _picture(folder: Path, result: JobResult) -> str:
    try:
        data = base64.b64encode((folder / result.picture).read_bytes()).decode("ascii")
    except OSError:
        return "(its picture is gone)"
    return f'<img alt="{escape(result.photo)}" src="data:image/jpeg;base64,{data}">'
