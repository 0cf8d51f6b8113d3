from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import SearchEnd
from poseviewer.app.state.hiding import Paint, Stroke
from poseviewer.app.state.objects import AddObject, ComparePhoto, LookAt
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.files.pose import PoseRecord
from poseviewer.starts.placing import surface_point
from tests.app.state.documents import after
from tests.app.state.sets import SCALE, make_set_session, set_of
from tests.view_sets import MESH, OFF, TRUTH

STROKE = Stroke("brush", np.array([[40.0, 40.0], [60.0, 60.0]]), 8.0)


@pytest.fixture
def session() -> Session:
    return make_set_session()


def refused(session: Session, command: c.Command) -> str:
    found = update(session, command)
    assert found.document is session.document
    return found.error_message


def assert_poses_are(session: Session, wanted, atol: float = 1e-9) -> None:
    for own, its in zip(set_of(session).poses, wanted, strict=True):
        a, b = own.camera_from_model, its.camera_from_model
        np.testing.assert_allclose(a.rotation, b.rotation, atol=atol)
        np.testing.assert_allclose(a.translation, b.translation, atol=atol)


def test_a_pose_in_the_large_photo_is_one_in_all(session: Session):
    assert_poses_are(session, TRUTH)


def test_another_photo_is_large_and_back_it_is_as_it_was(session: Session):
    seen = after(session, LookAt(1))
    assert seen.document.registration.photo.name == "b.png"
    assert seen.document.pose is set_of(session).poses[1]
    assert not seen.history.past
    back = after(seen, LookAt(0))
    assert back.document.pose is session.document.pose
    assert back.document.registration.start is session.document.registration.start


def test_looking_at_another_photo_is_no_change_to_be_saved(session: Session):
    saved = after(session, c.Saved(session.document))
    assert not after(saved, LookAt(2)).unsaved
    assert after(saved, LookAt(2), c.Nudge("move", 1.0)).unsaved


def test_a_drag_in_any_photo_moves_all_and_undo_brings_all_back(session: Session):
    x, y = TRUTH[1].project(MESH.centre)
    dragged = after(session, LookAt(1), c.Press(x, y), c.DragTo(x + 20.0, y), c.Release())
    moved = set_of(dragged).poses[1].project(MESH.centre)
    np.testing.assert_allclose(moved, [x + 20.0, y], atol=1e-6)
    place = set_of(dragged).poses[0].project(MESH.centre)
    assert np.linalg.norm(place - TRUTH[0].project(MESH.centre)) > 5.0
    assert_poses_are(after(dragged, c.Undo()), TRUTH)


def test_a_pin_of_one_photo_holds_the_model_in_another(session: Session):
    x, y = TRUTH[0].project(MESH.centre)
    u, v = TRUTH[1].project(MESH.centre) + np.array([25.0, 0.0])
    pinned = after(session, c.DoublePress(x, y), LookAt(1), c.DoublePress(u, v))
    dragged = after(pinned, c.Press(u, v), c.DragTo(u, v + 15.0), c.Release())
    poses, (pin, moved) = set_of(dragged).poses, dragged.document.pins
    np.testing.assert_allclose(poses[1].project(pin), TRUTH[1].project(pin), atol=0.5)
    np.testing.assert_allclose(poses[1].project(moved), [u, v + 15.0], atol=0.5)
    turned = poses[0].project(MESH.vertices) - TRUTH[0].project(MESH.vertices)
    assert np.abs(turned).max() > 3.0


def test_masks_marks_and_regions_belong_to_their_photo(session: Session):
    painted = after(session, Paint(STROKE), LookAt(1))
    assert painted.document.registration.mask is None
    region = (10.0, 10.0, 50.0, 50.0)
    drawn = after(painted, c.AlterSettings(lambda s: replace(s, region=region)), LookAt(0))
    assert drawn.document.settings.region is None
    assert drawn.document.registration.mask is not None
    assert drawn.document.own_of_photos[1].region == region
    assert after(drawn, LookAt(1)).document.settings.region == region
    # Undo leads to where it was done.
    undone = after(drawn, c.Undo(), c.Undo())
    assert all(own.mask is None and own.region is None for own in undone.document.own_of_photos)


def test_a_photo_is_left_out_and_taken_back(session: Session):
    left = after(session, ComparePhoto(2, False))
    assert set_of(left).compared == (True, True, False)
    assert left.unsaved
    assert set_of(after(left, c.Undo())).compared == (True, True, True)
    assert "two photos" in refused(left, ComparePhoto(0, False)).lower().replace("2", "two")
    assert set_of(after(left, ComparePhoto(2, True))).compared == (True, True, True)


def test_what_a_search_said_goes_with_the_photos_that_it_compared(session: Session):
    views = set_of(session)
    ends = tuple(SearchEnd(PoseRecord(pose), alone="found") for pose in views.poses)
    found = replace(session, document=session.document.found_in_set(ends, SCALE))
    for index in range(3):
        seen = after(found, LookAt(index)).document
        assert seen.searched is ends[index]
    left = after(found, ComparePhoto(2, False))
    painted = after(found, Paint(STROKE))
    for changed in (left, painted):
        assert all(after(changed, LookAt(i)).document.searched is None for i in range(3))
    assert after(found, c.Nudge("move", 1.0)).document.searched is None


def test_the_size_is_the_seventh_number_where_the_scale_is_not_known():
    session = make_set_session(free_size=True)
    assert session.document.chart.names[-1] == "log_size"
    larger = after(session, c.SetNumber("log_size", np.log(1.1)))
    assert set_of(larger).scale == pytest.approx(SCALE / 1.1)
    assert float(larger.document.parameters[-1]) == pytest.approx(np.log(1.1))
    # The model stays where it is among the cameras, so that it is seen larger, in all photos.
    for before, now in zip(TRUTH, set_of(larger).poses, strict=True):
        np.testing.assert_allclose(now.project(MESH.centre), before.project(MESH.centre), atol=1e-6)
    assert_poses_are(after(larger, c.ResetToStart()), TRUTH)
    assert set_of(after(larger, c.ResetToStart())).scale == SCALE
    assert len(make_set_session().document.chart.names) == 6


def test_known_cameras_stay_and_objects_are_one(session: Session):
    for command in (c.SetFieldOfView(30.0), c.SetProjection("parallel")):
        assert "cameras of a set are known" in refused(session, command)
    assert "one object" in refused(session, AddObject())


def test_many_photos_of_a_set_are_one_in_the_history(session: Session):
    for step in range(12):
        session = after(session, LookAt(step % 3), c.Nudge("move", 1.0))
    assert len(session.history.past) == 12


def test_a_photo_behind_whose_camera_the_model_is_does_not_become_large(session: Session):
    views = set_of(session)
    turned = views.views.views[1].camera_from_set
    away = replace(
        views.views.views[1],
        camera_from_set=type(turned)(
            np.diag([-1.0, 1.0, -1.0]) @ turned.rotation,
            np.diag([-1.0, 1.0, -1.0]) @ turned.translation,
        ),
    )
    photos = views.views.views[0], away, views.views.views[2]
    of_set = replace(views, views=replace(views.views, views=photos), poses=(), starts=())
    session = replace(session, document=replace(session.document, views=of_set))
    assert "does not show the model" in refused(session, LookAt(1))


def is_seen_at(session: Session, point) -> bool:
    """Whether no other part of the surface is in front of it."""
    pose = session.document.pose
    found = surface_point(MESH, pose, pose.project(point))
    return found is not None and float(np.linalg.norm(found - point)) < 0.05


def test_pairs_of_one_photo_place_the_model_in_all():
    session = make_set_session(False)
    numbers = np.zeros(len(session.document.chart.names))
    numbers[:6] = OFF
    photo = session.document.registration.photo
    off = session.document.at_numbers(session.document.chart, numbers, photo)
    session = replace(session, document=off, tool="pairs")
    pose = session.document.pose
    for point in [p for p in MESH.vertices[::7] if is_seen_at(session, p)][:6]:
        found = surface_point(MESH, pose, pose.project(point))
        assert found is not None
        session = after(session, c.Press(*pose.project(point)))
        session = after(session, c.Press(*TRUTH[0].project(found)))
        pose = session.document.pose
    assert_poses_are(session, TRUTH, atol=1e-3)
