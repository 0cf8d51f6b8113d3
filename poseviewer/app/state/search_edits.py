"""Edits of searches and proposed starts: settings, start, end, and workers' reports."""

from collections.abc import Callable
from dataclasses import replace

from poseviewer.app.state.document import (
    MARKING,
    UNLOCK,
    Document,
    is_shown,
    label_of,
    loss_inputs,
    verdict_of,
)
from poseviewer.app.state.dragging import move_to
from poseviewer.app.state.edits import drag_edit, edit, undo
from poseviewer.app.state.history import store_changed_poses
from poseviewer.app.state.results import (
    LossComparison,
    Preparation,
    PropagationProgress,
    PropagationRequest,
    ProposedStarts,
    SearchRequest,
)
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
    """Search for the active object from the current pose; look for it if it has none."""
    document = session.document
    if not document.object.is_placed and session.proposals is None:
        return session.with_first_proposals
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
    if not document.object.is_placed and indices == (document.active,):
        raise SettingsError(
            f"the model {label_of(document.object)} is not placed: press a proposal, or the photo "
            "where the object is, or draw a box about it"
        )
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
    """Start a search, or stop the running one, or the propagation that runs."""
    if session.is_propagating:
        return session.stop_propagating()
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
    if not progress.is_over:
        return session
    session = _with_others_searched(session)
    return session if session.is_searching else _with_mending(session, request)


def _with_mending(session: Session, request: SearchRequest) -> Session:
    """Begin to mend the frames beside the one that was searched, by the objects that were found
    there and have propagated poses beside it. It belongs to the search's undo step.
    """
    scene, before = session.document.scene, request.start.scene
    at, has_new_camera = scene.frame_index, scene.views[0].camera != before.views[0].camera
    beside = [frame.poses for frame in scene.frames[max(at - 1, 0) : at + 2]]
    found = tuple(
        index
        for index in request.object_indices
        if verdict_of(item := scene.objects[index]) != "lost"
        and any(item.id in poses and poses[item.id].source == "propagated" for poses in beside)
    )
    if not found or has_new_camera or len(request.methods) > 1:
        return session
    mending = PropagationRequest(session.document, found, key=at)
    return replace(session, propagation=PropagationProgress(mending, follows=False))


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
    view_index = progress.problem.views[0].view_index
    document = document.placed_as_in(progress.best, progress.progress_by_object, view_index)
    return document if is_in_sight(document) else document.with_view(view_index)


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


@edit
def propose_starts(session: Session) -> Session:
    """Propose start poses, within the box about the object if there is one; or stop."""
    if session.is_proposing:
        return session.stop_proposing()
    tool = "pose" if session.tool == "box" else session.tool
    return replace(session.with_proposals(ProposedStarts(session.document)), tool=tool)


@edit
def toggle_box(session: Session) -> Session:
    """Draw a box about the object, to propose start poses there; or stop."""
    is_stopped = session.is_proposing and not session.is_looking
    return session.stop_proposing() if is_stopped else replace(session, tool="box")


@edit
def stop_proposing(session: Session) -> Session:
    """Stop proposing start poses."""
    return session.stop_proposing()


@drag_edit
def list_starts(session: Session, proposals: ProposedStarts) -> Session:
    """List the starts that were requested, and take the likeliest for a placed model."""
    requested = session.proposals
    if requested is None or requested.document is not proposals.document or requested.starts:
        return session
    session = session.with_proposals(replace(proposals, is_over=not proposals.starts))
    return take_start(0)(session) if session.document.object.is_placed else session


@drag_edit
def take_fitted_start(
    session: Session,
    document: Document,
    request: SearchRequest,
    progress: SearchProgress,
    index: int,
) -> Session:
    """Place a model where a search from a proposal has found it, if the verdict is "found".

    Args:
        session: before the edit.
        document: at which starts were requested.
        request: for the search.
        progress: end of the search.
        index: of the proposal that the search went out from.
    """
    proposals, active = session.proposals, document.active
    if proposals is None or proposals.document is not document or proposals.is_over:
        return session
    result = progress.best.objects[active].result
    is_same = loss_inputs(session.document.scene, active) == loss_inputs(document.scene, active)
    if not (is_same and result and result.verdict and result.verdict.label == "found"):
        return session.stop_proposing()
    session = take_start(index)(session)
    document = store_changed_poses(session.document, with_progress(session.document, progress))
    session = replace(session, document=document)
    return with_search(session, request, progress)


@edit
def step_proposals(session: Session, by: int = 1) -> Session:
    """Take the proposal that is ``by`` entries further in the list, which is cyclic."""
    proposals = session.proposals
    if proposals is None or not proposals.starts:
        return session
    index = max(proposals.index, min(-by, 0))  # if none is taken yet: the first, or the last
    return take_start((index + by) % len(proposals.starts))(session)


@edit
def take_start(session: Session, index: int) -> Session:
    """Make a proposal the pose and the start pose."""
    proposals = session.proposals
    if proposals is None or not 0 <= index < len(proposals.starts):
        return session
    document = move_to(session.document, proposals.starts[index].pose).with_start_here
    # One key: a single undo step leads back to before all proposals.
    session = session.with_document(document, proposals.document)
    return session.with_proposals(replace(proposals, index=index, is_over=True))
