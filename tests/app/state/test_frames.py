"""Edits of a sequence: shown frames, keys, stale poses, undo."""

import json
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.page.reports import meaning_of
from poseviewer.app.page.texts import occlusion_text
from poseviewer.app.page.time_line import time_line
from poseviewer.app.state.document import Document
from poseviewer.app.state.edits import Edit, cancel_drag, drag_to, redo, release, set_fields, undo
from poseviewer.app.state.frame_edits import (
    edit_frames,
    frame_read,
    go_to_frame,
    propagation_advanced,
    step_frame,
)
from poseviewer.app.state.hiding import (
    Stroke,
    hide_found,
    hide_in_all_frames,
    masks_of,
    occlusion_pixels,
    paint,
    unhide,
)
from poseviewer.app.state.history import MAX_OPENED
from poseviewer.app.state.objects import (
    add_object,
    alter_object,
    pick_object,
    remove_object,
    set_unit,
)
from poseviewer.app.state.pointer_edits import press
from poseviewer.app.state.pose_edits import nudge, set_field_of_view
from poseviewer.app.state.results import Pace, PropagationProgress, PropagationRequest
from poseviewer.app.state.search_edits import toggle_search
from poseviewer.app.state.session import Session
from poseviewer.files.scene_json import as_saved
from poseviewer.scene.sequence import FrameStep, key_indices, show_frame
from poseviewer.scene.types import FramePose, SearchResult
from tests.app.sequences import COUNT, make_sequence
from tests.app.state.documents import after, assert_same_pose, make_session, refused

RIGHT = nudge("move", 1.0)


def make_frames_session() -> Session:
    return Session(make_sequence())


def shown_at(session: Session, index: int) -> Session:
    """The session once a frame is shown."""
    frames = session.document.scene.frames
    u = (index + 0.5) / len(frames)
    return after(session, go_to_frame(u), frame_read(index, replace(frames[index].file)))


def keys_of(session: Session) -> list[int]:
    return key_indices(session.document.scene, session.document.object.id)


def poses_of(session: Session) -> list[FramePose | None]:
    return [frame.poses.get("1") for frame in session.document.scene.frames]


def steps(*indices: int, note: str = "") -> list[FrameStep]:
    place = make_sequence().object.world_from_model
    pose = FramePose(world_from_model=place, source="propagated")
    found = [FrameStep(index, {"1": pose}) for index in indices]
    return [*found, FrameStep(indices[-1] + 1, {}, note)] if note else found


def propagated(session: Session, *indices: int, note: str = "") -> Session:
    """The session after a propagation from its frame to others."""
    session = after(session, edit_frames("to end"))
    assert session.propagation is not None
    request = session.propagation.request
    made = steps(*indices, note=note)
    return after(session, propagation_advanced(request, made, is_over=True))


def mended() -> Session:
    """A key in frame 0, propagated to the end, and a key in frame 4."""
    session = propagated(after(make_frames_session(), RIGHT), *range(1, COUNT))
    return after(shown_at(session, 4), RIGHT)


def hidden_in(session: Session) -> list[bool]:
    """Whether a pixel is painted over, by frame."""
    scene, shown = session.document.scene, []
    for index in range(len(scene.frames)):
        mask = show_frame(scene, index).mask(session.document.active)
        shown.append(mask is not None and mask.weights[60, 60] == 0.0)
    return shown


def stroke(x: float = 60.5, erase: bool = False) -> Edit:
    return paint(Stroke("brush", np.array([[x, 60.5]]), 5.0, erase))


@pytest.mark.parametrize("for_one", [False, True])
def test_what_is_painted_hides_in_its_frame_and_in_all_if_that_is_said(for_one):
    session = after(make_frames_session(), add_object(), set_fields("pen", for_one=for_one))
    painted = after(shown_at(session, 2), stroke())
    assert hidden_in(painted) == [index == 2 for index in range(COUNT)]
    assert painted.is_unsaved
    assert hidden_in(after(painted, undo())) == [False] * COUNT
    assert hidden_in(shown_at(painted, 3)) == hidden_in(painted)
    assert after(shown_at(painted, 3), hide_in_all_frames()).document.scene.views[0].mask is None
    everywhere = after(painted, hide_in_all_frames())
    assert hidden_in(everywhere) == [True] * COUNT
    assert not any(frame.mask or frame.masks for frame in everywhere.document.scene.frames)
    assert "% of the photo is hidden" in occlusion_text(everywhere).replace("*", "")
    assert "% in all frames" in occlusion_text(everywhere).replace("*", "")
    other = after(everywhere, pick_object(1))
    assert hidden_in(other) == [not for_one] * COUNT
    # Erased and cleared is what is hidden in the shown frame, whatever hides it.
    more = after(shown_at(everywhere, 4), stroke(90.5))
    for edit in (stroke(erase=True), unhide()):
        assert hidden_in(after(more, edit)) == [False] * COUNT
    assert any(masks_of(after(more, stroke(erase=True))))
    assert not any(masks_of(after(more, unhide())))
    assert hidden_in(after(more, undo(), undo())) == hidden_in(painted)


def test_a_verdict_of_pixels_that_are_painted_over_does_not_come_back():
    session = after(shown_at(make_frames_session(), 1), RIGHT)
    document = session.document.with_result(SearchResult(loss=0.5))
    session = shown_at(shown_at(replace(session, document=document), 0), 1)
    assert session.document.object.result is not None
    (middle,) = session.document.pose.project(session.document.mesh.centre[None])
    painted = after(session, paint(Stroke("brush", middle[None], 5.0, erase=False)))
    assert key_indices(painted.document.scene, "1") == [1]
    assert shown_at(shown_at(painted, 0), 1).document.object.result is None


def test_what_a_search_found_in_front_belongs_to_its_frame():
    session = after(shown_at(make_frames_session(), 1), RIGHT)
    photo = session.document.photo
    hidden = np.zeros((photo.height, photo.width), bool)
    hidden[55:65, 55:65] = True
    document = session.document.with_result(SearchResult(hidden=(hidden,)))
    session = replace(session, document=document)

    def is_found(now: Session) -> bool:
        pixels = occlusion_pixels(now)
        return pixels is not None and np.array_equal(pixels, hidden)

    found = shown_at(shown_at(session, 0), 1)
    assert is_found(found)
    assert occlusion_pixels(shown_at(found, 0)) is None
    taken = after(found, hide_found())
    assert hidden_in(taken) == [index == 1 for index in range(COUNT)]
    assert occlusion_pixels(shown_at(shown_at(taken, 2), 1)) is None
    # Opened again, what was found is still no user's mask.
    opened = Session(Document.of(as_saved(found.document.scene)))
    assert hidden_in(opened) == [False] * COUNT
    assert is_found(shown_at(opened, 1))
    everywhere = after(shown_at(opened, 1), stroke(30.5), hide_in_all_frames())
    assert hidden_in(everywhere) == [False] * COUNT
    assert is_found(everywhere)
    assert occlusion_pixels(after(everywhere, stroke(erase=True))) is not None
    assert occlusion_pixels(after(everywhere, unhide())) is None


def test_a_unit_that_is_said_keeps_poses_and_verdicts():
    session = after(shown_at(make_frames_session(), 1), RIGHT)
    said = after(session, set_unit("mm"))
    assert said.document.object.model.unit == "mm"
    assert said.document.scene.frames == session.document.scene.frames
    assert said.at_pose == session.at_pose


def test_an_object_that_comes_later_has_no_mask_of_one_that_is_gone():
    session = after(make_frames_session(), add_object(), set_fields("pen", for_one=True), stroke())
    again = after(session, remove_object(2), add_object())
    assert again.document.object.id == "2"
    assert hidden_in(session)[0]
    assert not any(hidden_in(again))


def test_a_pose_that_is_placed_is_a_key_and_undo_takes_it_back():
    session = make_frames_session()
    keyed = after(session, RIGHT)
    assert keys_of(keyed) == [0]
    key = poses_of(keyed)[0]
    assert key is not None
    assert key.world_from_model is keyed.document.object.world_from_model
    back = after(keyed, undo())
    assert keys_of(back) == []
    assert keys_of(after(back, redo())) == [0]


def test_a_drag_makes_a_key_once_it_ends():
    session = after(make_frames_session(), press(120.0, 90.0), drag_to(130.0, 90.0))
    assert keys_of(session) == []
    assert keys_of(after(session, release())) == [0]
    assert keys_of(after(session, cancel_drag())) == []


def test_a_still_scene_has_no_keys():
    session = after(
        make_session(), RIGHT, step_frame(1), go_to_frame(0.5), edit_frames("keep keys")
    )
    assert session.document.scene.frames == ()
    assert session.wanted_frame is None
    assert len(session.history.past) == 1


def test_a_frame_is_shown_without_an_undo_step():
    session = after(make_frames_session(), RIGHT)
    shown = shown_at(session, 3)
    document = shown.document
    assert document.scene.frame_index == 3
    assert document.photo.name == "0003.png"
    assert shown.history is session.history
    assert keys_of(shown) == [0]
    # An object without a pose there stays where it is; the start is where it is now.
    assert document.object.world_from_model is session.document.object.world_from_model
    assert document.object.start is document.object.world_from_model
    assert document.object.result is None
    assert keys_of(after(shown, RIGHT)) == [0, 3]


def test_saved_is_what_was_saved_in_any_frame():
    session = after(make_frames_session(), RIGHT)
    assert session.is_unsaved
    session = replace(session, saved=session.document)
    assert not shown_at(session, 5).is_unsaved
    assert after(shown_at(session, 5), RIGHT).is_unsaved


@pytest.mark.parametrize(
    ("key", "code", "shift", "index"),
    [
        (".", "Period", False, 3),
        (",", "Comma", False, 1),
        (">", "Period", True, COUNT - 1),
        (":", "Period", True, COUNT - 1),
        (".", "Comma", True, 3),  # typed with shift on some keyboards
        ("]", "BracketRight", False, 4),
        ("]", "Digit9", False, 4),
        ("[", "BracketLeft", False, 0),
    ],
)
def test_keys_step_through_frames_and_keys(key: str, code: str, shift: bool, index: int):
    session = shown_at(mended(), 2)
    report = f'{{"kind": "key", "code": "{code}", "key": "{key}", "shift": {str(shift).lower()}}}'
    edit = meaning_of(report)
    assert isinstance(edit, Edit)
    assert after(session, edit).wanted_frame == index


def test_steps_add_up_while_a_photo_is_read():
    session = after(make_frames_session(), step_frame(1), step_frame(1), step_frame(1))
    assert session.wanted_frame == 3
    # The first photo comes meanwhile: it is shown, and the wanted one is still to come.
    file = session.document.scene.frames[1].file
    session = after(session, frame_read(1, file))
    assert session.document.scene.frame_index == 1
    assert session.wanted_frame == 3
    # One that cannot be read stays hidden.
    assert after(session, frame_read(3, None)).wanted_frame is None


def test_a_drag_goes_before_a_frame_that_is_being_read():
    session = after(make_frames_session(), step_frame(1), press(120.0, 90.0))
    file = session.document.scene.frames[1].file
    assert after(session, frame_read(1, file)).document.scene.frame_index == 0


def stale_in(session: Session) -> list[int]:
    """Frames whose pose is stale."""
    return [index for index, pose in enumerate(poses_of(session)) if pose and pose.is_stale]


def test_a_mended_frame_makes_stale_the_poses_beside_it_alone():
    session = mended()
    assert keys_of(session) == [0, 4]
    assert stale_in(session) == [3, 5]
    assert stale_in(after(session, undo())) == []
    # What a key led to that is gone is stale up to the keys beside it.
    removed = after(shown_at(session, 4), edit_frames("remove key"))
    assert stale_in(removed) == [1, 2, 3, 5, 6]


def mending(session: Session, key: int = 4) -> tuple[Session, PropagationRequest]:
    """The session in which poses are mended from a key outwards."""
    request = PropagationRequest(session.document, (0,), key=key)
    return replace(session, propagation=PropagationProgress(request, follows=False)), request


def test_the_pose_beside_the_last_mended_one_is_stale_until_both_agree():
    session, request = mending(mended())
    before, (moved, *_) = poses_of(session), steps(5)
    begun = after(session, propagation_advanced(request, [moved]))
    assert stale_in(begun) == [3, 6]
    assert begun.wanted_frame is None
    agreed = {index: pose for index, pose in enumerate(before) if pose and index in (6, 3)}
    ends = [FrameStep(i, {"1": replace(agreed[i], is_stale=False)}) for i in (6, 3)]
    ended = after(begun, propagation_advanced(request, [moved, *ends], is_over=True))
    assert stale_in(ended) == []
    assert "1 frame mended" in time_line(ended)
    places = [[p and p.world_from_model for p in poses_of(one)] for one in (session, ended)]
    is_kept = [old is new for old, new in zip(*places, strict=True)]
    assert is_kept == [index != 5 for index in range(COUNT)]


def test_frames_are_counted_and_not_poses():
    """Between keys, each frame is searched twice."""
    session = after(shown_at(mended(), 2), edit_frames("between keys"))
    assert session.propagation is not None
    request, both = session.propagation.request, [*steps(1, 2, 3), *steps(3, 2, 1)]
    session = after(session, propagation_advanced(request, both, is_over=True))
    assert "3 frames propagated" in time_line(session)


def test_progress_says_frame_speed_and_time_left():
    session = after(make_frames_session(), RIGHT, edit_frames("to end"))
    assert session.propagation is not None
    pace = Pace(2.0, 6, 4.0)
    edit = propagation_advanced(session.propagation.request, steps(1, 2), pace=pace)
    assert "frame 2 of 6, 0.5 a second, 8 s left" in time_line(after(session, edit))


def test_a_lost_object_loses_its_own_pose_alone():
    session = propagated(after(make_frames_session(), RIGHT), *range(1, COUNT))
    session = after(session, edit_frames("to end"))
    assert session.propagation is not None
    for lost, wanted in (((), COUNT), (("1",), COUNT - 1)):
        step = FrameStep(2, {}, "it is covered", lost)
        done = after(session, propagation_advanced(session.propagation.request, [step]))
        assert sum(map(bool, poses_of(done))) == wanted


def two_objects() -> Session:
    """Keys of two objects in the first frame; the second is active."""
    session = after(make_frames_session(), RIGHT, add_object())
    return after(session, press(60.0, 60.0), drag_to(70.0, 60.0), release())


def test_to_start_and_to_end_are_for_all_objects_unless_one_is_chosen():
    session = two_objects()

    def chosen(*edits: Edit) -> tuple[int, ...]:
        progress = after(session, *edits).propagation
        assert progress is not None
        return progress.request.object_indices

    assert chosen(edit_frames("to end")) == (0, 1)
    assert chosen(edit_frames("to next key")) == (1,)
    assert chosen(edit_frames("alone"), edit_frames("to end")) == (1,)
    assert chosen(edit_frames("alone"), edit_frames("alone"), edit_frames("to end")) == (0, 1)
    assert chosen(alter_object(1, locked=True), edit_frames("to end")) == (1,)
    assert "of all objects" in time_line(session)
    assert "of all objects" not in time_line(make_frames_session())


@pytest.mark.parametrize("key", ["J", "O", "PageUp", "R"])
def test_no_key_moves_the_model_while_frames_are_propagated(key: str):
    session = after(make_frames_session(), RIGHT, edit_frames("to end"))
    code = key if len(key) > 1 else f"Key{key}"
    edit = meaning_of(f'{{"kind": "key", "code": "{code}", "key": "{key.lower()}"}}')
    assert isinstance(edit, Edit)
    assert "Esc" in refused(session, edit)
    assert "Esc" in refused(session, RIGHT)


def test_the_search_key_stops_a_propagation():
    session = after(make_frames_session(), RIGHT, edit_frames("to end"), toggle_search())
    assert not session.is_propagating
    assert not session.is_searching


def arrow(code: str, **held: bool) -> Edit:
    report = {"kind": "key", "code": code, "key": code, **held}
    edit = meaning_of(json.dumps(report))
    assert isinstance(edit, Edit)
    return edit


@pytest.mark.parametrize(
    ("code", "held", "index"),
    [
        ("ArrowRight", {}, 3),
        ("ArrowLeft", {}, 1),
        ("ArrowRight", {"shift": True}, COUNT - 1),
        ("ArrowDown", {}, 4),
        ("ArrowUp", {}, 0),
    ],
)
def test_arrows_step_through_a_sequence(code: str, held: dict[str, bool], index: int):
    session = shown_at(mended(), 2)
    stepped = after(session, arrow(code, **held))
    assert stepped.wanted_frame == index
    assert stepped.document is session.document
    # While poses are propagated, they look elsewhere, and it goes on.
    running = after(session, edit_frames("to end"), arrow(code, **held))
    assert running.is_propagating
    assert running.wanted_frame == index


def test_arrows_move_the_model_with_alt_and_in_a_still_scene():
    session = shown_at(mended(), 2)
    moved = after(session, arrow("ArrowRight", alt=True))
    assert keys_of(moved) == [0, 2, 4]
    assert moved.wanted_frame is None
    still = after(make_session(), arrow("ArrowRight"))
    assert still.document.pose is not make_session().document.pose
    assert_same_pose(still.document.pose, after(make_session(), RIGHT).document.pose, 1e-12)


def test_propagated_poses_are_cleared_and_keys_removed():
    session = shown_at(mended(), 2)
    cleared = after(session, edit_frames("clear between"))
    assert [pose is None for pose in poses_of(cleared)] == [i in (1, 2, 3) for i in range(COUNT)]
    assert cleared.document.object.result is None
    kept = after(session, edit_frames("keep keys"))
    assert [i for i, pose in enumerate(poses_of(kept)) if pose] == [0, 4]
    removed = after(shown_at(session, 4), edit_frames("remove key"))
    assert keys_of(removed) == [0]
    assert poses_of(removed)[4] is None
    for one in (cleared, kept, removed):
        assert poses_of(after(one, undo())) == poses_of(session)


@pytest.mark.parametrize(
    ("what", "first", "last"),
    [("to start", 0, 1), ("to next key", 3, 3), ("to end", 3, COUNT - 1), ("between keys", 1, 3)],
)
def test_a_propagation_has_its_range(what, first: int, last: int):
    session = after(shown_at(mended(), 2), edit_frames(what))
    assert session.propagation is not None
    assert (session.propagation.request.first, session.propagation.request.last) == (first, last)


def test_a_propagation_is_one_undo_step_and_its_end_is_said():
    session = after(make_frames_session(), RIGHT)
    done = propagated(session, 1, 2, 3, note="m.ply is lost: it is covered")
    assert done.propagation is not None
    assert done.propagation.notes == ("m.ply is lost: it is covered",)
    assert [i for i, pose in enumerate(poses_of(done)) if pose] == [0, 1, 2, 3]
    assert done.wanted_frame == 4
    assert poses_of(after(done, undo())) == poses_of(session)


def test_a_propagation_streams_and_follows_until_the_user_looks_elsewhere():
    session = after(make_frames_session(), RIGHT, edit_frames("to end"))
    assert session.propagation is not None
    request, made = session.propagation.request, steps(1, 2, 3)
    session = after(session, propagation_advanced(request, made[:1]))
    assert session.wanted_frame == 1
    elsewhere = after(session, go_to_frame(0.99))
    later = after(elsewhere, propagation_advanced(request, made))
    assert later.wanted_frame == COUNT - 1
    assert [i for i, pose in enumerate(poses_of(later)) if pose] == [0, 1, 2, 3]


@pytest.mark.parametrize("stop", [press(120.0, 90.0), cancel_drag(), edit_frames("stop")])
def test_a_drag_and_escape_stop_a_propagation(stop: Edit):
    session = after(make_frames_session(), RIGHT, edit_frames("to end"))
    assert session.propagation is not None
    request = session.propagation.request
    stopped = after(session, stop)
    assert not stopped.is_propagating
    late = after(stopped, propagation_advanced(request, steps(1, 2)))
    assert poses_of(late)[1] is None


def test_what_cannot_be_propagated_is_said():
    session = make_frames_session()
    assert "has no key" in refused(session, edit_frames("to end"))
    named = replace(session, document=session.document.with_object(name="box.ply"))
    assert refused(named, edit_frames("to end")).startswith("box.ply has no key")
    assert "no frame between" in refused(after(session, RIGHT), edit_frames("to start"))
    locked = session.document.with_object(locked=True)
    assert "locked" in refused(replace(session, document=locked), edit_frames("to end"))


def test_another_camera_leaves_all_poses_where_the_photos_show_them():
    session = mended()
    scene = session.document.scene
    centre = session.document.mesh.centre
    changed = after(session, set_field_of_view(20.0)).document.scene
    assert changed.views[0].camera != scene.views[0].camera
    for old, new in zip(scene.frames, changed.frames, strict=True):
        before, now = (
            own.views[0].pose(frame.poses["1"].world_from_model).project(centre)
            for own, frame in ((scene, old), (changed, new))
        )
        np.testing.assert_allclose(now, before, atol=1e-9)


def test_an_object_that_is_removed_leaves_no_poses():
    session = after(mended(), add_object())
    index = session.document.active
    session = after(session, press(60.0, 60.0), drag_to(70.0, 60.0), release())
    assert "2" in session.document.scene.frames[4].poses
    object_id = int(session.document.scene.objects[index].id)
    removed = after(session, remove_object(object_id))
    assert set(removed.document.scene.frames[4].poses) == {"1"}


def test_undo_reaches_through_many_frames_and_keeps_no_photos():
    session = make_frames_session()
    for index in range(COUNT):
        session = after(shown_at(session, index), RIGHT)
    assert len(session.history.past) == COUNT > MAX_OPENED
    for document in session.history.past:
        assert "photo" not in vars(document.view.file)
    assert after(session, undo(), undo()).document.photo.name == f"{COUNT - 2:04d}.png"
