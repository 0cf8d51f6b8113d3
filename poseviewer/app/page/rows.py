"""The list of a batch's rows in a review, and the controls of the one that is open."""

from __future__ import annotations

import base64
from functools import lru_cache
from html import escape
from pathlib import Path

import cv2
import numpy as np

from poseviewer.app.page.controls import Controls, on_press, plain, set_properties
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state.session import Session
from poseviewer.app.workers.tasks import Task
from poseviewer.batch.results import REJECTED, Row
from poseviewer.batch.review import ReviewQueue
from poseviewer.fit.progress import Status

QUALITY = 75
"""JPEG quality of the thumbnails."""
MOST_BEFORE, MOST_AFTER = 50, 150
"""Rows in the list about the one that is open; all of a batch would be megabytes."""
DOT = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"
TO_ROW = "let r=this.parentNode,l=r.parentNode;l.scrollTop=r.offsetTop-l.clientHeight/3"
"""Script of the row that is open: it scrolls the list, and the list alone, to that row."""


class RowsPanel:
    """Folder "Review"."""

    def __init__(self, controls: Controls, review: Reviewer) -> None:
        self._review = review
        self._shown: object = None
        self._at: int | None = None
        with controls.gui.add_folder("Review"):
            self._list = controls.gui.add_html("")
            controls.choices("Go to", {"Previous (P)": review.step(-1), "Next (N)": review.step(1)})
            verdicts = {
                "Accept (A)": review.decide("accepted"),
                "Reject (X)": review.decide("rejected"),
            }
            controls.choices("Pose", verdicts)
            self._undo = controls.button("Undo acceptance", review.decide(""), visible=False)
            self._text = controls.gui.add_markdown("")
            self._note = controls.gui.add_text("Note", "")
            controls.field(self._note, self._annotate)

    def show(self, session: Session) -> None:
        """Bring list and controls to the row that is open."""
        queue, at = self._review.queue, self._review.row_at(session.document)
        if self._shown == (queue, at, session.unsaved):
            return
        self._shown = queue, at, session.unsaved
        set_properties(self._list, content=rows_list(queue, at))
        said = "" if at is None else queue.rows[at].result.review
        undo = "Undo rejection" if said == REJECTED else "Undo acceptance"
        set_properties(self._undo, label=undo, visible=bool(said))
        text = "" if at is None else row_text(queue.rows[at], session.unsaved)
        set_properties(self._text, content=text)
        # What is being typed is not written over: only another row brings another note.
        if at != self._at:
            self._at = at
            set_properties(self._note, value="" if at is None else queue.rows[at].result.note)

    def _annotate(self, note: str) -> Task | None:
        return None if self._at is None else self._review.annotate(self._at, note)


def rows_list(queue: ReviewQueue, at: int | None) -> str:
    """A row for each photo with its object, and what is said of it (HTML)."""
    rows, middle = queue.rows, at or 0
    first, end = max(middle - MOST_BEFORE, 0), min(middle + MOST_AFTER, len(rows))
    drawn = "".join(_row(queue.batch.folder, rows[i], i, i == at) for i in range(first, end))
    rejected = sum(row.result.review == REJECTED for row in rows)
    accepted = sum(bool(row.result.review) for row in rows) - rejected
    shown = "" if end - first == len(rows) else f", {first + 1} to {end} are listed"
    said = f"{len(rows)} rows, {accepted} accepted, {rejected} rejected{shown}"
    return f'<div class="pv-counts">{said}</div><div class="pv-rows">{drawn}</div>'


def _row(folder: Path, row: Row, index: int, is_open: bool) -> str:
    result, name = row.result, escape(Path(row.job.photo).name)
    word = result.review or ("failed" if result.failed else result.verdict or "not searched")
    press = on_press("row", index=index)
    picture = DOT if result.failed else thumbnail(folder / result.picture)
    here = f' class="pv-at"><img class="pv-here" alt="" src="{DOT}" onload="{TO_ROW}"'
    return (
        f'<div tabindex="0" title="row {row.job.row}: {escape(row.job.photo)}" '
        f"{press}"
        f'{here if is_open else ""}><img alt="" src="{picture}">'
        f"<span>{name}<br><small>{escape(Path(row.job.model).stem)}</small></span>"
        f'<b class="pv-{word.split()[0]}">{escape(word)}</b></div>'
    )


@lru_cache(maxsize=1000)
def _thumbnail(path: Path, changed: int) -> str:  # noqa: ARG001 - of the file
    content = np.frombuffer(path.read_bytes(), np.uint8)
    picture = np.asarray(cv2.imdecode(content, cv2.IMREAD_REDUCED_COLOR_4))
    data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"


def thumbnail(path: Path) -> str:
    """The URL of a small picture of the pose; that of a dot where there is none."""
    try:
        return _thumbnail(path, path.stat().st_mtime_ns)
    except (OSError, cv2.error):
        return DOT


def row_text(row: Row, unsaved: bool) -> str:
    """Say in Markdown what is known of the row."""
    result = row.result
    lines = [f"**row {row.job.row}**: {plain(result.review or 'not reviewed')}"]
    if unsaved:
        lines.append("● pose changed: accept it, or take it back (Z)")
    if result.failed:
        lines.append(plain(f"failed: {result.reason}"))
    elif result.start_unexplained is not None:
        share = "-" if result.unexplained is None else f"{result.unexplained:.3f}"
        lines.append(f"unexplained {share}, at the start {result.start_unexplained:.3f}")
    if result.verdict:
        lines.append(plain(f"verdict: {result.verdict}"))
    if result.status == Status.KEPT.value:
        lines.append(plain(result.reasons.split("\n")[0]))
    return "  \n".join(lines)
