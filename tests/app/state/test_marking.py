"""Marks on the photo place the model; they can be moved, removed and undone."""

from dataclasses import replace
from functools import reduce

import numpy as np
import pytest

from poseviewer.app.page.controls import as_html
from poseviewer.app.page.handles import DIAMOND, handles_of, model_html
from poseviewer.app.page.texts import hint_of
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.marking import (
    clear_marks,
    lay_wheels,
    mark_model,
    pair_errors,
    pose_beside_wheels,
    remark_wheels,
    remove_mark,
    turn_model,
)
from poseviewer.app.state.session import Session
from poseviewer.files.demo import demo_case
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform, rotation_angle
from poseviewer.starts.sides import look_from
from poseviewer.starts.wheels import FoundWheels
from poseviewer.vehicle.chart import visible_side
from poseviewer.vehicle.wheel_pose import WheelFit, Wheels, ellipse_through, wheel_rims
from tests.app.state import edits as c
from tests.app.state.documents import (
    CAMERAS,
    CAR,
    PARALLEL,
    PERSPECTIVE,
    after,
    assert_same_pose,
    make_document,
    make_keypoints,
    make_photo,
    make_session,
    refused,
)
from tests.meshes import make_box, make_bumpy, merged

TARGET = RigidTransform.from_rotation_vector([0.5, -0.2, 0.3], [-0.1, 0.1, 7.0])
SPOTS = np.array([[-0.7, -0.4], [0.6, -0.5], [0.5, 0.6], [-0.4, 0.5], [0.1, 0.1], [-0.1, 0.7]])


def with_pair(session: Session, spot: np.ndarray, target: Pose) -> Session:
    """Click the model at ``spot``, in its radii from its middle, then where ``target`` shows it."""
    document = session.document
    middle = document.pose.project(document.mesh.centre)
    radius = 0.8 * np.abs(document.pose.project(document.mesh.vertices) - middle).max()
    picked = after(session, c.press(*(middle + radius * spot), zoom=30.0), c.release())
    assert picked.document.marks.waits_for_pixel
    pixel = target.project(picked.document.marks.points[-1])
    return after(picked, c.press(*pixel), c.release())


def off(session: Session, target: Pose) -> float:
    one, other = session.document.pose.camera_from_model, target.camera_from_model
    return rotation_angle(one.rotation, other.rotation)


@pytest.mark.parametrize(("camera", "needed"), [(PERSPECTIVE, 4), (PARALLEL, 3)])
def test_enough_pairs_place_the_model(camera, needed: int):
    session = after(make_session(camera), c.set_tool("pairs"))
    start, target = session.document.pose, Pose(camera, TARGET)
    for count, spot in enumerate(SPOTS[:needed]):
        assert session.document.pose is start or count == 0
        session = with_pair(session, spot, target)
    assert session.document.pose is not start
    assert pair_errors(session.document).max() < 1e-3
    if needed == 4:
        assert off(session, target) < 1e-4
    undone = after(session, c.undo())
    assert undone.document.pose is start
    assert undone.document.marks.waits_for_pixel
    assert after(undone, c.redo()).document is session.document


def test_a_dragged_mark_takes_the_pose_along_in_one_step():
    session = after(make_session(), c.set_tool("pairs"))
    target = Pose(PERSPECTIVE, TARGET)
    for spot in SPOTS[:4]:
        session = with_pair(session, spot, target)
    x, y = session.document.marks.correspondences[1][2]
    dragged = after(
        session, c.press(x + 1, y), c.drag_to(x + 6, y), c.drag_to(x + 9, y), c.release()
    )
    np.testing.assert_allclose(dragged.document.marks.correspondences[1][2], [x + 8, y])
    assert dragged.tool == "pairs"
    assert off(dragged, target) > 0.01
    assert after(dragged, c.undo()).document is session.document
    # A mark that is double-clicked goes; three pairs leave the pose as it is.
    removed = after(session, c.double_press(x, y))
    assert len(removed.document.marks.pixels) == 3
    assert removed.document.pose is session.document.pose


def test_what_cannot_be_marked_is_said():
    session = after(make_session(), c.set_tool("pairs"))
    assert "no model there" in refused(session, c.press(1.0, 1.0))
    wheels = after(session, c.set_tool("wheels"))
    assert "wheels at the right first" in refused(wheels, c.press(80.0, 60.0))


def test_escape_ends_the_mode_and_keeps_the_marks():
    session = after(make_session(), c.set_tool("pairs"))
    session = with_pair(session, SPOTS[0], Pose(PERSPECTIVE, TARGET))
    ended = after(session, c.cancel_drag())
    assert ended.tool == "pose"
    assert len(ended.document.marks.pixels) == 1
    cleared = after(ended, c.set_tool("pairs"), clear_marks())
    assert cleared.document.marks.points == ()
    assert after(cleared, remove_mark()).document is cleared.document


def drawn_beside(session: Session, pose: Pose) -> Session:
    """The session with a picture of the model at a pose."""
    picture = np.zeros((60, 80, 3), np.uint8)
    return after(session, c.set_fields("results", alone=(pose, picture)))


def press_beside(pixel: np.ndarray) -> Edit:
    """Press on that picture where it would be in the photo."""
    return mark_model(pixel[0] / PERSPECTIVE.width, 1.0 - pixel[1] / PERSPECTIVE.height)


def test_points_of_the_model_are_marked_beside_the_photo():
    beside = Pose(PERSPECTIVE, TARGET)
    session = drawn_beside(after(make_session(), c.set_tool("pairs")), beside)
    assert "1</text>" not in model_html(session)
    pixel = beside.project(session.document.mesh.centre)
    for step in (3.2, 0.0):  # one that waits for its place in the photo is marked anew
        marked = after(session, press_beside(pixel + np.array([step, 0.0])))
        (point,) = marked.document.marks.points
        np.testing.assert_allclose(beside.project(point) - pixel, [step, 0.0], atol=1e-6)
        assert "1</text>" in model_html(marked)
        session = marked
    assert model_html(after(session, c.set_tool("pose"))) == ""
    corner = np.array([1.0, 119.0])
    assert "no model there" in refused(after(session, clear_marks()), press_beside(corner))


@pytest.mark.parametrize("side", ["left", "right"])
def test_wheels_of_a_model_without_any_are_pressed_beside_the_photo(side):
    wanted = make_keypoints()
    seen = look_from(side, CAR, wanted, PERSPECTIVE)  # stands as the file's axes say
    session = drawn_beside(after(make_session(mesh=CAR), c.set_tool("wheels")), seen)
    rear, front = getattr(wanted, side).rear_wheel, getattr(wanted, side).front_wheel
    assert "rear wheel on the model" in hint_of(session)
    half = after(session, press_beside(seen.project(rear)))
    assert "front wheel on the model" in hint_of(half)
    beyond = look_from({"left": "right", "right": "left"}[side], CAR, wanted, PERSPECTIVE)
    opposite = press_beside(beyond.project(2.0 * CAR.centre - rear))
    assert "one side" in refused(drawn_beside(half, beyond), opposite)
    placed = after(half, press_beside(seen.project(front)))
    keypoints = placed.document.model.keypoints
    assert keypoints is not None
    for name in ("left", "right"):
        for point in ("rear_wheel", "front_wheel", "axle"):
            own, its = (getattr(getattr(k, name), point) for k in (keypoints, wanted))
            np.testing.assert_allclose(own, its, atol=1e-6)
    assert "rim: point 1" in hint_of(placed)  # on the photo, as with any other vehicle
    assert placed.is_unsaved
    assert after(placed, c.undo()).document is half.document
    # The picture stays where it is: a further press on it changes nothing and says why.
    assert model_html(placed).count("<text") == 2
    assert "are marked" in refused(placed, press_beside(seen.project(rear)))
    assert after(placed, remove_mark()).document.model.keypoints is None
    assert len(after(placed, remove_mark()).document.marks.hubs) == 1
    assert after(placed, remove_mark(), remove_mark()).document.marks.hubs == ()


def test_a_car_is_known_by_what_it_stands_on():
    wheel = make_box((0.6, 0.2, 0.6))
    spots = [[x, y, -0.6] for x in (-1.2, 1.2) for y in (-0.7, 0.7)]
    wheels = [replace(wheel, vertices=wheel.vertices + np.array(spot)) for spot in spots]
    car = reduce(merged, wheels, make_box((4.0, 1.7, 1.1)))
    turned = replace(car, vertices=-car.vertices[:, [1, 2, 0]])
    short = replace(car, vertices=car.vertices * np.array([0.5, 1.0, 1.0]))
    for mesh in (car, turned, load_model(demo_case().model).mesh):
        beside = pose_beside_wheels(mesh, PERSPECTIVE)
        assert beside is not None  # and the wheels are at its lower border, left and right
        low = beside.project(mesh.vertices)
        low = low[low[:, 1] > np.max(low[:, 1]) - 1.0][:, 0] - beside.project(mesh.centre)[0]
        assert low.min() < -5.0
        assert low.max() > 5.0
        assert np.abs(low).min() > 5.0
    for mesh in (short, CAR, make_bumpy(2), make_box((4.0, 1.7, 0.0))):
        assert pose_beside_wheels(mesh, PERSPECTIVE) is None


def test_once_its_wheels_are_marked_a_car_without_a_pose_is_looked_for():
    wanted = make_keypoints()
    seen = look_from("left", CAR, wanted, PERSPECTIVE)
    document = make_document(mesh=CAR)
    for is_placed in (False, True):
        opened = Session(document.with_object(is_placed=is_placed))
        session = drawn_beside(after(opened, c.set_tool("wheels")), seen)
        half = after(session, press_beside(seen.project(wanted.left.rear_wheel)))
        assert not half.is_proposing
        is_drawn = as_html(DIAMOND) in handles_of(half)
        assert is_drawn is is_placed  # else the model is nowhere in the photo
        marked = after(half, press_beside(seen.project(wanted.left.front_wheel)))
        assert marked.is_proposing is not is_placed
        assert ("looking for the wheels" in hint_of(marked)) is not is_placed
        assert not after(marked, c.press(80.0, 60.0)).is_proposing  # a rim is outlined


@pytest.mark.parametrize("mend", [remove_mark(), clear_marks(), None])
def test_a_wrong_wheel_on_the_model_is_taken_back(mend):
    wanted = make_keypoints()
    seen = look_from("left", CAR, wanted, PERSPECTIVE)
    session = drawn_beside(after(make_session(mesh=CAR), c.set_tool("wheels")), seen)
    rear, front = wanted.left.rear_wheel, wanted.left.front_wheel
    wrong = after(session, press_beside(seen.project(rear) + 3.0))
    session = wrong if mend is None else after(wrong, mend)
    assert len(session.document.marks.hubs) == (mend is None)
    session = after(session, press_beside(seen.project(rear)), press_beside(seen.project(front)))
    np.testing.assert_allclose(session.document.model.keypoints.left.rear_wheel, rear, atol=1e-6)
    cleared = after(session, clear_marks()).document
    assert (cleared.model.keypoints, cleared.marks.hubs) == (None, ())


def test_wheels_of_the_model_are_marked_anew_and_a_search_ends_the_tool():
    session = after(make_session(vehicle=True), remark_wheels())
    assert session.tool == "wheels"
    assert "rear wheel on the model" in hint_of(session)
    assert after(session, c.undo()).document.model.keypoints is not None
    assert after(session, c.start_search()).tool == "pose"
    assert after(session, c.set_tool("brush"), c.start_search()).tool == "brush"


def test_the_models_picture_is_turned_by_a_drag():
    session = after(make_session(), c.set_tool("wheels"))
    turned = after(session, turn_model(0.25, 0.0), turn_model(0.25, 0.0))
    np.testing.assert_allclose(turned.display.model_turn, [0.0, np.pi / 2.0, 0.0], atol=1e-9)
    back = after(turned, turn_model(-0.5, 0.0)).display.model_turn
    np.testing.assert_allclose(back, 0.0, atol=1e-9)
    assert turned.document is session.document


@CAMERAS
def test_five_points_on_each_rim_place_the_car_as_found_wheels_do(camera):
    keypoints = make_keypoints()
    target, start = look_from("three-quarter", CAR, keypoints, camera), make_session(camera, True)
    session = begun = after(start, c.view_from("left"), c.set_tool("wheels"))
    rims = wheel_rims(target, visible_side(keypoints, target), 0.35)
    for rim in rims:
        for point in rim[[1, 6, 11, 16, 20]]:
            session = after(session, c.press(*point, zoom=9.0), c.release())
    assert not session.document.marks.note
    assert len(session.document.marks.ellipses) == 2
    assert off(session, target) < 0.02
    assert "outlined" in refused(session, c.press(3.0, 3.0, zoom=9.0))
    left = after(session, remove_mark())
    assert len(left.document.marks.rims) == 9
    x, y = session.document.marks.rims[0]
    moved = after(session, c.press(x, y, zoom=9.0), c.drag_to(x + 2.0, y + 1.0), c.release())
    assert off(moved, target) > 1e-3
    assert after(moved, c.undo()).document is session.document
    # Wheels that were found are marks that are undone in one step.
    rear, front = (ellipse_through(rim) for rim in rims)
    found = FoundWheels(Wheels(rear, front), WheelFit(target, 0.35, 0.0, True))
    laid = after(begun, lay_wheels(begun.document, found))
    assert_same_pose(laid.document.pose, target)
    for seen, given in zip(laid.document.marks.ellipses, (rear, front), strict=True):
        np.testing.assert_allclose(seen.outline(), given.outline(), atol=0.05)
    assert after(laid, c.undo()).document is begun.document
    stale = lay_wheels(make_document(vehicle=True, photo=make_photo(1)), found)
    assert "another photo" in refused(begun, stale)


def test_points_on_no_ellipse_leave_the_pose_and_say_so():
    session = after(make_session(vehicle=True), c.set_tool("wheels"))
    before, points = session.document.pose, [(20.0 + 9 * x, 30.0 + 9 * x) for x in range(5)]
    for point in points:
        session = after(session, c.press(*point, zoom=5.0), c.release())
    assert "edge-on" in session.document.marks.note
    assert session.document.pose is before
