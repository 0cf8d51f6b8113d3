"""Edits of searches: settings, start, end, and what workers report of them."""

from collections.abc import Callable
from dataclasses import replace

from poseviewer.app.state.document import UNLOCK, Document, is_shown, label_of
from poseviewer.app.state.document_edits import undo
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.results import Preparation
from poseviewer.app.state.searches import LossComparison, SearchRequest
from poseviewer.app.state.session import Session, is_in_sight
from poseviewer.errors import SettingsError
from poseviewer.fit.progress import SearchProgress
from poseviewer.scene.settings import LOSSES, FitSettings, LossName


@edit
def alter_settings(session: Session, alter: Callable[[FitSettings], FitSettings]) -> Session:
    """Alter settings as they are by then: what was changed just before stays changed."""
    settings = alter(session.document.settings)
    if settings == session.document.settings:
        return session
    return session.with_document(session.document.with_object(settings=settings))


@edit
def clear_region(session: Session) -> Session:
    """Compare the active object with all of the photo."""
    return session.with_document(session.document.with_own(region=None))


@edit
def set_loss(session: Session, loss: LossName) -> Session:
    """Search by another loss; what each compares is kept until it is chosen again."""
    before = session.document.settings
    if loss == before.loss:
        return session
    document = session.document.with_object(settings=session.settings_by(loss))
    return replace(session.with_document(document), other_settings=before)


@edit
def start_search(session: Session) -> Session:
    """Search for the active object from the pose at hand."""
    document = session.document
    return _begun(session, document, (document.settings,), (document.active,))


@edit
def find_focal_length(session: Session) -> Session:
    """Search for the active object's pose and the focal length together."""
    return start_search()(alter_settings(lambda now: replace(now, free_focal=True))(session))


@edit
def search_all(session: Session) -> Session:
    """Search for all objects that are not locked, in turn, until none improves."""
    document = session.document
    objects = enumerate(document.scene.objects)
    free = {i: item for i, item in objects if is_shown(item) and not item.locked}
    if not free:
        raise SettingsError("all objects are locked, hidden or not placed: nothing to search")
    if len(free) > 1 and any(item.settings.free_focal for item in free.values()):
        raise SettingsError(
            "the focal length is one for all objects: find it with one of them alone, then "
            "search all without it"
        )
    return _begun(session, document, (document.settings,), tuple(free))


@edit
def compare_losses(session: Session) -> Session:
    """Search from the start pose by both losses, by the one that is chosen last."""
    document = session.document
    losses = sorted(LOSSES, key=lambda loss: loss == document.settings.loss)
    settings = tuple(map(session.settings_by, losses))
    return _begun(session, document.at_start, settings, (document.active,))


def _begun(
    session: Session, start: Document, methods: tuple[FitSettings, ...], indices: tuple[int, ...]
) -> Session:
    """Session with a new search, unless one is running."""
    if session.is_searching:
        return session
    if session.preparation is not None and session.preparation.trouble:
        raise SettingsError(session.preparation.trouble)
    session, document = session.stop_proposing(), session.document
    if document.object.locked and indices == (document.active,):
        raise SettingsError(f"{label_of(document.object)} is locked: {UNLOCK} to search")
    session = with_search(session, SearchRequest(start, methods, indices))
    return replace(session, history=session.history.with_step(document), drag=None)


@edit
def take_end(session: Session, index: int) -> Session:
    """Go where a loss of the last comparison ended, as if it alone had been searched by."""
    comparison, before = session.comparison, session.document
    if comparison is None or not 0 <= index < len(comparison.ends):
        return session
    end = comparison.ends[index]
    taken = session.with_document(with_progress(before, end).with_object(settings=end.settings))
    if end.settings.loss != before.settings.loss:
        taken = replace(taken, other_settings=before.settings)
    request = SearchRequest(before.at_start, (end.settings,), (before.active,))
    return with_search(taken, request, end)


@edit
def stop_search(session: Session) -> Session:
    """Stop the search, keep its best pose; one that has not begun is as if never requested."""
    progress = session.search_progress
    if not session.is_searching:
        return session
    if progress is None:
        return revert_search()(session)
    return replace(session, search_progress=replace(progress, is_over=True))


@edit
def toggle_search(session: Session) -> Session:
    """Start a search, or stop the one that runs."""
    return (stop_search() if session.is_searching else start_search())(session)


@edit
def accept_search(session: Session) -> Session:
    """Keep what the search found, and put the search and the proposed starts away."""
    return session.without_search(session.document.scene).with_proposals(None)


@edit
def revert_search(session: Session) -> Session:
    """Go back to the pose before the search; one that runs is stopped."""
    return session if session.search is None else undo()(session)


@drag_edit
def search_advanced(
    session: Session,
    request: SearchRequest,
    progress: SearchProgress,
    comparison: LossComparison | None = None,
) -> Session:
    """Show how far a search is; ``comparison``: of its ends by several losses."""
    if session.search is not request or not session.is_searching:
        return session
    document = with_progress(session.document, progress)
    comparison = comparison or session.comparison
    return replace(session, document=document, search_progress=progress, comparison=comparison)


def with_progress(document: Document, progress: SearchProgress) -> Document:
    """Document where a search is, or has ended."""
    results = progress.results
    for index, fit in progress.progress_by_object.items():
        document = document.at_params(fit.problem, fit.parameters, index)
        document = document.with_object(index, result=results[index])
    is_seen = is_in_sight(document)
    return document if is_seen else document.with_view(progress.problem.views[0].view_index)


def with_search(
    session: Session, request: SearchRequest, progress: SearchProgress | None = None
) -> Session:
    """Session with a search at its begin, or as far as its ``progress`` says."""
    anchor = request.start.scene
    return replace(session, search=request, search_progress=progress, anchor=anchor)


@drag_edit
def search_failed(session: Session, request: SearchRequest) -> Session:
    """Go back to before a search that could not be run."""
    return revert_search()(session) if session.search is request else session


@drag_edit
def preparation_advanced(session: Session, preparation: Preparation | None) -> Session:
    """Show what is still made ready (None: nothing more), or why it cannot be."""
    if preparation is not None and preparation.trouble:
        session = revert_search()(session) if session.is_searching else session
        session = session.with_proposals(None)
    return replace(session, preparation=preparation)
