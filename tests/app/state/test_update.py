"""What edits do to a document: one step for a drag, exact undo, refusals that change nothing."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from poseviewer.app.state.document import with_camera
from poseviewer.app.state.dragging import pins_in_photo, radius_in_photo
from poseviewer.app.state.history import MAX_OPENED, History
from poseviewer.app.state.objects import alter_object
from poseviewer.app.state.session import Session
from poseviewer.geometry.camera import Parallel, Perspective
from poseviewer.geometry.free_body_chart import FreeBodyChart
from poseviewer.geometry.transform import rotation_angle
from poseviewer.scene.settings import FitSettings
from poseviewer.starts.sides import look_from
from poseviewer.vehicle.chart import VehicleChart
from tests.app.state import edits as c
from tests.app.state.documents import (
    BUMPY,
    CAMERAS,
    CAR,
    PARALLEL,
    PERSPECTIVE,
    after,
    assert_same_pose,
    make_document,
    make_photo,
    make_session,
    moved_document,
    refused,
)
from tests.app.state.sets import make_set_session
from tests.meshes import make_box


def centre_of(session: Session):
    return session.document.pose.project(session.document.mesh.centre)


def point(session: Session, offset=(0.0, 0.0)) -> tuple[float, float]:
    """A point beside the model's centre, px."""
    x, y = centre_of(session) + np.array(offset)
    return float(x), float(y)


@CAMERAS
@pytest.mark.parametrize("keys", [{}, {"shift": True}, {"ctrl": True}], ids=["", "shift", "ctrl"])
def test_a_drag_is_one_step(camera, keys):
    session = make_session(camera)
    x, y = point(session, (8.0, 3.0))
    held = after(
        session, c.press(x, y, **keys), c.drag_to(x + 2.0, y), c.drag_to(x + 9.0, y + 18.0)
    )
    assert held.history is session.history
    done = after(held, c.release())
    assert done.document is held.document
    assert done.drag is None
    assert done.history.past == (session.document,)
    kept = np.zeros(2) if keys else np.array([9.0, 18.0])
    assert centre_of(done) - centre_of(session) == pytest.approx(kept, abs=1e-9)
    rotations = [s.document.pose.camera_from_model.rotation for s in (session, done)]
    assert np.allclose(*rotations, atol=0.01) is (not keys)
    forgotten = after(held, c.cancel_drag())
    assert forgotten.document is session.document
    assert forgotten.drag is None
    back = after(done, c.undo())
    assert back.document is session.document
    assert after(back, c.redo()).document is done.document


def test_a_press_alone_is_no_step():
    session = make_session()
    for at in (point(session), (1.0, 1.0)):
        pressed = after(session, c.press(*at), c.release())
        assert pressed.history is session.history
        assert pressed.document is session.document


@pytest.mark.parametrize("keys", [{}, {"shift": True}, {"ctrl": True}])
def test_a_drag_may_begin_anywhere(keys: dict[str, bool]):
    session = make_session()
    done = after(session, c.press(1.0, 1.0, **keys), c.drag_to(13.0, 4.0), c.release())
    moved = np.zeros(2) if keys else np.array([12.0, 3.0])
    assert centre_of(done) - centre_of(session) == pytest.approx(moved, abs=1e-9)
    was, now = (s.document.pose.camera_from_model.rotation for s in (session, done))
    assert np.allclose(was, now, atol=0.001) is (not keys)


def test_what_comes_amid_a_drag_ends_it_in_order():
    session = make_session()
    x, y = point(session)
    held = after(session, c.press(x, y), c.drag_to(x + 9.0, y))
    for command in (c.nudge("roll", 5.0), c.start_search(), c.make_start()):
        found = after(held, command)
        assert found.drag is None
        assert found.history.past == (session.document, held.document)
    # What only looks, lets it go on; so does what makes no sense.
    assert after(held, c.set_fields("display", opacity=0.5)).drag is held.drag
    refused(held, c.drag_to(math.nan, 0.0))
    assert after(held, c.drag_to(x, y + 3.0), c.release()).history.past == (session.document,)


def test_a_vehicles_pins_are_dragged():
    session = make_session(vehicle=True)
    pins = pins_in_photo(session.document)
    for pin in range(3):
        x, y = pins[pin] + 1.0
        dragged = after(session, c.press(x, y, zoom=3.0), c.drag_to(x + 3.0, y - 2.0), c.release())
        pins_moved = pins_in_photo(dragged.document) - pins
        wanted = np.zeros((3, 2))
        wanted[pin] = [3.0, -2.0]
        assert pins_moved == pytest.approx(wanted, abs=1e-6)


@CAMERAS
def test_surface_pins_are_set_dragged_and_taken_away(camera):
    session = make_session(camera)
    x, y = centre_of(session)
    places = [(x - 10.0, y - 6.0), (x + 12.0, y), (x, y + 11.0)]
    pinned = after(session, *(c.double_press(*place, zoom=5.0) for place in places))
    assert pinned.document.pose is session.document.pose
    assert pins_in_photo(pinned.document) == pytest.approx(np.array(places), abs=1e-6)
    assert "Three pins" in refused(pinned, c.double_press(x, y - 12.0, zoom=5.0))
    dragged = after(
        pinned, c.press(*places[1], zoom=5.0), c.drag_to(x + 15.0, y - 2.0), c.release()
    )
    wanted = [places[0], (x + 15.0, y - 2.0), places[2]]
    assert pins_in_photo(dragged.document) == pytest.approx(np.array(wanted), abs=0.05)
    fewer, pins = after(dragged, c.double_press(*wanted[1], zoom=5.0)), dragged.document.state.pins
    assert fewer.document.state.pins == (pins[0], pins[2])


def test_a_region_is_drawn_cut_to_the_photo_and_taken_away():
    session = after(make_session(), c.set_tool("region"))
    drawn = after(session, c.press(150.2, 20.7), c.drag_to(300.0, 5.5), c.drag_to(170.0, 60.1))
    assert drawn.document.in_view.region == (150, 20, 10, 41)
    done = after(drawn, c.release())
    assert done.tool == "pose"
    assert done.history.past == (session.document,)
    again = c.set_tool("region"), c.press(20.0, 20.0), c.drag_to(20.5, 60.0), c.release()
    assert after(done, *again).document.in_view.region is None


@pytest.mark.parametrize("kind", ["move", "turn", "roll", "scale"])
@CAMERAS
def test_a_nudge_and_its_opposite_cancel(camera, kind):
    session = make_session(camera)
    there = after(session, c.nudge(kind, 3.0))
    seen = [s.document.pose.project(BUMPY.vertices) for s in (session, there)]
    assert np.abs(seen[0] - seen[1]).max() > 0.5
    back = after(there, c.nudge(kind, -3.0))
    assert back.document.pose.project(BUMPY.vertices) == pytest.approx(seen[0], abs=1e-8)


@CAMERAS
@pytest.mark.parametrize("vehicle", [False, True])
@pytest.mark.parametrize("moved", [False, True], ids=["", "other camera"])
def test_setting_a_number_changes_that_number_alone(camera, vehicle, moved):
    session = make_session(camera, vehicle)
    if moved and isinstance(camera, Perspective):
        session = after(session, c.set_camera(400.0, 330.0, 80.0, 55.0), c.nudge("move", 5.0))
    elif moved:
        session = after(session, c.set_projection("perspective"), c.nudge("move", 5.0))
    parameters = session.document.parameters
    for index, name in enumerate(session.document.chart.names):
        wanted = np.array(parameters)
        wanted[index] += 0.03
        found = after(session, c.set_parameter(name, float(wanted[index])))
        assert found.document.parameters == pytest.approx(wanted, abs=1e-9)
        if not isinstance(camera, Parallel):
            assert found.document.pose.camera == session.document.pose.camera
        assert after(session, c.set_parameter(name, float(parameters[index]))) is session


@CAMERAS
def test_setting_a_number_of_the_pose_changes_that_number_alone(camera):
    session = make_session(camera)
    numbers = c.pose_numbers(session.document.pose)
    names = "XYZ" if isinstance(camera, Perspective) else "XY"
    for name in (*names, "turn x", "turn y", "turn z", *("scale",) * ("scale" in numbers)):
        found = after(session, c.set_number(name, numbers[name] + 0.3))
        changed = c.pose_numbers(found.document.pose)
        del changed["X" if name == "distance" else name]
        wanted = {other: value for other, value in numbers.items() if other in changed}
        for of_all in (changed, wanted):
            of_all.pop("distance", None)
        assert changed == pytest.approx(wanted, abs=1e-9)
        assert after(session, c.set_number(name, numbers[name])) is session
        assert after(found, c.undo()).document is session.document
    refused(session, c.set_number("no such number", 1.0))


def test_each_number_that_is_applied_is_a_step():
    session = make_session()
    for set_number in (partial(c.set_parameter, "log_depth"), partial(c.set_number, "X")):
        typed = after(session, set_number(0.1))
        again = after(typed, set_number(0.125))
        assert after(again, c.undo()).document is typed.document
        assert after(again, c.undo(), c.undo()).document is session.document


def test_a_note_is_one_step_however_often_its_typing_pauses():
    session = make_session()
    alter = partial(alter_object, session.document.object_id)
    noted = after(session, *(alter(note=text) for text in ("left", "left front", "left door")))
    assert after(noted, c.undo()).document is session.document
    both = after(noted, alter(name="van"), alter(note="left"))
    assert after(both, c.undo(), c.undo()).document is noted.document
    again = after(noted, c.nudge("move", 5.0), c.undo(), alter(note="right"))
    assert not again.history.future
    assert after(again, c.undo()).document is noted.document


@CAMERAS
@pytest.mark.parametrize(
    "edit",
    [c.set_camera(fx=400.0), c.set_camera(cy=55.0), c.set_field_of_view(30.0)],
    ids=["fx", "cy", "field of view"],
)
def test_another_camera_places_nothing(camera, edit):
    document = make_document(camera).with_object(is_placed=False)
    changed = after(Session(document), edit)
    assert changed.document.pose.camera != camera or isinstance(camera, Parallel)
    assert not changed.document.object.is_placed
    other = "parallel" if isinstance(camera, Perspective) else "perspective"
    assert not after(changed, c.set_projection(other)).document.object.is_placed
    # What is looked for is looked for by the new camera; what was stopped stays so.
    looking = after(Session(document).with_first_proposals, edit)
    assert looking.proposals is not None
    assert looking.proposals.document.pose.camera == looking.document.pose.camera
    stopped = after(Session(document).with_first_proposals, c.stop_proposing(), edit)
    assert not stopped.is_proposing


def test_an_intrinsic_leaves_the_others():
    session = after(make_session(), c.set_camera(fx=311.0), c.set_camera(cy=61.0))
    camera = session.document.pose.camera
    assert camera == replace(PERSPECTIVE, fx=311.0, cy=61.5)


SENSELESS_CAMERAS = {
    "fx, fy = 300, -5: wanted focal lengths of 1 to 160000 px": (300.0, -5.0, 80.0, 60.0),
    "fx, fy = 1e+06, 300: wanted focal": (1e6, 300.0, 80.0, 60.0),
    "a number is nan": (math.nan, 300.0, 80.0, 60.0),
    "cx, cy = 80, -4000: wanted a centre within 1600 px of": (300.0, 300.0, 80.0, -4000.0),
}


@pytest.mark.parametrize("start", SENSELESS_CAMERAS)
def test_a_camera_that_makes_no_sense_is_refused_in_one_sentence(start):
    text = refused(make_session(), c.set_camera(*SENSELESS_CAMERAS[start]))
    assert text.lower().startswith(start)
    assert text.endswith("; nothing was changed.")


@CAMERAS
def test_a_field_of_view_gives_its_focal_length(camera):
    session = make_session(camera)
    refused(session, c.set_field_of_view(math.nan))
    found = after(session, c.set_field_of_view(90.0)).document.pose
    assert (found.camera.cx, found.camera.cy) == (camera.cx, camera.cy)
    if isinstance(found.camera, Perspective):
        assert (found.camera.fx, found.camera.fy) == pytest.approx((80.0, 80.0))


def test_a_parallel_camera_takes_its_centre_alone():
    session = make_session(PARALLEL)
    found = after(session, c.set_camera(0.01, 0.01, 70.0, 66.0)).document.pose.camera
    assert found == replace(PARALLEL, cx=70.5, cy=66.5)


def test_start_reset_and_poses_set():
    session = make_session()
    there = after(session, c.nudge("move", 9.0, 4.0), c.nudge("turn", 5.0, 1.0))
    assert after(there, c.reset_to_start()).document.pose is session.document.pose
    started = after(there, c.make_start(), c.nudge("roll", 5.0), c.reset_to_start())
    assert started.document.pose is there.document.pose
    assert started.document.parameters == pytest.approx(np.zeros(6), abs=1e-9)


def test_unsaved_is_told():
    session = make_session()
    assert session.is_unsaved
    saved = after(session, c.set_fields(saved=session.document))
    assert not saved.is_unsaved
    assert after(saved, c.nudge("move", 1.0)).is_unsaved
    assert not after(saved, c.nudge("move", 1.0), c.undo()).is_unsaved
    # Undo leads back to what was open, as it was saved, and as it was not.
    other = c.open_document(make_session().document)
    assert not after(saved, other).is_unsaved
    assert not after(saved, other, c.undo()).is_unsaved
    assert after(saved, c.nudge("move", 1.0), other, c.undo()).is_unsaved


@pytest.mark.parametrize(
    "command",
    [
        c.set_parameter("no_such_number", 1.0),
        c.set_parameter("log_depth", 500.0),
        c.nudge("scale", math.inf),
        c.view_from("below"),
        c.press(math.nan, 10.0),
        c.double_press(1.0, 1.0),
    ],
)
def test_bad_input_is_refused_with_a_sentence(command):
    refused(make_session(), command)


@CAMERAS
def test_a_view_turns_the_model_where_it_is(camera):
    session = make_session(camera)
    before, centre = session.document.pose, BUMPY.centre
    left, right = (after(session, c.view_from(side)).document.pose for side in ("left", "right"))
    for pose in (left, right):
        there = pose.camera_from_model.apply(centre)
        np.testing.assert_allclose(there, before.camera_from_model.apply(centre), atol=1e-12)
        assert pose.camera == before.camera
    turn = rotation_angle(left.camera_from_model.rotation, right.camera_from_model.rotation)
    assert turn == pytest.approx(math.pi)


def test_a_pose_behind_the_camera_is_refused():
    session = make_session()
    turned = session.document.pose.camera_from_model
    behind = replace(turned, translation=turned.translation * -1.0)
    away = replace(session.document.pose, camera_from_model=behind)
    refused(session, c.open_document(session.document.at_pose(away)))


@pytest.mark.parametrize("other", ["photo", "model", "both"])
def test_history_keeps_few_photos_and_models(other):
    photo, history = make_photo(), History()
    documents = []
    for i in range(MAX_OPENED + 3):
        photo_now = photo if other == "model" else make_photo(i)
        mesh = BUMPY if other == "photo" else make_box((1.0, 1.0, 1.0 + i))
        opened = make_document(photo=photo_now, mesh=mesh)
        documents += [opened, moved_document(opened, 0.1)]
    for document in documents:
        history = history.with_step(document)
    assert history.past == tuple(documents[-2 * MAX_OPENED :])


@CAMERAS
def test_another_camera_keeps_the_centres_pixel_and_size(camera):
    pose = make_document(camera).pose
    for new in (
        Perspective(500.0, 400.0, 70.0, 66.0, 160, 120),
        Parallel(1.0, 70.0, 66.0, 160, 120),
    ):
        seen = with_camera(pose, new, BUMPY.centre)
        assert type(seen.camera) is type(new)
        assert seen.project(BUMPY.centre) == pytest.approx(pose.project(BUMPY.centre), abs=1e-9)
        assert radius_in_photo(seen, BUMPY) == pytest.approx(radius_in_photo(pose, BUMPY))
        assert np.array_equal(seen.camera_from_model.rotation, pose.camera_from_model.rotation)


def test_there_and_back_between_projections_is_the_same_pose():
    session = make_session(PERSPECTIVE)
    flat = after(session, c.set_projection("parallel"))
    assert isinstance(flat.document.pose.camera, Parallel)
    back = after(flat, c.set_projection("perspective"))
    assert_same_pose(back.document.pose, session.document.pose)
    assert after(session, c.set_projection("perspective")) is session
    assert after(flat, c.set_projection("parallel")) is flat


@pytest.mark.parametrize("free", [{}, {"free_focal": True}, {"free_principal_point": True}])
@pytest.mark.parametrize(
    "camera",
    [
        PARALLEL,
        Parallel(31.0, 70.0, 66.0, 160, 120),
        Perspective(500.0, 410.0, 70.0, 66.0, 160, 120),
    ],
    ids=["parallel", "shifted parallel", "longer pinhole"],
)
@pytest.mark.parametrize("start", [PARALLEL, PERSPECTIVE], ids=["from parallel", "from pinhole"])
def test_the_chart_gives_the_pose_back_whatever_the_camera_has_become(start, camera, free):
    document = make_document(start, settings=FitSettings(**free))
    pose = with_camera(moved_document(document, 0.3).pose, camera, BUMPY.centre)
    document = document.at_pose(pose)
    again = document.chart.to_pose(document.parameters)
    assert type(again.camera) is type(camera)
    assert again.project(BUMPY.vertices) == pytest.approx(pose.project(BUMPY.vertices), abs=1e-7)
    if isinstance(camera, Perspective) and isinstance(again.camera, Perspective):
        assert again.camera.fx == pytest.approx(camera.fx)
        assert again.camera.fy == pytest.approx(camera.fy)
        assert again.camera.cx == camera.cx
    # Not all zero: they are told from the start, not from the pose itself.
    assert abs(document.parameters[3]) > 0.05


def test_a_principal_point_is_told_from_that_at_the_start():
    free = FitSettings(free_principal_point=True)
    for document in (make_document(vehicle=True, settings=free), make_set_session().document):
        document = document.with_object(settings=free)
        index = document.chart.names.index("principal_x")
        numbers = document.parameters
        numbers[index:] = 0.1, -0.05
        pose = document.chart.to_pose(numbers)
        assert pose.camera.cx == pytest.approx(document.pose.camera.cx + 0.1 * pose.camera.width)
        assert document.at_pose(pose).parameters == pytest.approx(numbers)
        assert document.at_pose(pose).at_start.pose.camera == document.pose.camera


@CAMERAS
def test_a_vehicle_seen_head_on_has_the_other_chart(camera):
    document = make_document(camera, vehicle=True)
    assert isinstance(document.chart, VehicleChart)
    front = look_from("front", CAR, document.model.keypoints, camera)
    document = document.at_pose(front)
    assert isinstance(document.chart, FreeBodyChart)
    again = document.chart.to_pose(document.parameters)
    assert again.project(CAR.vertices) == pytest.approx(front.project(CAR.vertices), abs=1e-6)
