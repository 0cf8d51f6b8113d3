"""Edits of the whole document: undo, redo, and another one."""

from dataclasses import replace

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import edit
from poseviewer.app.state.history import History
from poseviewer.app.state.session import Session


@edit
def undo(session: Session) -> Session:
    """Undo one step; a search is one."""
    return session.with_history(*session.history.undo(session.document))


@edit
def redo(session: Session) -> Session:
    """Redo one step."""
    return session.with_history(*session.history.redo(session.document))


@edit
def open_document(
    session: Session,
    document: Document,
    unsaved: bool = False,
    is_first: bool = False,
    looks: bool = True,
) -> Session:
    """Open another photo, model or both.

    Args:
        session: before the edit.
        document: the opened one.
        unsaved: its pose is in no file; starts are not proposed.
        is_first: undo does not lead back before it.
        looks: starts are proposed for a model without a pose.
    """
    document = document.with_renderer(session.document.settings.renderer)
    session = session.with_document(document)
    session = session.with_first_proposals if looks and not unsaved else session
    history = History() if is_first else session.history
    saved = None if unsaved else document
    return replace(session, history=history, drag=None, tool="pose", saved=saved)
