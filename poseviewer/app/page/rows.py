"""The list of a batch's rows in a review, and the controls of the one that is open."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import htpy as h
import numpy as np

from poseviewer.app.page.controls import Controls, as_html, jpeg_url, memoize, on_press, plain
from poseviewer.app.reviewing import Reviewer
from poseviewer.app.state.keys_and_buttons import ACTIONS
from poseviewer.app.state.session import Session
from poseviewer.app.workers.tasks import QueuedTask
from poseviewer.batch.result_folder import KEPT, REJECTED, Row, comparison_text
from poseviewer.batch.review import ReviewQueue
from poseviewer.fit.progress import Status

QUALITY = 75
"""JPEG quality of the thumbnails."""
MAX_BEFORE = 50
"""Rows in the list before the open one; all rows of a batch would be megabytes."""
MAX_AFTER = 150
"""Rows in the list after the open one."""
DOT = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"
UNDONE = {REJECTED: "rejection", KEPT: "keeping"}
"""Name of each review but an acceptance."""
TO_ROW = "let r=this.parentNode,l=r.parentNode;l.scrollTop=r.offsetTop-l.clientHeight/3"
"""Script of the row that is open: it scrolls the list, and the list alone, to that row."""


def add_rows(controls: Controls, review: Reviewer) -> None:
    """Folder "Review": the list of rows, and what is asked of the one that is open."""
    noted: list[int | None] = [None]

    def read(session: Session, of: Callable[[Row], str]) -> str:
        at = review.row_at(session.document)
        return "" if at is None else of(review.queue.rows[at])

    def key(session: Session) -> tuple[object, ...]:
        at = review.row_at(session.document)
        return review.queue, None if at is None else review.queue.rows[at]

    def undo(session: Session) -> str:
        word = read(session, lambda row: row.result.review)
        return word and f"Undo {UNDONE.get(word, 'acceptance')}"

    def note_text(session: Session) -> str:
        """The note; one that is being typed stays until another row is open."""
        at = review.row_at(session.document)
        if at == noted[0]:
            return note.value
        noted[0] = at
        return read(session, lambda row: row.result.note)

    def annotate(words: str) -> QueuedTask | None:
        return None if noted[0] is None else review.annotate(noted[0], words)

    with controls.gui.add_folder("Review"):
        controls.html(memoize(key, lambda s: rows_list(review.queue, review.row_at(s.document))))
        controls.actions("Go to", "previous row", "next row")
        accept, reject = ACTIONS["accept"], ACTIONS["reject"]
        if review.queue.batch.is_audit:
            reject = replace(reject, name="Keep given")
        asked: dict[str, Any] = {own.label(): own.request for own in (accept, reject)}
        controls.choices("Pose", asked)
        controls.button(undo, review.decide(""), visible=lambda s: bool(undo(s)))
        controls.text(lambda s: read(s, lambda row: row_text(row, s.is_unsaved)))
        note = controls.gui.add_text("Note", "")
        controls.field(note, annotate, value=note_text)


def rows_list(queue: ReviewQueue, at: int | None) -> str:
    """A row for each photo with its object, and what is said of it (HTML)."""
    rows, middle = queue.rows, at or 0
    first, end = max(middle - MAX_BEFORE, 0), min(middle + MAX_AFTER, len(rows))
    drawn = [_row(queue.batch.folder, rows[i], i, i == at) for i in range(first, end)]
    rejected = sum(row.result.is_rejected for row in rows)
    no = KEPT if queue.batch.is_audit else REJECTED
    accepted = sum(row.result.is_accepted for row in rows)
    shown = "" if end - first == len(rows) else f", {first + 1} to {end} are listed"
    said = f"{len(rows)} rows, {accepted} accepted, {rejected} {no}{shown}"
    return as_html(h.div(".pv-counts")[said], h.div(".pv-rows")[drawn])


def _row(folder: Path, row: Row, index: int, is_open: bool) -> h.Element:
    result = row.result
    below = result.reason if result.failed else Path(row.job.model).stem
    word = result.review or ("failed" if result.failed else result.finding or result.verdict)
    word = word or "not searched"
    picture = DOT if result.failed else thumbnail(folder / result.picture)
    at, title = {"pv-at": is_open}, f"row {row.job.row}: {row.job.photo}"
    return h.div(on_press("row", what=index), class_=at, tabindex="0", title=title)[
        is_open and h.img(".pv-here", alt="", src=DOT, onload=TO_ROW),
        h.img(alt="", src=picture),
        h.span[Path(row.job.photo).name, h.br, h.small[below]],
        h.b(class_=f"pv-{word.split()[0]}")[word],
    ]


@lru_cache(maxsize=1000)
def _thumbnail(path: Path, changed: int) -> str:  # noqa: ARG001 - of the file
    content = np.frombuffer(path.read_bytes(), np.uint8)
    picture = np.asarray(cv2.imdecode(content, cv2.IMREAD_REDUCED_COLOR_4))
    return jpeg_url(picture, QUALITY)


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
    if result.verdict:
        lines.append(plain(f"verdict: {result.verdict}"))
    if result.given_verdict:
        lines.append(plain(f"{comparison_text(result)} R shows the given pose."))
    if result.status.startswith(Status.KEPT.value.partition(":")[0]):  # then as now
        lines.append(plain(result.reasons.split("\n")[0]))
    return "  \n".join(lines)
