"""Proposed starts: asked for, stepped through, taken, and undone in one step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from tests.app.state.documents import (
    PERSPECTIVE,
    after,
    assert_same_pose,
    make_document,
    make_photo,
    make_session,
)

POSES = tuple(
    Pose(PERSPECTIVE, RigidTransform.from_rotation_vector([turn, 0.1, 0.2], [0.1, 0.0, 7.0]))
    for turn in (0.1, 1.0, 2.0)
)


def proposed(session: Session) -> Session:
    asked = after(session, c.ProposeStarts())
    assert asked.proposals is not None
    return after(asked, c.StartsProposed(asked.proposals.number, POSES))


def test_a_box_is_drawn_once_and_undone():
    drawn = after(make_session(), c.SetTool("box"), c.Press(20, 15), c.DragTo(90, 300), c.Release())
    assert drawn.document.marks.box == (20, 15, 70, 105)  # cut to the photo of 160 x 120
    assert drawn.tool == "pose"
    assert drawn.proposals is not None  # they are looked for at once
    assert drawn.proposals.running
    assert drawn.proposals.query.rectangle == (20, 15, 70, 105)
    assert drawn.document.own.region is None
    seen = drawn.document.pose.project(drawn.document.mesh.vertices)
    assert np.all((seen > [19, 14]) & (seen < [91, 121]))  # and the model is there already
    assert np.max(np.ptp(seen, axis=0) / [70, 105]) == pytest.approx(1.0, rel=0.01)
    for ending in (c.StopProposing(), c.CancelDrag()):
        assert after(drawn, ending).proposals is None
    assert after(drawn, c.Undo()).document is drawn.history.past[0]
    assert after(drawn, c.Undo()).document.marks.box is None


def test_a_press_puts_a_model_that_is_nowhere_yet():
    document = make_document()
    guessed = document.with_object(is_placed=False)
    session = after(Session(guessed), c.Press(5.0, 6.0), c.Release())
    centre = document.mesh.centre
    assert session.document.pose.project(centre) == pytest.approx([5.0, 6.0])
    assert after(session, c.Undo()).document is guessed
    for placed in (session, Session(document)):  # it is somewhere: a press beside it does nothing
        assert after(placed, c.Press(155.0, 115.0), c.Release()).document is placed.document


def test_proposals_are_stepped_through_in_one_step_of_the_history():
    session = make_session()
    first = proposed(session)
    assert_same_pose(first.document.pose, POSES[0])
    second = after(first, c.StepProposals(1))
    assert_same_pose(second.document.pose, POSES[1])
    assert_same_pose(after(first, c.StepProposals(-1)).document.pose, POSES[2])
    assert after(second, c.Undo()).document is session.document
    # What is moved by hand is a step of its own, and the proposals stay at hand.
    moved = after(second, c.Nudge("move", 1.0), c.StepProposals(1))
    assert_same_pose(moved.document.pose, POSES[2])
    assert_same_pose(after(moved, c.Undo(), c.Undo()).document.pose, POSES[1])


def test_the_box_is_seen_while_starts_are_taken_from_it():
    drawn = after(make_session(), c.SetTool("box"), c.Press(20, 15), c.DragTo(90, 110))
    box = drawn.document.marks.box
    assert box is not None
    assert drawn.shown_box == box
    released = after(drawn, c.Release())
    assert released.shown_box == box
    assert after(released, c.StopProposing()).shown_box is None
    assert released.proposals is not None
    found = after(released, c.StartsProposed(released.proposals.number, POSES))
    assert found.shown_box == box
    searching = after(found, c.StartSearch())
    assert searching.shown_box is None
    assert after(searching, c.StopSearch(), c.RevertSearch()).shown_box == box  # another proposal?
    kept = after(searching, c.StopSearch(), c.AcceptSearch())
    assert kept.shown_box is kept.proposals is None
    assert kept.document.marks.box == box


def test_the_one_taken_becomes_the_start():
    session = make_session()
    taken = after(proposed(session), c.StepProposals(1), c.TakeProposal())
    assert_same_pose(taken.document.start, POSES[1])
    assert taken.proposals is None
    assert after(taken, c.StepProposals(1)).document is taken.document
    assert after(taken, c.Undo()).document is session.document


def test_old_news_and_other_photos_change_nothing():
    session = after(make_session(), c.ProposeStarts())
    assert session.proposals is not None
    assert after(session, c.ProposeStarts()) is session  # one at a time
    number = session.proposals.number
    assert after(session, c.StartsProposed(number + 1, POSES)) is session
    other = make_document(photo=make_photo(1))
    opened = after(session, c.Open(other), c.StartsProposed(number, POSES))
    assert opened.document is other
    assert opened.proposals is None


@pytest.mark.parametrize("poses", [(), POSES])
def test_failure_is_said(poses):
    session = after(make_session(), c.ProposeStarts())
    asked = session.proposals
    assert asked is not None
    session = replace(session, proposals=replace(asked, poses=poses))
    failed = update(session, c.ProposingFailed(asked.number, "no view fits"))
    assert failed.proposals is None
    assert failed.error_message == "No view fits."
