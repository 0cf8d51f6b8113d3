"""Several objects in one photo: one is picked, all else goes on working on it, nothing is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import SearchEnd
from poseviewer.app.state.dragging import nearest_object
from poseviewer.app.state.objects import (
    MOST_OBJECTS,
    AddObject,
    AlterObject,
    PickObject,
    RemoveObject,
)
from poseviewer.app.state.session import Session
from poseviewer.app.state.update import update
from poseviewer.files.pose import PoseRecord, RecordedVerdict
from poseviewer.fit.registration import LoadedModel
from poseviewer.geometry.camera import Parallel
from poseviewer.geometry.mesh import Mesh
from poseviewer.vehicle.chart import VehicleChart
from tests.app.state.documents import (
    CAR,
    PARALLEL,
    PERSPECTIVE,
    after,
    make_document,
    make_keypoints,
    make_photo,
    make_session,
    moved_document,
)
from tests.meshes import make_box

BOX = LoadedModel(make_box((1.0, 1.5, 0.8)), "box.ply", "1" * 64, None)
TAXI = LoadedModel(CAR, "taxi.glb", "2" * 64, make_keypoints())


def with_two(camera=PERSPECTIVE) -> Session:
    """The ball at the left, and a box, which is picked, at the right of it and behind it."""
    session = after(make_session(camera), c.Nudge("move", -30.0), AddObject(BOX))
    return after(session, c.Nudge("scale", -60.0), c.Nudge("move", 30.0))


def middle(session: Session, number: int) -> np.ndarray:
    one = session.document.numbered(number)
    assert one is not None
    return one.pose.project(one.registration.mesh.centre)


def press(session: Session, number: int) -> c.Press:
    x, y = middle(session, number)
    return c.Press(float(x), float(y))


def numbers(session: Session) -> list[int]:
    return [one.number for one in session.document.objects]


def test_an_added_object_is_picked_and_waits_for_its_place():
    first = after(make_session(), c.Nudge("move", 3.0))
    session = after(first, AddObject(BOX, Path("box.ply")))
    document = session.document
    assert (document.number, document.label, document.model_path) == (2, "box.ply", Path("box.ply"))
    assert document.awaits_place
    assert document.verdict == "not placed"
    assert document.pose.camera == PERSPECTIVE
    (other,) = document.others
    assert other.pose is first.document.pose
    assert other.registration.mesh is first.document.registration.mesh
    assert type(other) is not type(document)  # no document holds documents
    assert after(session, c.Undo()).document is first.document
    # The next press puts it there, also where the other one is: that one stays.
    x = middle(session, 1)[0]
    placed = after(session, c.Press(float(x), 5.0), c.Release())
    assert placed.document.number == 2
    assert middle(placed, 2) == pytest.approx([x, 5.0], abs=0.5)
    assert placed.document.others == session.document.others
    # Also where the new one was drawn until then.
    x = middle(session, 2)[0] - 5.0
    placed = after(session, c.Press(float(x), 60.0), c.Release())
    assert middle(placed, 2) == pytest.approx([x, 60.0], abs=1e-6)
    assert after(placed, c.Undo()).document is session.document


def test_the_same_model_again_shares_its_mesh():
    session = after(make_session(vehicle=True), AddObject())
    (other,) = session.document.others
    assert session.document.registration.mesh is other.registration.mesh
    assert session.document.awaits_place
    assert isinstance(session.document.chart, VehicleChart)
    assert isinstance(other.chart, VehicleChart)


def test_every_object_keeps_what_is_its_own_when_another_is_picked():
    session = after(make_session(), c.Nudge("move", -30.0))
    x, y = middle(session, 1)
    session = after(session, c.DoublePress(float(x), float(y)), c.MakeStart())
    session = after(session, c.AlterSettings(lambda s: replace(s, seed=7)))
    ball = session.document
    session = after(session, AddObject(TAXI), c.Nudge("roll", 5.0))
    session = after(session, AlterObject(2, name="taxi"))
    car = session.document
    back = after(session, PickObject(1)).document
    names = ("pose", "settings", "pins", "marks", "model_path", "name")
    for name in names:
        assert getattr(back, name) is getattr(ball, name)
    assert back.registration.start is ball.registration.start
    assert back.registration.mesh is ball.registration.mesh
    again = after(session, PickObject(1), PickObject(2)).document
    for name in names:
        assert getattr(again, name) is getattr(car, name)
    assert again.registration.keypoints is car.registration.keypoints
    assert again.label == "taxi"
    assert session.document.settings.seed == 7  # new ones are compared alike


def test_picking_is_no_step_and_ends_a_search():
    session = after(with_two(), c.StartSearch())
    picked = after(session, PickObject(1))
    assert picked.search is None
    assert picked.history is session.history
    assert picked.document.number == 1
    assert picked.document.poses == session.document.poses
    assert after(picked, PickObject(1)) is picked
    assert after(picked, PickObject(9)) is picked


def test_undo_and_redo_go_over_all_objects():
    sessions = [with_two()]
    for commands in (
        (c.Nudge("move", 2.0),),
        (PickObject(1), c.Nudge("turn", 4.0)),
        (AddObject(),),
        (PickObject(2), c.Nudge("move", 0.0, 5.0)),
        (RemoveObject(1),),
        (AlterObject(2, hidden=True),),
        (PickObject(3), AlterObject(3, locked=True)),
    ):
        sessions.append(after(sessions[-1], *commands))
    now = sessions[-1]
    for before in reversed(sessions[:-1]):
        now = after(now, c.Undo())
        assert now.document.poses == before.document.poses
    for later in sessions[1:]:
        now = after(now, c.Redo())
        assert now.document.poses == later.document.poses
        assert numbers(now) == numbers(later)
    assert now.document.locked


def test_a_press_picks_what_is_nearest_there_and_holds_it():
    session = with_two()
    at = press(session, 1)
    held = after(session, at)
    assert held.document.number == 1
    assert held.drag is not None
    moved = after(held, c.DragTo(at.x + 6.0, at.y), c.Release())
    assert middle(moved, 1) == pytest.approx([at.x + 6.0, at.y])
    assert middle(moved, 2) == pytest.approx(middle(session, 2))
    assert after(moved, c.Undo()).document.poses == session.document.poses
    # Where one is in front of the other, the one in front is taken; beside both, none.
    x, y = middle(session, 1)
    session = after(session, c.Nudge("move", *(middle(session, 1) - middle(session, 2))))
    assert nearest_object(session.document, np.array([x, y])) == 1
    behind = after(session, c.Nudge("scale", 200.0))
    assert nearest_object(behind.document, np.array([x, y])) == 2
    assert after(session, c.Press(1.0, 1.0)).document.number == 2


@pytest.mark.parametrize("change", [{"hidden": True}, {"locked": True}])
def test_what_is_hidden_or_locked_is_left_alone_by_presses(change):
    session = after(with_two(), AlterObject(1, **change))
    at = press(session, 1)
    assert after(session, at) is session
    picked = after(session, PickObject(1), at)
    assert picked.drag is None


def test_a_locked_object_stays_where_it_is_in_the_photo():
    session = after(with_two(), AlterObject(2, locked=True))
    for command in (
        c.Nudge("move", 1.0),
        c.ResetToStart(),
        c.LookFrom("left"),
        c.SetPose(moved_document(session.document, 0.3).pose),
        c.StartSearch(),
    ):
        found = update(session, command)
        assert found.error_message.startswith("Box.ply is locked: unlock it")
        assert found.document is session.document
        assert found.search is None
    # Another camera is another thing, and others can be moved and searched.
    seen = after(session, c.SetFieldOfView(30.0))
    assert middle(seen, 2) == pytest.approx(middle(session, 2))
    moved = after(session, PickObject(1), c.Nudge("move", 1.0), c.StartSearch())
    assert moved.searching
    assert after(session, c.Undo(), c.Nudge("move", 1.0)).document.number == 2


@pytest.mark.parametrize(
    "command",
    [
        c.SetFieldOfView(20.0),
        c.SetCamera(500.0, 400.0, 70.0, 61.0),
        c.SetProjection("parallel"),
    ],
)
def test_one_camera_sees_all_and_each_keeps_its_place(command):
    session = with_two()
    seen = after(session, command)
    for number in (1, 2):
        assert middle(seen, number) == pytest.approx(middle(session, number), abs=1e-6)
    (other,) = seen.document.others
    own, its = seen.document.pose.camera, other.pose.camera
    if isinstance(own, Parallel) and isinstance(its, Parallel):
        its = replace(its, scale=own.scale)
    assert own == its
    assert after(seen, c.Undo()).document.poses == session.document.poses


def test_under_parallel_projection_each_has_its_own_size():
    session = after(make_session(PARALLEL), AddObject(BOX))
    (before,) = session.document.others
    larger = after(session, c.Nudge("scale", 10.0))
    (other,) = larger.document.others
    assert other is before


def test_another_photo_is_that_of_all():
    document = with_two().document
    photo = make_photo(3)
    changed = replace(document, registration=replace(document.registration, photo=photo))
    assert all(one.registration.photo is photo for one in changed.objects)


def test_the_picked_one_is_compared_among_those_that_stand():
    session = after(make_session(), AddObject(BOX))
    (ball,) = session.document.registration.others
    assert ball.pose is session.document.others[0].pose
    # Nobody has said yet where the box is: it is in front of nothing.
    assert after(session, PickObject(1)).document.registration.others == ()
    placed = after(session, c.Nudge("move", 30.0))
    assert placed.document.registration.others == (ball,)  # the very one: what is compared stays
    (box,) = after(placed, PickObject(1)).document.registration.others
    assert box.mesh is BOX.mesh
    hidden = after(placed, AlterObject(1, hidden=True))
    assert hidden.document.registration.others == ()
    assert after(hidden, AlterObject(1, hidden=False)).document.registration.others[0].pose is (
        ball.pose
    )


def test_a_name_is_one_step_however_many_letters():
    session = with_two()
    named = session
    for letters in ("t", "ta", "tax", "taxi"):
        named = after(named, AlterObject(2, name=letters))
    assert named.document.label == "taxi"
    assert after(named, c.Undo()).document is session.document
    assert after(named, AlterObject(2, name="")).document.label == "box.ply"


def test_removing_picks_the_next_and_never_the_last():
    session = after(with_two(), AddObject(TAXI), PickObject(2))
    assert after(session, RemoveObject(2)).document.number == 3
    assert numbers(after(session, RemoveObject(3))) == [1, 2]
    assert after(session, RemoveObject(3)).document.number == 2
    alone = after(session, RemoveObject(2), RemoveObject(1))
    assert numbers(alone) == [3]
    refused = update(alone, RemoveObject(3))
    assert refused.error_message.startswith("This is the only object")
    assert refused.document is alone.document


def test_there_is_a_limit():
    session = make_session()
    for _ in range(MOST_OBJECTS - 1):
        session = after(session, AddObject())
    refused = update(session, AddObject(BOX))
    assert refused.error_message.startswith(f"{MOST_OBJECTS} objects are the most")
    assert refused.document is session.document


def test_undo_reaches_back_over_objects_that_are_at_hand():
    """Many models of one photo are not the many models opened one after another that fill the
    memory.
    """
    session = make_session()
    for number in range(8):
        model = LoadedModel(make_box((1.0, 1.0, 1.0 + number)), "b.ply", f"{number:064d}", None)
        session = after(session, AddObject(model), c.Nudge("move", 1.0))
    session = after(session, PickObject(1), c.Nudge("move", 1.0))
    for _ in range(17):
        assert session.history.past
        session = after(session, c.Undo())
    assert numbers(session) == [1]


def test_a_verdict_is_of_the_pose_that_it_was_given_to():
    document = make_document()
    assert document.verdict == "not searched"
    record = PoseRecord(document.pose, verdict=RecordedVerdict("found", 0.9))
    found = replace(document, end=SearchEnd(record))
    assert found.verdict == "found"
    session = after(Session(found), AddObject(BOX))
    assert session.document.others[0].verdict == "found"
    assert after(session, PickObject(1)).document.verdict == "found"
    assert after(session, PickObject(1), c.Nudge("move", 1.0)).document.verdict == "not searched"
    # Nor is it that by another camera.
    assert after(session, c.SetFieldOfView(30.0)).document.others[0].verdict == "not searched"


def test_unsaved_is_what_any_object_changed():
    session = with_two()
    saved = after(session, c.Saved(session.document))
    assert not saved.unsaved
    assert not after(saved, PickObject(1)).unsaved
    assert after(saved, PickObject(1), c.Nudge("move", 1.0)).unsaved
    assert after(saved, RemoveObject(1)).unsaved


def meshes(session: Session) -> set[Mesh]:
    return {one.registration.mesh for one in session.document.objects}


def test_opening_another_model_in_place_of_the_picked_one_keeps_the_others():
    session = with_two()
    document = session.document
    own = replace(document.registration, mesh=CAR)
    found = after(session, c.Open(replace(document, registration=own)))
    assert numbers(found) == [1, 2]
    assert CAR in meshes(found)


def test_a_search_among_others_is_one_of_several_for_the_picked_one():
    alone = after(make_session(), c.StartSearch())
    assert alone.search is not None
    assert alone.search.objects == ()
    session = with_two()
    among = after(session, c.StartSearch())
    assert among.search is not None
    assert among.search.objects == (session.document,)
    # Those that are hidden are in front of nothing.
    hidden = after(session, AlterObject(1, hidden=True), c.StartSearch())
    assert hidden.search is not None
    assert hidden.search.objects == ()
    locked = update(after(session, AlterObject(2, locked=True)), c.StartSearch())
    assert locked.search is None
    assert "locked" in locked.error_message
