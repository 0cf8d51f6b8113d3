"""The models that the photo may show: gathered, compared, shown, and undone in one step."""

from __future__ import annotations

from dataclasses import replace

import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.candidates import MOST_CANDIDATES, CandidateModel
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.confidence.identify import Candidate, Identification, identifying, rank
from poseviewer.fit.registration import LoadedModel
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from tests.app.state.documents import PERSPECTIVE, after, make_document, make_photo, make_session
from tests.fit.ends import ended
from tests.meshes import make_box, make_bumpy

BOX = CandidateModel(LoadedModel(make_box((1.6, 1.0, 1.2)), "box.ply", "b" * 64, None), None)
BALL = CandidateModel(LoadedModel(make_bumpy(1), "ball.ply", "c" * 64, None), None)
POSES = [
    Pose(PERSPECTIVE, RigidTransform.from_rotation_vector([turn, 0.1, 0.2], [0.1, 0.0, 7.0]))
    for turn in (0.1, 1.0, 2.0)
]


def gathered() -> Session:
    """The model at hand (m.ply), a box and a ball."""
    return after(make_session(), c.AddCandidate(BOX), c.AddCandidate(BALL))


def found(index: int, loss: float) -> Candidate:
    return Candidate(index, "", ended(POSES[index], loss))


def compared(session: Session, *losses: float) -> Session:
    """The comparison at its end, with these losses of the models in their order."""
    asked = after(session, c.Identify())
    assert asked.candidates.comparison is not None
    ranked = rank([found(index, loss) for index, loss in enumerate(losses)])
    number = asked.candidates.comparison.number
    return after(asked, c.IdentificationAdvanced(number, Identification(ranked)))


def names(session: Session) -> list[str]:
    return [row.candidate.model.name for row in session.candidates.rows(session.document)]


def test_the_model_at_hand_is_the_first_of_those_gathered():
    session = gathered()
    assert names(session) == ["m.ply", "box.ply", "ball.ply"]
    again = update(session, c.AddCandidate(BOX))
    assert again.candidates is session.candidates
    assert again.error_message.startswith("Box.ply: is among the models already")
    assert names(after(session, c.DropCandidate(1))) == ["m.ply", "ball.ply"]
    assert after(session, c.DropCandidate(7)) is session


def test_no_more_are_kept_than_fit_the_memory():
    session = make_session()
    for number in range(MOST_CANDIDATES - 1):
        model = replace(BOX.model, sha256=f"{number + 1:064d}")
        session = after(session, c.AddCandidate(CandidateModel(model, None)))
    full = update(session, c.AddCandidate(BALL))
    assert len(full.candidates.models) == MOST_CANDIDATES
    assert "30 models are the most" in full.error_message


def test_one_model_alone_is_not_compared():
    refused = update(make_session(), c.Identify())
    assert refused.candidates.comparison is None
    assert refused.error_message == "One model alone: add another one, to be told apart."


def test_the_likeliest_is_shown_and_one_step_back_leads_to_before():
    session = gathered()
    end = compared(session, 0.5, 0.2, 0.4)
    assert names(end) == ["box.ply", "ball.ply", "m.ply"]
    rows = end.candidates.rows(end.document)
    assert [row.ranked.rank for row in rows if row.ranked] == [1, 2, 3]
    margins = [row.ranked.margin for row in rows if row.ranked]
    assert margins == [pytest.approx(0.2), pytest.approx(0.1), None]
    assert end.document.pose is POSES[1]
    assert end.document.registration.mesh is BOX.model.mesh
    assert end.document.registration.mesh_name == "box.ply"
    assert end.landscapes == ()
    third = after(end, c.ShowCandidate(2))
    assert third.document.pose is POSES[2]
    assert third.document.registration.mesh is BALL.model.mesh
    first = after(third, c.ShowCandidate(0))
    assert first.document.registration.mesh is session.document.registration.mesh
    for shown in (end, third, first):
        assert after(shown, c.Undo()).document is session.document
    # What is moved by hand in between is a step of its own.
    moved = after(third, c.Nudge("move", 1.0), c.ShowCandidate(1))
    assert after(moved, c.Undo(), c.Undo()).document.pose is POSES[2]


def test_what_was_done_meanwhile_stays():
    asked = after(gathered(), c.Identify())
    assert asked.candidates.comparison is not None
    number = asked.candidates.comparison.number
    moved = after(asked, c.Nudge("move", 1.0))
    ranked = rank([found(0, 0.5), found(1, 0.2), found(2, 0.4)])
    end = after(moved, c.IdentificationAdvanced(number, Identification(ranked)))
    assert end.document is moved.document
    assert names(end)[0] == "box.ply"
    held = after(asked, c.Press(80.0, 60.0))
    assert held.drag is not None
    still = after(held, c.IdentificationAdvanced(number, Identification(ranked)))
    assert still.drag is held.drag
    assert still.document is asked.document


def test_what_a_search_found_is_kept_and_compared_from():
    searching = after(gathered(), c.StartSearch())
    assert searching.searching
    end = compared(searching, 0.5, 0.2, 0.4)
    assert end.search is None
    assert end.document.pose is POSES[1]
    assert after(end, c.Undo()).document is searching.document


def test_rows_fill_as_models_are_fitted():
    asked = after(gathered(), c.Identify())
    assert asked.candidates.comparison is not None
    number = asked.candidates.comparison.number
    latest = Identification(rank([found(0, 0.5)]), at=1)
    half = after(asked, c.IdentificationAdvanced(number, latest))
    rows = half.candidates.rows(half.document)
    assert [row.is_being_fitted for row in rows] == [False, True, False]
    assert [row.ranked is not None for row in rows] == [True, False, False]
    assert half.document is asked.document
    assert after(half, c.DropCandidate(2)) is half  # not while they are compared
    stopped = after(half, c.StopIdentifying())
    assert stopped.candidates.comparison is not None
    assert not stopped.candidates.comparison.running
    assert after(stopped, c.IdentificationAdvanced(number, Identification(()))) is stopped
    # A model that is not fitted is shown where the other one is.
    shown = after(stopped, c.ShowCandidate(2))
    assert shown.document.registration.mesh is BALL.model.mesh
    assert shown.document.pose is stopped.document.pose


def test_a_model_taken_away_leaves_the_others_ranked():
    end = after(compared(gathered(), 0.5, 0.2, 0.4), c.DropCandidate(2))
    rows = end.candidates.rows(end.document)
    assert names(end) == ["box.ply", "m.ply"]
    assert rows[0].ranked is not None
    assert rows[0].ranked.margin == pytest.approx(0.3)


def test_old_news_and_other_photos_change_nothing():
    asked = after(gathered(), c.Identify())
    assert asked.candidates.comparison is not None
    assert after(asked, c.Identify()) is asked  # one at a time
    number = asked.candidates.comparison.number
    latest = Identification(rank([found(0, 0.5)]), at=1)
    assert after(asked, c.IdentificationAdvanced(number + 1, latest)) is asked
    opened = after(asked, c.Open(make_document(photo=make_photo(1))))
    late = after(opened, c.IdentificationAdvanced(number, latest))
    assert late.candidates.comparison is None
    assert names(late) == ["m.ply", "box.ply", "ball.ply"]  # kept for the next photo


def test_failure_is_said():
    asked = after(gathered(), c.Identify())
    assert asked.candidates.comparison is not None
    failed = update(asked, c.IdentificationFailed(asked.candidates.comparison.number, "no memory"))
    assert failed.candidates.comparison is None
    assert failed.error_message == "No memory."
    assert names(failed) == names(asked)


def test_the_comparison_is_the_one_of_the_command_line():
    settings = FitSettings(limits=Limits(evaluations=60))
    session = after(make_session(settings=settings), c.AddCandidate(BOX), c.Identify())
    asked = session.candidates.comparison
    assert asked is not None
    *_, last = identifying(asked.registrations, asked.document.settings)
    end = after(session, c.IdentificationAdvanced(asked.number, last))
    best = last.ranked[0].candidate
    assert end.document.pose is best.fit.pose
    assert end.document.registration.mesh is asked.models[best.index].model.mesh
    starts = [one.start for one in asked.registrations]
    assert starts == [session.document.pose] * 2
