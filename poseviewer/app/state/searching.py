"""A search: started, stopped, kept or taken back; and what its worker finds out."""

from __future__ import annotations

from dataclasses import replace

from poseviewer.app.state import commands as c
from poseviewer.app.state.checks import sentence
from poseviewer.app.state.session import Search, Session


def settled(session: Session) -> Session:
    """The session with its search, if one runs, stopped and accepted."""
    if session.search is None or not session.search.running:
        return session
    return replace(session, search=replace(session.search, running=False))


def start_search(session: Session, command: c.StartSearch) -> Session:
    """Search from the pose at hand, unless a search runs."""
    del command
    if session.searching:
        return session
    number, document = session.searches + 1, session.document
    return replace(
        session,
        searches=number,
        search=Search(number, document),
        look=replace(session.look, before=False),
        history=session.history.with_step(document),
        anchor=document.pose,
        drag=None,
        before_drag=None,
    )


def stop_search(session: Session, command: c.StopSearch) -> Session:
    """Stop; the best pose so far is kept."""
    del command
    return settled(session)


def accept(session: Session, command: c.AcceptSearch) -> Session:
    """Keep what was found, and close the search's books."""
    del command
    return replace(settled(session), search=None, anchor=session.document.pose)


def revert(session: Session, command: c.RevertSearch) -> Session:
    """Back to the document before the search; one that runs is stopped."""
    del command
    search = session.search
    if search is None:
        return session
    history, document = session.history.undo(session.document)
    return replace(session, search=None, history=history, document=document, anchor=document.pose)


def search_advanced(session: Session, command: c.SearchAdvanced) -> Session:
    """The best pose so far is the one at hand."""
    search = session.search
    if search is None or search.number != command.search or not search.running:
        return session
    progress = command.latest.progress
    running = progress.status.name == "RUNNING"
    document = replace(session.document, pose=progress.pose)
    found = replace(search, latest=command.latest, running=running)
    return replace(session, document=document, search=found)


def search_failed(session: Session, command: c.SearchFailed) -> Session:
    """The search could not be run: all is as before it, and why is said."""
    search = session.search
    if search is None or search.number != command.search:
        return session
    return replace(revert(session, c.RevertSearch()), error_message=sentence(command.reason))


HANDLERS = {
    c.StartSearch: start_search,
    c.StopSearch: stop_search,
    c.AcceptSearch: accept,
    c.RevertSearch: revert,
    c.SearchAdvanced: search_advanced,
    c.SearchFailed: search_failed,
}
