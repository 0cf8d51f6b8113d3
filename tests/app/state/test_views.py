from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state.document import Document, reference_view
from poseviewer.app.state.hiding import Stroke, paint
from poseviewer.app.state.objects import (
    add_object,
    alter_object,
    compare_view,
    pick_object,
    show_view,
)
from poseviewer.app.state.session import Session
from poseviewer.fit.problem import make_problem
from poseviewer.fit.stages import fit_pose
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.types import SearchResult
from tests.app.state import edits as c
from tests.app.state.documents import after, asked_of, assert_same_pose, refused
from tests.app.state.sets import SCALE, make_set_session
from tests.meshes import make_box
from tests.view_sets import CAMERA, MESH, TRUTH, focal_length

STROKE = Stroke("brush", np.array([[40.0, 40.0], [60.0, 60.0]]), 8.0)


@pytest.fixture
def session() -> Session:
    return make_set_session()


def poses_of(session: Session, index: int = 0) -> list[Pose]:
    """An object's pose in each photo."""
    scene = session.document.scene
    return [scene.pose(index, view) for view in range(len(scene.views))]


def assert_poses_are(session: Session, wanted, atol: float = 1e-9) -> None:
    for own, its in zip(poses_of(session), wanted, strict=True):
        assert_same_pose(own, its, atol)


def size_of(session: Session) -> float:
    return session.document.object.world_from_model.scale


def test_a_drag_in_any_photo_moves_all_and_undo_brings_all_back(session: Session):
    seen = after(session, show_view(1))
    assert (seen.document.photo.name, seen.history.past) == ("b.png", ())
    assert "cameras of several photos are known" in refused(seen, c.set_field_of_view(30.0))
    back = after(seen, show_view(0)).document
    assert (back.pose, back.start) == (session.document.pose, session.document.start)
    x, y = TRUTH[1].project(MESH.centre)
    dragged = after(seen, c.press(x, y), c.drag_to(x + 20.0, y), c.release())
    moved = poses_of(dragged)[1].project(MESH.centre)
    np.testing.assert_allclose(moved, [x + 20.0, y], atol=1e-6)
    place = poses_of(dragged)[0].project(MESH.centre)
    assert np.linalg.norm(place - TRUTH[0].project(MESH.centre)) > 5.0
    assert_poses_are(after(dragged, c.undo()), TRUTH)


def test_a_pin_of_one_photo_holds_the_model_in_another(session: Session):
    x, y = TRUTH[0].project(MESH.centre)
    u, v = TRUTH[1].project(MESH.centre) + np.array([25.0, 0.0])
    pinned = after(session, c.double_press(x, y), show_view(1), c.double_press(u, v))
    dragged = after(pinned, c.press(u, v), c.drag_to(u, v + 15.0), c.release())
    poses, (pin, moved) = poses_of(dragged), dragged.document.state.pins
    np.testing.assert_allclose(poses[1].project(pin), TRUTH[1].project(pin), atol=0.5)
    np.testing.assert_allclose(poses[1].project(moved), [u, v + 15.0], atol=0.5)
    turned = poses[0].project(MESH.vertices) - TRUTH[0].project(MESH.vertices)
    assert np.abs(turned).max() > 3.0


def test_masks_and_regions_belong_to_their_photo(session: Session):
    held = c.set_tool("region"), c.press(10.0, 10.0), c.drag_to(50.0, 50.0), c.release()
    drawn = after(session, paint(STROKE), show_view(1), *held, show_view(0))
    own = drawn.document.object.in_views
    assert [view.mask is None for view in drawn.document.scene.views] == [False, True, True]
    assert [one.region for one in own] == [None, Rectangle(10, 10, 40, 40), None]


def test_a_photo_is_left_out_and_taken_back(session: Session):
    left = after(session, compare_view(2, False))
    assert [own.is_compared for own in left.document.object.in_views] == [True, True, False]
    assert left.document.view_index == 0
    assert left.is_unsaved
    last = after(left, compare_view(0, False))
    assert reference_view(last.document.scene, 0, 0) == 1
    assert "one photo" in refused(last, compare_view(1, False)).lower()
    back = after(left, compare_view(2, True)).document
    assert all(own.is_compared for own in back.object.in_views)


def test_what_a_search_said_goes_with_the_photos_that_it_compared(session: Session):
    result = SearchResult(loss=0.1, unexplained=0.1)
    found = replace(session, document=session.document.with_object(result=result))
    assert after(found, show_view(1)).document.object.result is result
    on_it = paint(replace(STROKE, points=found.document.pose.project(MESH.centre)[None]))
    for edit in (compare_view(2, False), on_it, c.nudge("move", 1.0)):
        assert after(found, edit).document.object.result is None


def test_the_size_is_the_seventh_number_where_the_scale_is_not_known():
    session = make_set_session(free_scale=True)
    assert session.document.chart.names[-1] == "log_size"
    larger = after(session, c.set_parameter("log_size", np.log(1.1)))
    assert size_of(larger) == pytest.approx(SCALE * 1.1)
    assert float(larger.document.parameters[-1]) == pytest.approx(np.log(1.1))
    # The model stays where it is among the cameras, so that it is seen larger, in all photos.
    for before, now in zip(TRUTH, poses_of(larger), strict=True):
        np.testing.assert_allclose(now.project(MESH.centre), before.project(MESH.centre), atol=1e-6)
    assert_poses_are(after(larger, c.reset_to_start()), TRUTH)
    assert size_of(after(larger, c.reset_to_start())) == SCALE
    assert len(make_set_session().document.chart.names) == 6


def test_several_objects_in_several_photos(session: Session):
    model = ModelFile.of(make_box((1.0, 1.5, 0.8)), None, "1" * 64, name="box.ply")
    added = after(session, add_object(model))
    assert not added.document.object.is_placed
    x, y = TRUTH[0].project(MESH.centre) + np.array([60.0, 20.0])
    placed = after(added, c.press(x, y), c.release())
    np.testing.assert_allclose(poses_of(placed, 1)[0].project(model.mesh.centre), [x, y], atol=1e-6)
    assert_poses_are(placed, TRUTH)
    # What is done in one photo is done in all, to the active object alone; a mask is the photo's.
    there = after(
        placed, show_view(2), c.nudge("move", 9.0), paint(STROKE), alter_object(2, locked=True)
    )
    moved = poses_of(there, 1)[0].project(model.mesh.centre)
    assert np.linalg.norm(moved - [x, y]) > 2.0
    assert_poses_are(there, TRUTH)
    assert [view.mask is None for view in there.document.scene.views] == [True, True, False]
    back = after(there, pick_object(1))
    assert (back.document.mask is None, back.document.view_index) == (False, 2)
    assert asked_of(after(back, show_view(0), c.search_all())).object_indices == (0,)
    # Unless nothing tells how large they are.
    free = make_set_session(free_scale=True)
    assert "scale is not known" in refused(free, add_object(model))


def test_a_photo_behind_whose_camera_the_model_is_does_not_become_large(session: Session):
    scene, behind = session.document.scene, np.diag([-1.0, 1.0, -1.0])
    turned = scene.views[1].camera_from_world
    turned = RigidTransform(behind @ turned.rotation, behind @ turned.translation)
    away = replace(scene.views[1], camera_from_world=turned)
    scene = replace(scene, views=(scene.views[0], away, scene.views[2]))
    session = replace(session, document=replace(session.document, scene=scene))
    assert "does not show the model" in refused(session, show_view(1))
    # Nor does it stay large where an object is picked that is.
    added = after(session, add_object(), c.press(100.0, 80.0), c.release())
    assert replace(added.document, view_index=1).with_active(0).view_index == 0


def test_a_focal_length_that_was_found_is_that_of_all_photos_of_a_camera(session: Session):
    scene = session.document.scene
    other = replace(CAMERA, fx=650.0, fy=650.0)
    views = (*scene.views[:2], replace(scene.views[2], camera=other))
    free = replace(scene.objects[0].settings, free_focal=True)
    begin = Document.of(replace(scene, views=views).with_object(0, settings=free, start_cameras=()))
    problem, _ = make_problem(begin.scene)
    now = next(fit_pose(problem, SoftwareRenderer(MESH)))
    numbers = np.array([*np.zeros(6), np.log(1.1), np.log(0.9)])
    now = replace(now, parameters=numbers, pose=problem.chart.to_pose(numbers))
    found = begin.at_params(now.problem, now.parameters)
    focals = [660.0, 660.0, 585.0]
    assert [focal_length(view.camera) for view in found.scene.views] == pytest.approx(focals)
    assert [view.camera for view in found.at_start.scene.views] == [view.camera for view in views]
