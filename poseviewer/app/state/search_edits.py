"""Edits of searches: settings, start, end, and workers' reports."""

from collections.abc import Callable
from dataclasses import replace

from poseviewer.app.state.document import UNLOCK, Document, is_shown, label_of, verdict_of
from poseviewer.app.state.document_edits import undo
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.frame_keys import store_changed_poses
from poseviewer.app.state.marking import MARKING
from poseviewer.app.state.results import Preparation
from poseviewer.app.state.searches import LossComparison, SearchRequest
from poseviewer.app.state.session import Session, is_in_sight
from poseviewer.errors import SettingsError
from poseviewer.fit.progress import SearchProgress
from poseviewer.losses.known_losses import LOSSES
from poseviewer.losses.loss import LossName
from poseviewer.scene.settings import FitSettings


@edit
def alter_settings(session: Session, alter: Callable[[FitSettings], FitSettings]) -> Session:
    """Alter the settings; a function, so that edits in a row do not undo each other."""
    settings = alter(session.document.settings)
    if settings == session.document.settings:
        return session
    return session.with_document(session.document.with_object(settings=settings))


@edit
def clear_region(session: Session) -> Session:
    """Compare the active object with the whole photo."""
    return session.with_document(session.document.with_in_view(region=None))


@edit
def set_loss(session: Session, loss: LossName) -> Session:
    """Choose the loss; the one before keeps its settings until it is chosen again."""
    before = session.document.settings
    if loss == before.loss:
        return session
    document = session.document.with_object(settings=session.settings_by(loss))
    return session.with_document(document).keeping(before)


@edit
def start_search(session: Session) -> Session:
    """Search for the active object from the current pose."""
    document = session.document
    return _begin_search(session, document, (document.settings,), (document.active,))


@edit
def find_focal_length(session: Session) -> Session:
    """Search once for the active object's pose and the focal length; the settings stay."""
    document = session.document
    settings = replace(document.settings, free_focal=True)
    return _begin_search(session, document, (settings,), (document.active,))


@edit
def search_all(session: Session) -> Session:
    """Search for all unlocked objects in turn, until none improves."""
    document = session.document
    objects = enumerate(document.scene.objects)
    free = {i: item for i, item in objects if is_shown(item) and not item.locked}
    if not free:
        raise SettingsError("all objects are locked, hidden or not placed: nothing to search")
    if len(free) > 1 and any(item.settings.has_free_camera for item in free.values()):
        raise SettingsError(
            "focal length and principal point are one for all objects: search for one of the "
            "objects alone, then untick them (Fit, Settings) and search all"
        )
    return _begin_search(session, document, (document.settings,), tuple(free))


@edit
def compare_losses(session: Session) -> Session:
    """Search from the start pose by each loss, the chosen one last."""
    document = session.document
    losses = sorted(LOSSES, key=lambda loss: loss == document.settings.loss)
    settings = tuple(map(session.settings_by, losses))
    return _begin_search(session, document.at_start, settings, (document.active,))


def _begin_search(
    session: Session, start: Document, methods: tuple[FitSettings, ...], indices: tuple[int, ...]
) -> Session:
    """Begin a search, unless one is running."""
    if session.is_searching:
        return session
    if session.preparation is not None and session.preparation.trouble:
        raise SettingsError(session.preparation.trouble)
    session, document = session.stop_proposing().stop_propagating(), session.document
    if document.object.locked and indices == (document.active,):
        raise SettingsError(f"{label_of(document.object)} is locked: {UNLOCK} to search")
    session = with_search(session, SearchRequest(start, methods, indices))
    return replace(session, history=session.history.with_step(document), drag=None)


@edit
def take_end(session: Session, index: int) -> Session:
    """Take the end by one loss of the last comparison, as if only that search had run."""
    comparison, before = session.comparison, session.document
    if comparison is None or not 0 <= index < len(comparison.ends):
        return session
    end = comparison.ends[index]
    session = session.with_document(with_progress(before, end).with_object(settings=end.settings))
    if end.settings.loss != before.settings.loss:
        session = session.keeping(before.settings)
    request = SearchRequest(before.at_start, (end.settings,), (before.active,))
    return with_search(session, request, end)


@edit
def stop_search(session: Session) -> Session:
    """Stop the search and keep its best pose; a search without progress is taken back."""
    progress, request = session.search_progress, session.search
    if request is None or not session.is_searching:
        return session
    if progress is None:
        return revert_search()(session)
    document = store_changed_poses(request.start, session.document)
    return replace(session, document=document, search_progress=replace(progress, is_over=True))


@edit
def toggle_search(session: Session) -> Session:
    """Start a search, or stop the running one."""
    return (stop_search() if session.is_searching else start_search())(session)


@edit
def accept_search(session: Session) -> Session:
    """Keep the pose that the search found, and close the search and the proposals."""
    return session.without_search(session.document.scene).with_proposals(None)


@edit
def revert_search(session: Session) -> Session:
    """Go back to the pose before the search, and stop it if it runs."""
    return session if session.search is None else undo()(session)


@drag_edit
def search_advanced(
    session: Session,
    request: SearchRequest,
    progress: SearchProgress,
    comparison: LossComparison | None = None,
) -> Session:
    """Show the progress of a search.

    Args:
        session: before the edit.
        request: of the search; nothing changes if it is not the running one.
        progress: the newest.
        comparison: of the ends by several losses, once all are there.
    """
    if session.search is not request or not session.is_searching:
        return session
    document = with_progress(session.document, progress)
    document = store_changed_poses(request.start, document) if progress.is_over else document
    comparison = comparison or session.comparison
    session = replace(session, document=document, search_progress=progress, comparison=comparison)
    return _with_others_searched(session) if progress.is_over else session


def _with_others_searched(session: Session) -> Session:
    """Search for objects that lack a result by the focal length that was found for another one, if
    that was asked for once.
    """
    document, progress = session.document, session.search_progress
    is_once = progress and progress.settings.free_focal and not document.settings.free_focal
    objects = enumerate(document.scene.objects)
    others = tuple(
        i for i, item in objects if is_shown(item) and not item.locked and item.result is None
    )
    if not (is_once and others and verdict_of(document.object) != "lost"):
        return session
    return with_search(session, SearchRequest(document, (document.settings,), others))


def with_progress(document: Document, progress: SearchProgress) -> Document:
    """The document at the poses and results of a search."""
    results = progress.results
    for index, fit in progress.progress_by_object.items():
        document = document.at_params(fit.problem, fit.parameters, index)
        document = document.with_object(index, result=results[index])
    if is_in_sight(document):
        return document
    return document.with_view(progress.problem.views[0].view_index)


def with_search(
    session: Session, request: SearchRequest, progress: SearchProgress | None = None
) -> Session:
    """The session with a search, which has the ``progress`` or is about to begin."""
    anchor, is_marking = request.start.scene, session.tool in MARKING
    session = replace(session, tool="pose") if is_marking else session
    return replace(session, search=request, search_progress=progress, anchor=anchor)


@drag_edit
def search_failed(session: Session, request: SearchRequest) -> Session:
    """Take back a search that could not run."""
    return revert_search()(session) if session.search is request else session


@drag_edit
def preparation_advanced(session: Session, preparation: Preparation | None) -> Session:
    """Show the state of preparation; None: all is ready."""
    if preparation is not None and preparation.trouble:
        session = revert_search()(session) if session.is_searching else session
        session = session.with_proposals(None)
    return replace(session, preparation=preparation)
