"""Start poses that are proposed: asked for, stepped through, taken."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from poseviewer.app.state import commands as c
from poseviewer.app.state.checks import require_in_sight, sentence
from poseviewer.app.state.document import Document
from poseviewer.app.state.session import Proposals, Session
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.starts.automatic import StartQuery

LEAST_SIDE = 2
"""px: a smaller rectangle is none."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxDrag:
    """A rectangle about the object that is being drawn on the photo."""

    start: FloatArray

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The rectangle between two corners, cut to the photo."""
        box = rectangle_between(document, self.start, point)
        return replace(document, marks=replace(document.marks, box=box))


def rectangle_between(document: Document, one: FloatArray, other: FloatArray) -> Rectangle | None:
    """Left, top, width, height in px, cut to the photo; None where it is smaller than 2 px."""
    photo = document.registration.photo
    low, high = np.sort(np.clip([one, other], 0, [photo.width, photo.height]), axis=0)
    left, top = (int(v) for v in np.floor(low))
    right, bottom = (int(v) for v in np.ceil(high))
    small = min(right - left, bottom - top) < LEAST_SIDE
    return None if small else Rectangle.from_corners(left, top, right, bottom)


def wanted_of(document: Document) -> StartQuery:
    """What the proposals are looked for, with the camera at hand."""
    registration = document.registration
    box = document.marks.box or document.settings.region
    return StartQuery(
        registration.photo,
        registration.mesh,
        registration.keypoints,
        document.pose.camera,
        None if box is None else Rectangle(*box),
        document.settings,
    )


def propose_starts(session: Session, command: c.ProposeStarts) -> Session:
    """Ask for proposals, unless they are being looked for."""
    del command
    if session.proposals is not None and session.proposals.running:
        return session
    number = session.proposals_asked + 1
    tool = "pose" if session.tool == "box" else session.tool
    asked = Proposals(number, session.document)
    return replace(session, proposals_asked=number, proposals=asked, tool=tool)


def starts_proposed(session: Session, command: c.StartsProposed) -> Session:
    """The proposals are there: the first is shown."""
    asked = session.proposals
    if asked is None or asked.number != command.number or not asked.running:
        return session
    if not asked.is_about(session.document):  # another photo or model by now
        return replace(session, proposals=None)
    return _showing(session, replace(asked, running=False, poses=command.poses), 0)


def proposing_failed(session: Session, command: c.ProposingFailed) -> Session:
    """There are none, and why."""
    asked = session.proposals
    if asked is None or asked.number != command.number:
        return session
    return replace(session, proposals=None, error_message=sentence(command.reason))


def step_proposals(session: Session, command: c.StepProposals) -> Session:
    """The next proposal, or the one before; round and round."""
    asked = session.proposals
    if asked is None or not asked.poses or not asked.is_about(session.document):
        return session
    return _showing(session, asked, (asked.index + command.by) % len(asked.poses))


def take_proposal(session: Session, command: c.TakeProposal) -> Session:
    """The proposal that is shown becomes the start pose; the others are put away."""
    del command
    asked = session.proposals
    if asked is None or not asked.poses:
        return session
    pose = asked.poses[asked.index]
    taken = _with(session, session.document.started_from(pose), _is_shown(session, asked))
    return replace(taken, proposals=None)


def _showing(session: Session, asked: Proposals, index: int) -> Session:
    document = replace(session.document, pose=asked.poses[index])
    shown = _with(session, document, _is_shown(session, asked))
    return replace(shown, proposals=replace(asked, index=index))


def _is_shown(session: Session, asked: Proposals) -> bool:
    """Whether the pose at hand is a proposal as it came: then one step back leads to before all
    of them.
    """
    return any(session.document.pose is pose for pose in asked.poses)


def _with(session: Session, document: Document, same_step: bool) -> Session:
    """Another document; one undoable step, unless it is the ``same_step`` as the one before."""
    require_in_sight(document)
    history = session.history if same_step else session.history.with_step(session.document)
    anchor: Pose = document.pose
    return replace(session, document=document, history=history, anchor=anchor, search=None)


HANDLERS = {
    c.ProposeStarts: propose_starts,
    c.StartsProposed: starts_proposed,
    c.ProposingFailed: proposing_failed,
    c.StepProposals: step_proposals,
    c.TakeProposal: take_proposal,
}
