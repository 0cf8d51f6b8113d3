"""Edits of proposed start poses."""

from dataclasses import replace

from poseviewer.app.state.document import Document, loss_inputs
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.pose_edits import put
from poseviewer.app.state.search_edits import with_progress, with_search
from poseviewer.app.state.searches import ProposedStarts, SearchRequest
from poseviewer.app.state.session import Session
from poseviewer.fit.progress import SearchProgress
from poseviewer.geometry.arrays import FloatArray
from poseviewer.starts.automatic import PoseHypothesis


@edit
def propose_starts(session: Session) -> Session:
    """Look for start poses, in the rectangle about the object; or stop looking."""
    if session.is_proposing:
        return session.stop_proposing()
    tool = "pose" if session.tool == "box" else session.tool
    return replace(session.with_proposals(ProposedStarts(session.document)), tool=tool)


@edit
def toggle_box(session: Session) -> Session:
    """Draw a rectangle about the object, to look for start poses there; or stop looking."""
    is_requested = session.is_proposing and not session.is_looking
    return session.stop_proposing() if is_requested else replace(session, tool="box")


@edit
def stop_proposing(session: Session) -> Session:
    """Look for start poses no more."""
    return session.stop_proposing()


@drag_edit
def starts_proposed(
    session: Session,
    document: Document,
    starts: tuple[PoseHypothesis, ...],
    outlines: tuple[FloatArray, ...],
) -> Session:
    """List the starts that were requested; take the likeliest for a model that is placed."""
    proposals = session.proposals
    if proposals is None or proposals.document is not document or proposals.starts:
        return session
    proposals = replace(proposals, starts=starts, outlines=outlines, is_over=not starts)
    session = session.with_proposals(proposals)
    return take_start(0)(session) if document.object.is_placed else session


@drag_edit
def start_fitted(
    session: Session,
    document: Document,
    request: SearchRequest,
    progress: SearchProgress,
    index: int,
) -> Session:
    """Put a model that was nowhere where a search from proposal ``index`` has found it."""
    proposals, result = session.proposals, progress.results[document.active]
    if proposals is None or proposals.document is not document or proposals.is_over:
        return session
    verdict, at = result and result.verdict, document.active
    is_same = loss_inputs(session.document.scene, at) == loss_inputs(document.scene, at)
    if not (is_same and verdict and verdict.label == "found"):
        return session.stop_proposing()
    session = take_start(index)(session)
    session = replace(session, document=with_progress(session.document, progress))
    return with_search(session, request, progress)


@edit
def step_proposals(session: Session, by: int = 1) -> Session:
    """Take another proposal: ``by`` places on, round and round."""
    proposals = session.proposals
    if proposals is None or not proposals.starts:
        return session
    index = max(proposals.index, min(-by, 0))  # while none is taken: the first, or the last
    return take_start((index + by) % len(proposals.starts))(session)


@edit
def take_start(session: Session, index: int) -> Session:
    """Make a proposal the pose and the start pose."""
    proposals = session.proposals
    if proposals is None or not 0 <= index < len(proposals.starts):
        return session
    document = put(session.document, proposals.starts[index].pose).with_start_here
    # One step back leads to before all proposals.
    session = session.with_document(document, proposals.document)
    return session.with_proposals(replace(proposals, index=index, is_over=True))
