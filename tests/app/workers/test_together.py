"""Searches of the app for some of several objects, the others where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import run_search
from poseviewer.errors import SettingsError
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.pose_error import pose_error
from poseviewer.geometry.transform import RigidTransform
from tests.app.state.documents import after, asked_of, assert_same_pose
from tests.app.state.sets import document_of
from tests.several import MESHES, STARTS, TRUTH


def among(*poses) -> Session:
    """The ball, active, and what stands in front of it."""
    document = document_of(poses, FitSettings(limits=Limits(800)))
    return after(Session(document.with_object(1, locked=True)), c.start_search())


@pytest.mark.slow
def test_the_active_one_is_searched_for_until_the_others_hide_no_more_of_it():
    # At the start the ball is as near as the box: most of that is not in front of it. Half of the
    # ball and more is where the box is, so that its depth there decides.
    place = STARTS[0].pose.camera_from_model
    near = RigidTransform(place.rotation, 0.76 * place.translation + np.array([0.2, 0.0, 0.0]))
    start = replace(STARTS[0].pose, camera_from_model=near)
    session = among(start, TRUTH[1].pose)
    asked, rounds = asked_of(session), []
    for update in run_search(asked):
        if not rounds or update.problem is not rounds[-1]:
            rounds.append(update.problem)
        session = after(session, c.search_advanced(asked, update))
    assert len(rounds) > 1  # at the start other pixels of it were hidden
    assert session.search is not None
    assert not session.search.running
    document = session.document
    assert document.object.result is not None
    before, now = (
        pose_error(MESHES[0], pose, TRUTH[0].pose).percent for pose in (start, document.pose)
    )
    assert now < 0.8 * before  # as far off as that start is, it is no more in so few evaluations
    assert_same_pose(document.scene.pose(1), TRUTH[1].pose)
    assert_same_pose(after(session, c.undo()).document.pose, start)


def test_what_stands_wholly_behind_another_is_said():
    front = TRUTH[1].pose
    place = front.camera_from_model
    far = RigidTransform(place.rotation, 3.0 * place.translation)
    session = among(replace(front, camera_from_model=far), front)
    with pytest.raises(SettingsError, match="stands wholly behind other objects"):
        list(run_search(asked_of(session)))
