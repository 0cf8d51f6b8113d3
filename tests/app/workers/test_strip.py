"""The outlines in the strip of a set's photos."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import SearchEnd
from poseviewer.app.state.session import SWING_S, Session, Strip
from poseviewer.app.workers.outlines import StripWorker
from poseviewer.files.pose import PoseRecord
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.pose_covariance import PoseCovariance
from poseviewer.geometry.view_chart import ViewChart
from tests.app.state.documents import after
from tests.app.state.sets import SCALE, make_set_session
from tests.view_sets import CAMERA, MESH, TRUTH

WEAK = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.04])
"""The one way in which the pose is unsure: half a unit farther and 4 % larger."""


def strip_of(session: Session, swung: Pose | None) -> Strip:
    """The model in all photos, as the worker draws it."""
    drawn = Event()
    with closing(StripWorker("strip", drawn.set)) as worker:
        worker.start(session, swung)
        while drawn.wait(60.0):
            drawn.clear()
            for update in worker.take():
                return update.strip
    raise AssertionError("nothing was drawn")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_size_swings_along_in_all_photos(sign: float):
    session = make_set_session(free_size=True)
    sure = PoseCovariance(TRUTH[0], MESH.centre, np.outer(WEAK, WEAK), seventh="log_size")
    ends = tuple(SearchEnd(PoseRecord(pose, covariance=sure), alone="found") for pose in TRUTH)
    found = replace(session, document=session.document.found_in_set(ends, SCALE))
    swinging = after(found, c.ChangeView(swings=True))
    swung = swinging.swung_pose(sign * SWING_S / 4.0)  # at an end of its way
    assert swung is not None
    share = sure.deviation(swung)[5] / WEAK[5]
    assert abs(share) == pytest.approx(sure.reach, rel=0.2)
    charts = [
        ViewChart(FreeBodyChart.near(MESH, TRUTH[0]), CAMERA, turn, True, SCALE)
        for turn in (
            pose.camera_from_model @ TRUTH[0].camera_from_model.inverse() for pose in TRUTH
        )
    ]
    numbers = charts[0].numbers_at(swung, SCALE * np.exp(-share * WEAK[6]))
    strip, before = strip_of(swinging, swung), strip_of(swinging, None)
    for index, pose in enumerate(strip.poses):
        wanted = charts[index].to_pose(numbers)
        np.testing.assert_allclose(
            pose.project(MESH.vertices), wanted.project(MESH.vertices), atol=1e-6
        )
        assert not np.array_equal(strip.lines[index], before.lines[index])
