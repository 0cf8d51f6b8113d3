"""The outlines in the strip of a set's photos."""

from __future__ import annotations

from contextlib import closing
from threading import Event

import numpy as np

from poseviewer.app.state.session import Session, Strip
from poseviewer.app.workers.outlines import StripWorker
from tests.app.state.sets import make_set_session
from tests.view_sets import MESH


def strip_of(session: Session) -> Strip:
    """The model in all photos, as the worker draws it."""
    drawn = Event()
    with closing(StripWorker("strip", drawn.set)) as worker:
        worker.start(session)
        while drawn.wait(60.0):
            drawn.clear()
            for update in worker.take():
                return update.strip
    raise AssertionError("nothing was drawn")


def test_the_model_is_drawn_in_all_photos():
    session = make_set_session(free_size=True)
    views = session.document.views
    assert views is not None
    strip = strip_of(session)
    assert strip.poses == views.poses
    for pose, lines in zip(strip.poses, strip.lines, strict=True):
        seen = pose.project(MESH.vertices) / np.array([pose.camera.width, pose.camera.height])
        np.testing.assert_allclose(lines.min((0, 1)), seen.min(axis=0), atol=0.02)
        np.testing.assert_allclose(lines.max((0, 1)), seen.max(axis=0), atol=0.02)
