"""What is painted over, or taken off the model, does not count; all of it can be undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.api import make_case
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state.document import Document
from poseviewer.app.state.objects import AddObject, PickObject
from poseviewer.app.state.session import Search, SearchUpdate, Session
from poseviewer.app.state.update import update
from poseviewer.app.workers.autosaving import Autosaver
from poseviewer.app.workers.exporting import record_of, scene_of
from poseviewer.app.workers.opening import open_scene, restore
from poseviewer.files.state.autosave import load_autosave
from poseviewer.fit.settings import FitSettings, Limits
from poseviewer.geometry.mask import Mask
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.starts.registration import load_registration
from tests.app.state.documents import HEIGHT, PERSPECTIVE, WIDTH, after, make_photo, make_session
from tests.meshes import make_two_boxes


def brush(*points: tuple[float, float], radius: float = 5.0, erase: bool = False) -> h.Paint:
    return h.Paint(h.Stroke("brush", np.array(points), radius, erase))


def counts(session: Session) -> np.ndarray:
    mask = session.document.registration.mask
    return np.ones((HEIGHT, WIDTH)) if mask is None else mask.weights


def with_two_parts() -> Session:
    return make_session(PERSPECTIVE, mesh=make_two_boxes())


def test_a_brush_hides_what_lies_within_its_radius():
    session = after(make_session(PERSPECTIVE), brush((40.5, 30.5), (80.5, 30.5), radius=6.0))
    hidden = counts(session) == 0.0
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    away = np.hypot(u - np.clip(u, 40.5, 80.5), v - 30.5)
    assert hidden[away < 5.5].all()
    assert not hidden[away > 7.0].any()
    assert set(np.unique(counts(session))) == {0.0, 1.0}


def test_a_polygon_hides_its_inside():
    corners = np.array([[20.0, 20.0], [60.0, 20.0], [60.0, 50.0], [20.0, 50.0]])
    session = after(make_session(PERSPECTIVE), h.Paint(h.Stroke("polygon", corners, 1.0)))
    hidden = counts(session) == 0.0
    assert hidden[21:49, 21:59].all()
    assert not hidden[:19].any()
    assert not hidden[:, 62:].any()


def test_what_is_erased_counts_again():
    session = after(make_session(PERSPECTIVE), brush((40.0, 30.0), radius=10.0))
    part = after(session, brush((40.0, 30.0), radius=4.0, erase=True))
    assert counts(part)[30, 40] == 1.0
    assert counts(part)[30, 48] == 0.0
    everything = after(part, brush((40.0, 30.0), radius=20.0, erase=True))
    assert everything.document.registration.mask is None


def test_a_stroke_that_changes_nothing_is_no_step():
    session = after(make_session(PERSPECTIVE), brush((40.0, 30.0)))
    again = after(session, brush((40.0, 30.0)))
    assert again.document is session.document
    assert len(again.history.past) == len(session.history.past)
    assert again.strokes == session.strokes + 1  # the page need not show it any longer


def test_strokes_are_undone_and_redone():
    start = make_session(PERSPECTIVE)
    one = after(start, brush((40.0, 30.0)))
    two = after(one, brush((90.0, 70.0)))
    back = after(two, c.Undo())
    assert np.array_equal(counts(back), counts(one))
    assert after(back, c.Undo()).document.registration.mask is None
    assert np.array_equal(counts(after(back, c.Redo())), counts(two))
    cleared = after(two, h.Unhide())
    assert cleared.document.registration.mask is None
    assert np.array_equal(counts(after(cleared, c.Undo())), counts(two))


def test_shades_of_a_mask_stay_where_nothing_is_painted():
    session = make_session(PERSPECTIVE)
    shades = Mask.of(np.full((HEIGHT, WIDTH), 0.25))
    session = replace(session, document=session.document.compared_by(mask=shades))
    painted = after(session, brush((40.0, 30.0)))
    assert counts(painted)[30, 40] == 0.0
    assert counts(painted)[100, 100] == 0.25


def test_a_stroke_ends_a_search_and_is_unsaved():
    session = make_session(PERSPECTIVE)
    session = after(session, c.Saved(session.document))
    assert not session.unsaved
    searching = after(session, c.StartSearch())
    painted = after(searching, brush((40.0, 30.0)))
    assert painted.search is None
    assert painted.unsaved
    assert not after(painted, c.Saved(painted.document)).unsaved


def test_pixels_found_for_another_photo_are_dropped():
    session = make_session(PERSPECTIVE)
    where = np.zeros((HEIGHT, WIDTH), bool)
    where[10:20, 10:20] = True
    own = session.document.registration.photo
    assert np.sum(counts(after(session, h.PaintFound(own, where))) == 0.0) == 100
    other = after(session, h.PaintFound(make_photo(7), where))
    assert other.document is session.document


def test_the_part_that_is_pressed_is_left_out_and_comes_back():
    session = with_two_parts()
    mesh, pose = session.document.registration.mesh, session.document.pose
    mirror = pose.project(mesh.part_vertices("mirror").mean(axis=0))
    without = after(session, h.LeaveOut(*mirror))
    assert without.document.registration.mesh.left_out == ("mirror",)
    assert without.document.pose is pose
    assert after(without, h.BringBack(0)).document.registration.mesh is mesh
    assert after(without, c.Undo()).document.registration.mesh is mesh
    assert after(without, h.BringBack(5)).document is without.document


def test_the_last_part_and_the_background_are_refused():
    session = with_two_parts()
    mesh, pose = session.document.registration.mesh, session.document.pose
    places = [pose.project(mesh.part_vertices(name).mean(axis=0)) for name in mesh.part_names]
    one = after(session, h.LeaveOut(*places[1]))
    refused = update(one, h.LeaveOut(*places[0]))
    assert refused.document is one.document
    assert "nothing would be left" in refused.error_message.lower()
    beside = update(session, h.LeaveOut(1.0, 1.0))
    assert beside.document is session.document
    assert beside.error_message.startswith("There is no model there")


def test_undo_reaches_over_many_parts():
    session, start = with_two_parts(), None
    for _ in range(6):  # each a mesh of its own, all of one model
        start = start or session.document
        mesh, pose = session.document.registration.mesh, session.document.pose
        mirror = pose.project(mesh.part_vertices("mirror").mean(axis=0))
        session = after(session, h.LeaveOut(*mirror), h.BringBack(0))
    for _ in range(12):
        session = after(session, c.Undo())
    assert session.document is start


def with_found_hidden(scene, corner: int) -> Session:
    """A session whose search has ended, and took a corner of the photo for something in front."""
    registration = load_registration(scene.photo, scene.model, scene.start)
    case = make_case(registration, FitSettings(limits=Limits(5)))
    (*_, progress) = case.search()
    hidden = np.zeros(case.problem.photo.weights.shape, bool)
    hidden[:corner, :corner] = True
    update_ = SearchUpdate(case, replace(progress, hidden=hidden), (progress,))
    document = Document(registration, progress.pose, case.settings)
    ended = Search(1, document, registration.start, (case.settings,), False, update_)
    return replace(Session(document), search=ended)


def test_what_a_search_found_is_saved_and_can_be_corrected(scene):
    session = with_found_hidden(scene, 20)
    found = h.found_hidden(session)
    assert found is not None
    assert found.shape == (HEIGHT, WIDTH)
    share = np.mean(found)
    assert share > 0.0
    mask = h.compared_mask(session)
    assert mask is not None
    assert np.array_equal(mask.weights == 0.0, found)
    taken = after(session, h.TakeFound())
    assert np.array_equal(counts(taken) == 0.0, found)
    assert h.found_hidden(taken) is None  # it is painted now: erase corrects it
    corrected = after(taken, brush((0.0, 0.0), radius=300.0, erase=True))
    assert corrected.document.registration.mask is None
    assert after(taken, c.Undo()).document.registration.mask is None


def test_without_a_search_nothing_is_found():
    session = make_session(PERSPECTIVE)
    assert h.found_hidden(session) is None
    assert h.compared_mask(session) is None
    assert after(session, h.TakeFound()).document is session.document


def ended_search(scene) -> Session:
    """A session whose search has just ended, and took the photo's left half for something in
    front.
    """
    registration = load_registration(scene.photo, scene.model, scene.start)
    settings = FitSettings(limits=Limits(5))
    document = Document(
        registration,
        registration.start,
        settings,
        model_path=scene.model,
        photo_path=scene.photo,
    )
    session = after(Session(document), c.StartSearch())
    case = make_case(registration, settings)
    (*_, progress) = case.search()
    hidden = np.zeros(case.problem.photo.weights.shape, bool)
    hidden[:, : hidden[0].size // 2] = True
    found = SearchUpdate(case, replace(progress, hidden=hidden), (progress,))
    return after(session, c.SearchAdvanced(session.searches, found))


def share_seen(session: Session, mask: Mask | None) -> float:
    """Of the picked model, what a mask leaves."""
    covered = SoftwareRenderer(session.document.registration.mesh).covers(session.document.pose)
    return 1.0 if mask is None else float(np.mean(mask.weights[covered] > 0.0))


def test_what_is_saved_as_seen_is_what_the_mask_leaves(scene):
    session = ended_search(scene)
    for now in (
        session,
        after(session, c.AcceptSearch()),
        after(session, h.TakeFound()),
        after(session, c.AcceptSearch(), h.TakeFound()),
        after(session, AddObject(), c.Nudge("move", 9.0), PickObject(1)),
        after(session, h.TakeFound(), AddObject(), c.Nudge("move", 9.0), PickObject(1)),
    ):
        record, mask = record_of(now), h.compared_mask(now)
        assert record.verdict is not None
        assert record.seen is not None
        assert 0.2 < record.seen < 0.8
        assert record.seen == pytest.approx(share_seen(now, mask), abs=0.03)
        assert now.document.verdict == record.verdict.word
    # Painting asks for another search, and takes its word from the one before.
    painted = after(session, c.AcceptSearch(), brush((150.0, 10.0)))
    assert record_of(painted).seen is None
    assert painted.document.verdict == "not searched"


def test_each_object_keeps_what_is_hidden_of_it(scene, tmp_path):
    found = after(ended_search(scene), c.AcceptSearch())
    session = after(found, AddObject(), c.Nudge("move", 9.0), brush((80.0, 60.0), radius=9.0))
    own, other = session.document.compared_mask, session.document.others[0].compared_mask
    assert own is not None
    assert other is not None
    in_front = h.found_hidden(found)
    assert in_front is not None
    assert np.array_equal(other.weights == 0.0, in_front)

    def same(one: Mask | None, another: Mask) -> bool:
        return one is not None and np.array_equal(one.weights, another.weights)

    back = after(session, PickObject(1))
    assert same(h.compared_mask(back), other)
    assert same(back.document.others[0].compared_mask, own)
    assert same(h.compared_mask(after(back, PickObject(2))), own)
    # After a crash, and in a scene file, whichever is picked.
    for name, now in (("picked", session), ("other", back)):
        state = tmp_path / name
        autosaver = Autosaver(state)
        autosaver.close(now)
        (path,) = (state / "sessions").iterdir()
        (opened,) = restore(load_autosave(path))
        saved = open_scene(autosaver.save_scene(now, *scene_of(now)))
        for document in (opened.document, saved.document):
            first, second = document.objects
            assert same(first.compared_mask, other)
            assert same(second.compared_mask, own)
            assert first.searched is not None
            assert first.searched.record.seen == pytest.approx(record_of(back).seen)
