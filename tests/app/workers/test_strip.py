"""The outlines in the strip of a set's photos."""

from __future__ import annotations

from contextlib import closing
from threading import Event

import numpy as np

from poseviewer.app.state.objects import add_object
from poseviewer.app.state.session import Outlines, Session
from poseviewer.app.workers.outlines import outlining
from tests.app.state.documents import after
from tests.app.state.sets import make_set_session
from tests.view_sets import MESH, TRUTH


def drawn_in(session: Session) -> Outlines:
    """The objects in all photos, as the worker draws it."""
    drawn = Event()
    with closing(outlining(drawn.set)) as worker:
        worker.follow(session)
        while drawn.wait(60.0):
            drawn.clear()
            for edit in worker.take():
                drawn_session = edit(session)
                assert drawn_session.outlines is not None
                return drawn_session.outlines
    raise AssertionError("nothing was drawn")


def test_all_objects_are_drawn_in_all_photos():
    session = after(make_set_session(), add_object())
    for pose, drawn in zip(TRUTH, drawn_in(session).small, strict=True):
        assert set(drawn) == {1, 2}
        assert len(drawn[2])
        lines = drawn[1]
        seen = pose.project(MESH.vertices) / np.array([pose.camera.width, pose.camera.height])
        np.testing.assert_allclose(lines.min((0, 1)), seen.min(axis=0), atol=0.02)
        np.testing.assert_allclose(lines.max((0, 1)), seen.max(axis=0), atol=0.02)
