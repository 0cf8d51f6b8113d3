"""How sure a searched pose is, in the session: the sentence, and the outline that swings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.page.panels import sure_text, verdict_text
from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document, SearchEnd
from poseviewer.app.state.session import SWING_S, Session
from poseviewer.files.pose import PoseRecord, RecordedVerdict
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.pose_covariance import PoseCovariance
from tests.app.state.documents import after, make_document


@pytest.fixture
def session() -> Session:
    """A pose that a search has ended in."""
    document: Document = make_document()
    mesh, pose = document.registration.mesh, document.pose
    sure = PoseCovariance.from_chart(
        mesh, pose, FreeBodyChart.near(mesh, pose), np.diag([1, 2, 3, 4, 5, 600]) * 1e-6
    )
    record = PoseRecord(pose, verdict=RecordedVerdict("found", 0.97), covariance=sure)
    return Session(replace(document, end=SearchEnd(record)), anchor=pose)


def test_the_verdict_says_how_sure_the_pose_is(session: Session) -> None:
    assert session.covariance is not None
    assert session.covariance.words(session.document.registration.mesh.unit) in sure_text(session)
    assert sure_text(session) in verdict_text(session)
    moved = after(session, c.Nudge("move", 1.0))
    assert moved.covariance is None
    assert sure_text(moved) == ""


def test_the_outline_swings_through_the_region_and_back(session: Session) -> None:
    assert session.swung_pose(0.0) is None  # off by default
    swings = after(session, c.ChangeView(swings=True))
    sure = swings.covariance
    assert sure is not None
    inverse = np.linalg.inv(sure.matrix)
    reached = []
    for seconds in np.linspace(0.0, SWING_S, 9):
        pose = swings.swung_pose(float(seconds))
        assert pose is not None
        off = sure.deviation(pose)
        reached.append(float(off @ inverse @ off) ** 0.5 / sure.reach)
    np.testing.assert_allclose(reached, [0, 0.7071, 1, 0.7071, 0, 0.7071, 1, 0.7071, 0], atol=0.05)
    assert swings.shown_pose is swings.document.pose


def test_a_drag_ends_the_swing_and_a_search_holds_it(session: Session) -> None:
    swings = after(session, c.ChangeView(swings=True))
    assert after(swings, c.StartSearch()).swung_pose(1.0) is None
    x, y = swings.document.pose.project(swings.document.registration.mesh.centre)
    held = after(swings, c.Press(float(x), float(y)))
    assert held.swung_pose(1.0) is None
    dragged = after(held, c.DragTo(float(x) + 5.0, float(y)))
    assert not dragged.look.swings
    assert not after(dragged, c.CancelDrag()).look.swings
