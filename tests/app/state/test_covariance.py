"""How sure a searched pose is, in the session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.page.panels import sure_text, verdict_text
from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document, SearchEnd
from poseviewer.app.state.session import Session
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
