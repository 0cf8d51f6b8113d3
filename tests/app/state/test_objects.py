"""Several objects in one photo: one is picked, all else goes on working on it, nothing is lost."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from poseviewer.app.page.texts import search_text
from poseviewer.app.state.document import label_of, loss_inputs, verdict_of
from poseviewer.app.state.dragging import nearest_object
from poseviewer.app.state.objects import (
    MAX_OBJECTS,
    add_object,
    alter_object,
    pick_object,
    remove_object,
)
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import run_search
from poseviewer.confidence.verdict import Verdict
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.scene.assets import ModelFile
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import SearchResult
from tests.app.state import edits as c
from tests.app.state.documents import (
    CAR,
    PERSPECTIVE,
    after,
    asked_of,
    make_keypoints,
    make_photo,
    make_session,
    moved_document,
    refused,
)
from tests.meshes import make_box

BOX = ModelFile.of(make_box((1.0, 1.5, 0.8)), Path("box.ply"), "1" * 64)
TAXI = ModelFile.of(CAR, None, "2" * 64, name="taxi.glb", keypoints=make_keypoints())
FOUND = SearchResult(verdict=Verdict("found", 0.9), loss=0.1, unexplained=0.1)


def with_two(camera=PERSPECTIVE) -> Session:
    """The ball at the left, and a box, which is active, at the right of it and behind it."""
    session = after(make_session(camera), c.nudge("move", -30.0), add_object(BOX))
    return after(session, c.nudge("scale", -60.0), c.nudge("move", 30.0))


def pose_of(session: Session, number: int) -> Pose:
    return session.document.scene.pose(session.document.scene.index(str(number)))


def poses_of(session: Session) -> list[Pose]:
    return [pose_of(session, number) for number in numbers(session)]


def middle(session: Session, number: int) -> np.ndarray:
    document = session.document
    one = document.scene.objects[document.scene.index(str(number))]
    return pose_of(session, number).project(one.mesh.centre)


def numbers(session: Session) -> list[int]:
    return [int(one.id) for one in session.document.scene.objects]


def test_an_added_object_is_picked_and_waits_for_its_place():
    first = after(make_session(), c.nudge("move", 3.0))
    session = after(first, add_object(BOX))
    document = session.document
    assert (document.object_id, label_of(document.object)) == (2, "box.ply")
    assert verdict_of(document.object) == "not placed"
    assert document.others == (0,)
    assert pose_of(session, 1) is first.document.pose
    # The next press puts it there, also where the other one is, or it was drawn until then.
    for at in ((middle(session, 1)[0], 5.0), (middle(session, 2)[0] - 5.0, 60.0)):
        placed = after(session, c.press(*at), c.release())
        assert placed.document.object.is_placed
        assert middle(placed, 2) == pytest.approx(at, abs=1e-6)
        assert placed.document.scene.objects[0] is session.document.scene.objects[0]
        assert after(placed, c.undo()).document is session.document
    again = after(session, add_object())  # the same model once more
    assert again.document.mesh is BOX.mesh
    assert not again.document.object.is_placed


def test_every_object_keeps_what_is_its_own_when_another_is_picked():
    session = after(make_session(), c.nudge("move", -30.0))
    x, y = middle(session, 1)
    session = after(session, c.double_press(float(x), float(y)), c.make_start())
    session = after(session, c.alter_settings(lambda s: replace(s, seed=7)))
    ball = session.document
    session = after(session, add_object(TAXI), c.nudge("roll", 5.0))
    session = after(session, alter_object(2, name="taxi"))
    car = session.document
    back = after(session, pick_object(1)).document
    assert (back.object, back.state) == (ball.object, ball.state)
    again = after(session, pick_object(1), pick_object(2)).document
    assert (again.object, again.state) == (car.object, car.state)
    assert again.model.keypoints is TAXI.keypoints
    assert label_of(again.object) == "taxi"
    assert session.document.settings.seed == 7  # new ones are compared alike


def test_picking_is_no_step_and_ends_a_search():
    session = after(with_two(), c.start_search())
    picked = after(session, pick_object(1))
    assert picked.search is None
    assert picked.history is session.history
    assert picked.document.scene is session.document.scene
    assert after(picked, pick_object(1)) is picked
    assert "no object '9'" in refused(picked, pick_object(9))


def test_a_press_picks_what_is_nearest_there_and_holds_it():
    session = with_two()
    x, y = middle(session, 1)
    held = after(session, c.press(x, y))
    assert held.document.object_id == 1
    assert held.drag is not None
    moved = after(held, c.drag_to(x + 6.0, y), c.release())
    assert middle(moved, 1) == pytest.approx([x + 6.0, y])
    assert middle(moved, 2) == pytest.approx(middle(session, 2))
    assert poses_of(after(moved, c.undo())) == poses_of(session)
    # Where one is in front of the other, the one in front is taken; beside both, none.
    x, y = middle(session, 1)
    session = after(session, c.nudge("move", *(middle(session, 1) - middle(session, 2))))
    assert nearest_object(session.document, np.array([x, y])) == 0
    behind = after(session, c.nudge("scale", 200.0))
    assert nearest_object(behind.document, np.array([x, y])) == 1
    assert after(session, c.press(1.0, 1.0)).document.object_id == 2


@pytest.mark.parametrize("change", [{"hidden": True}, {"locked": True}])
def test_what_is_hidden_or_locked_is_left_alone_by_presses(change):
    session = after(with_two(), alter_object(1, **change))
    at = c.press(*middle(session, 1))
    assert after(session, at, c.release()).document is session.document
    picked = after(session, pick_object(1), at)
    assert picked.drag is None


def test_a_locked_object_stays_where_it_is_in_the_photo():
    session = after(with_two(), alter_object(2, locked=True))
    for command in (
        c.nudge("move", 1.0),
        c.reset_to_start(),
        c.view_from("left"),
        c.open_document(moved_document(session.document, 0.3)),
        c.start_search(),
    ):
        assert refused(session, command).startswith("box.ply is locked: unlock it")
    # Another camera is another thing, and others can be moved and searched.
    seen = after(session, c.set_field_of_view(30.0))
    assert middle(seen, 2) == pytest.approx(middle(session, 2))
    moved = after(session, pick_object(1), c.nudge("move", 1.0), c.start_search())
    assert moved.is_searching
    assert after(session, c.undo(), c.nudge("move", 1.0)).document.object_id == 2


@pytest.mark.parametrize("command", [c.set_field_of_view(20.0), c.set_projection("parallel")])
def test_one_camera_sees_all_and_each_keeps_its_place(command):
    session = with_two()
    seen = after(session, command)
    for number in (1, 2):
        assert middle(seen, number) == pytest.approx(middle(session, number), abs=1e-6)
    own, its = seen.document.pose.camera, pose_of(seen, 1).camera
    if isinstance(own, Parallel) and isinstance(its, Parallel):
        its = replace(its, scale=own.scale)
    assert own == its
    assert poses_of(after(seen, c.undo())) == poses_of(session)


def test_the_active_one_is_compared_among_those_that_stand_firm():
    session = with_two()
    before, firm = (
        loss_inputs(after(session, *edits).document.scene, 1)
        for edits in ((), (alter_object(1, locked=True),))
    )
    assert before != firm
    named = after(session, alter_object(1, locked=True), alter_object(1, name="ball"))
    assert loss_inputs(named.document.scene, 1) == firm
    hidden = after(named, alter_object(1, hidden=True))
    assert loss_inputs(hidden.document.scene, 1) == before


def test_removing_picks_the_next_and_never_the_last():
    session = after(with_two(), add_object(TAXI), pick_object(2))
    assert after(session, remove_object(2)).document.object_id == 3
    assert numbers(after(session, remove_object(3))) == [1, 2]
    assert after(session, remove_object(3)).document.object_id == 2
    alone = after(session, remove_object(2), remove_object(1))
    assert numbers(alone) == [3]
    assert refused(alone, remove_object(3)).startswith("This is the only object")


def in_unit(model: ModelFile, unit: str) -> ModelFile:
    """The model in a file that says its unit."""
    return replace(model.with_content(mesh=replace(model.mesh, unit=unit)), unit=unit)


def test_what_cannot_be_added_is_refused():
    session = after(make_session(), add_object(in_unit(BOX, "mm")))
    refusal = refused(session, add_object(in_unit(TAXI, "m")))
    assert refusal.startswith("Taxi.glb is in m, box.ply in mm")
    session = after(session, *[add_object()] * (MAX_OBJECTS - 2))
    assert refused(session, add_object()).startswith(f"{MAX_OBJECTS} objects are the most")


def test_undo_reaches_back_over_all_objects_at_hand():
    session = make_session()
    for number in range(8):
        model = ModelFile.of(
            make_box((1.0, 1.0, 1.0 + number)), None, f"{number:064d}", name="b.ply"
        )
        session = after(session, add_object(model))
    session = after(session, pick_object(1), *[c.nudge("move", 1.0)] * 9, *[c.undo()] * 17)
    assert numbers(session) == [1]


def test_a_verdict_is_of_the_pose_that_it_was_given_to():
    def verdict(session: Session) -> str:
        return verdict_of(session.document.scene.objects[0])

    session = make_session()
    assert verdict(session) == "not searched"
    found = replace(session, document=session.document.with_object(result=FOUND))
    session = after(found, add_object(BOX))
    assert verdict(session) == "found"
    for edits in ((pick_object(1), c.nudge("move", 1.0)), (c.set_field_of_view(30.0),)):
        assert verdict(after(session, *edits)) == "not searched"


def test_a_search_is_for_the_active_one_and_all_are_searched_for_in_turn():
    session = with_two()
    assert asked_of(after(session, c.start_search())).object_indices == (1,)
    assert asked_of(after(session, c.search_all())).object_indices == (0, 1)
    hidden = after(session, alter_object(1, hidden=True), c.search_all())
    assert asked_of(hidden).object_indices == (1,)
    locked = after(session, alter_object(2, locked=True))
    assert "locked" in refused(locked, c.start_search())


def test_a_focal_length_found_by_one_object_holds_for_all():
    few = FitSettings(limits=Limits(evaluations=60))
    session = after(with_two(make_photo().default_camera()), c.alter_settings(lambda _: few))
    document = session.document.with_object(0, result=FOUND)
    begun = after(replace(session, document=document), c.find_focal_length())
    updates = list(run_search(asked_of(begun)))
    done = after(begun, *(c.search_advanced(asked_of(begun), item) for item in updates))
    assert pose_of(done, 1).camera == pose_of(done, 2).camera != document.pose.camera
    assert verdict_of(done.document.scene.objects[0]) == "not searched"
    assert "search again for m.ply." in search_text(done)
    # Maps are of the problem that was searched, and the settings are as before.
    assert [settings.free_focal for settings in done.mapped] == [True]
    assert done.document.settings == few
    kept = after(done, c.accept_search())
    assert kept.mapped == (few,)
    assert asked_of(after(kept, c.search_all())).object_indices == (0, 1)
    # Where it is right, the others are searched again by it, and undo takes all of that back.
    last = replace(updates[-1], scene=updates[-1].scene.with_object(1, result=FOUND))
    again = after(begun, c.search_advanced(asked_of(begun), last))
    assert again.is_searching
    assert asked_of(again).object_indices == (0,)
    assert asked_of(again).methods == (few,)
    assert pose_of(again, 1).camera == last.progress.pose.camera
    assert after(again, c.revert_search()).document is begun.document


def test_a_note_on_an_object_is_one_step_and_unsaved_until_it_is_written():
    session = make_session()
    session = replace(session, saved=session.document)
    typed = after(session, *[alter_object(1, note=text) for text in ("t", "to", "x" * 5000)])
    assert typed.is_unsaved
    assert typed.document.object.note == "x" * 1000
    assert typed.document.pose is session.document.pose
    assert after(typed, c.undo()).document is session.document
