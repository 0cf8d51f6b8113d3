"""Edits of the whole document: undo, redo, and another one."""

from dataclasses import replace

from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import edit
from poseviewer.app.state.history import History
from poseviewer.app.state.session import Session


@edit
def undo(session: Session) -> Session:
    """Go one step back: of a search, to before it."""
    return session.at(*session.history.undo(session.document))


@edit
def redo(session: Session) -> Session:
    """Go one step on again."""
    return session.at(*session.history.redo(session.document))


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
        session: the session before it.
        document: what is opened.
        unsaved: its pose stands in no file, and a model without one is not looked for.
        is_first: undo does not lead back before it.
        looks: a model without a pose is looked for.
    """
    document = document.with_renderer(session.document.settings.renderer)
    opened = session.with_document(document)
    opened = opened.opened if looks and not unsaved else opened
    history = History() if is_first else opened.history
    saved = None if unsaved else document
    return replace(opened, history=history, drag=None, tool="pose", saved=saved)
