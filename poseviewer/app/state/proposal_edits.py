"""Edits of proposed start poses."""

from dataclasses import replace

from poseviewer.app.state.document import Document, loss_inputs
from poseviewer.app.state.dragging import move_to
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.frame_keys import store_changed_poses
from poseviewer.app.state.search_edits import with_progress, with_search
from poseviewer.app.state.searches import ProposedStarts, SearchRequest
from poseviewer.app.state.session import Session
from poseviewer.fit.progress import SearchProgress


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
    result = progress.results[active]
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
