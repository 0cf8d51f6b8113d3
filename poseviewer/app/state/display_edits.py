"""Edits of what is shown; none is an undo step."""

from dataclasses import replace
from typing import Any

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import drag_edit
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError


@drag_edit
def set_fields(session: Session, part: str = "", **values: Any) -> Session:
    """Set fields of the session, or of a ``part`` of it such as ``display``."""
    if part:
        values = {part: replace(getattr(session, part), **values)}
    return replace(session, **values)


@drag_edit
def show_results(session: Session, document: Document, **values: Any) -> Session:
    """Show a worker's results, unless another photo or model has been opened since."""
    is_stale = document.shown != session.document.shown
    return session if is_stale else set_fields("results", **values)(session)


@drag_edit
def show_style(session: Session, style: str) -> Session:
    """Show the model in a look."""
    return set_fields("display", style=style, photo_alone=False)(session)


@drag_edit
def toggle_model(session: Session) -> Session:
    """Show the photo alone, or the model again."""
    return set_fields("display", photo_alone=not session.display.photo_alone)(session)


@drag_edit
def enlarge_map(session: Session, first: int, second: int) -> Session:
    """Toggle the large map of a pair of parameters."""
    pair = None if session.display.large_map == (first, second) else (first, second)
    return set_fields("display", large_map=pair)(session)


@drag_edit
def report_error(_: Session, sentence: str) -> Session:
    """Show an error's sentence; nothing changes."""
    raise SettingsError(sentence)
