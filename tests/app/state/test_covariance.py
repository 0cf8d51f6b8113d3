"""How sure a searched pose is, in the session."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.page.result import deviations_of, result_html
from poseviewer.app.page.texts import ASSUMED_HINT, USUAL_HINT, hint_of, verdict_text
from poseviewer.app.state.objects import show_view
from poseviewer.app.state.pose_edits import nudge, pose_numbers
from poseviewer.app.state.session import Session
from poseviewer.confidence.pose_covariance import PoseCovariance, short
from poseviewer.confidence.verdict import Verdict
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.scene.types import SearchResult
from tests.app.state.documents import after, make_document
from tests.app.state.sets import make_set_session
from tests.view_sets import MESH


@pytest.fixture
def session() -> Session:
    """A pose that a search has ended in."""
    document = make_document()
    mesh, pose = document.mesh, document.pose
    sure = PoseCovariance.from_chart(
        mesh, pose, FreeBodyChart.near(mesh, pose), np.diag([1, 2, 3, 4, 5, 600]) * 1e-6
    )
    result = SearchResult(
        verdict=Verdict("found", 0.97), loss=0.1, unexplained=0.1, covariance=sure
    )
    return Session(document.with_object(result=result))


def test_the_verdict_says_how_sure_the_pose_is(session: Session) -> None:
    sure = session.covariance_in(0)
    assert sure is not None
    rest = sure.words(without=("depth", "sideways"))
    assert "line of sight" not in rest
    assert "cameras" not in result_html(session)
    said, numbers = verdict_text(session), deviations_of(session)
    axes = ", ".join(f"{name} ±{short(numbers[name])} units" for name in "XYZ")
    assert f"How sure, if right:** {axes}, {rest}" in said
    moved = after(session, nudge("move", 1.0))
    assert moved.covariance_in(0) is None
    assert verdict_text(moved) == ""


def test_all_deviations_are_said_to_rest_on_an_assumed_focal_length(session: Session) -> None:
    camera = session.document.photo.default_camera()
    pose = replace(session.document.pose, camera=camera)
    sure, result = session.covariance_in(0), session.document.object.result
    assert sure is not None
    assert result is not None
    known = replace(result, covariance=replace(sure, pose=pose))
    assumed = Session(session.document.at_pose(pose).with_object(result=known))
    for now, is_assumed in ((session, False), (assumed, True)):
        number = f"{pose_numbers(now.document.pose)['focal']:,.0f} px is right"
        assert (f"if right, and if the assumed focal length of {number}" in verdict_text(now)) == (
            is_assumed
        )
        assert (f"all ± hold if {number}" in result_html(now)) == is_assumed
        assert (hint_of(now) == ASSUMED_HINT) == is_assumed
    assert hint_of(replace(assumed, saved=assumed.document)) == USUAL_HINT


def test_another_view_turns_and_shifts_it() -> None:
    """As the covariance there, of poses that are moved in the view that it is known in."""
    session = make_set_session(free_scale=True)
    document, views = session.document, session.document.scene.views
    place = document.object.world_from_model
    chart, here = document.chart, np.diag([1, 2, 3, 4, 5, 6, 7]) * 1e-4
    plain = PoseCovariance(document.pose, MESH.centre, here, seventh="log_size")
    sure = plain.with_matrix(here, MESH)
    result = SearchResult(
        verdict=Verdict("found", 0.97), loss=0.1, unexplained=0.1, covariance=sure
    )
    session = Session(document.with_object(result=result))
    there = after(session, show_view(1))
    sure = there.covariance_in(1)
    assert sure is not None
    assert sure.px > 0.0
    assert "± hold if the cameras are right" in result_html(there)
    random = np.random.default_rng(0)
    moved = []
    for deviation in random.multivariate_normal(np.zeros(7), here, 400):
        pose = plain.pose_at(deviation)
        scale = place.scale * np.exp(deviation[6])
        other = document.at_pose(pose, scale=scale).scene.pose(0, 1)
        moved.append([*sure.deviation(other)[:6], deviation[6]])
    found = np.cov(np.array(moved).T)
    np.testing.assert_allclose(np.diag(found), np.diag(sure.matrix), rtol=0.35)
    assert views[1].photo is there.document.photo
    assert chart.names[-1] == "log_size"
