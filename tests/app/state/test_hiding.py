"""What is painted over, or taken off the model, does not count; all of it can be undone."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.state import hiding as h
from poseviewer.app.state.document import Document, verdict_of
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.objects import add_object, pick_object
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import run_search
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.geometry.mask import Mask
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.settings import FitSettings, Limits
from poseviewer.scene.types import SearchResult
from tests.app.state import edits as c
from tests.app.state.documents import (
    HEIGHT,
    PERSPECTIVE,
    WIDTH,
    after,
    asked_of,
    make_photo,
    make_session,
    open_files,
    refused,
)
from tests.meshes import make_two_boxes


def brush(*points: tuple[float, float], radius: float = 5.0, erase: bool = False) -> Edit:
    return h.paint(h.Stroke("brush", np.array(points), radius, erase))


def counts(session: Session) -> np.ndarray:
    mask = session.document.mask
    return np.ones((HEIGHT, WIDTH)) if mask is None else mask.weights


def with_two_parts() -> Session:
    return make_session(PERSPECTIVE, mesh=make_two_boxes())


def test_strokes_hide_what_they_cover_and_bring_it_back():
    session = after(make_session(PERSPECTIVE), brush((40.5, 30.5), (80.5, 30.5), radius=6.0))
    hidden = counts(session) == 0.0
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    away = np.hypot(u - np.clip(u, 40.5, 80.5), v - 30.5)
    assert hidden[away < 5.5].all()
    assert not hidden[away > 7.0].any()
    assert set(np.unique(counts(session))) == {0.0, 1.0}
    again = after(session, brush((40.5, 30.5), radius=5.0))
    assert again.document is session.document  # nothing has changed: no step
    assert again.pen.strokes == session.pen.strokes + 1  # the page need not show it any longer
    part = after(session, brush((40.5, 30.5), radius=4.0, erase=True))
    assert counts(part)[30, 40] == 1.0
    assert counts(part)[30, 60] == 0.0
    corners = np.array([[20.0, 20.0], [60.0, 20.0], [60.0, 50.0], [20.0, 50.0]])
    session = after(make_session(PERSPECTIVE), h.paint(h.Stroke("polygon", corners, 1.0)))
    hidden = counts(session) == 0.0
    assert hidden[21:49, 21:59].all()
    assert not hidden[:19].any()
    assert not hidden[:, 62:].any()


def test_pixels_found_for_another_photo_are_dropped():
    session = make_session(PERSPECTIVE)
    where = np.zeros((HEIGHT, WIDTH), bool)
    where[10:20, 10:20] = True
    own = session.document.photo
    assert np.sum(counts(after(session, h.mask_pixels(own, where))) == 0.0) == 100
    other = after(session, h.mask_pixels(make_photo(7), where))
    assert other.document is session.document


def test_the_part_that_is_pressed_is_left_out_and_comes_back():
    session = with_two_parts()
    mesh, pose = session.document.mesh, session.document.pose
    body, mirror = (pose.project(mesh.part_vertices(name).mean(axis=0)) for name in mesh.part_names)
    without = after(session, c.set_tool("part"), c.press(*mirror))
    assert after(without, c.double_press(*mirror)) is without
    assert "nothing would be left" in refused(without, h.leave_out(*body)).lower()
    assert refused(session, h.leave_out(1.0, 1.0)).startswith("There is no model there")
    assert without.document.mesh.left_out == ("mirror",)
    assert without.document.pose is pose
    assert after(without, h.bring_back(0)).document.mesh is mesh
    assert after(without, c.undo()).document.mesh is mesh
    assert after(without, h.bring_back(5)).document is without.document


def test_undo_reaches_over_many_parts():
    session = with_two_parts()
    mesh, pose = session.document.mesh, session.document.pose
    mirror = pose.project(mesh.part_vertices("mirror").mean(axis=0))
    start = session.document
    for _ in range(6):  # each a mesh of its own, all of one model
        session = after(session, h.leave_out(*mirror), h.bring_back(0))
    assert after(session, *[c.undo()] * 12).document is start


def ended_search(scene, columns: int = WIDTH // 2) -> Session:
    """A session whose search has just ended, and took some columns at the photo's left for
    something in front.
    """
    opened = open_files(scene.photo, scene.model, scene.start)
    settings = FitSettings(limits=Limits(5))
    session = after(Session(opened.with_object(settings=settings)), c.start_search())
    *_, last = run_search(asked_of(session))
    document = c.with_progress(session.document, last)
    result = document.object.result
    assert result is not None
    hidden = np.zeros((HEIGHT, WIDTH), bool)
    hidden[:, :columns] = True
    seen = share_seen(document, Mask.of(~hidden))
    result = replace(result, hidden=(hidden,), seen=(seen,))
    found = replace(last, scene=last.scene.with_object(0, result=result))
    return after(session, c.search_advanced(asked_of(session), found))


def share_seen(document: Document, mask: Mask | None) -> float:
    """The share of the active model that a mask leaves."""
    covered = SoftwareRenderer(document.mesh).render_mask(document.pose)
    return 1.0 if mask is None else float(np.mean(mask.weights[covered] > 0.0))


def test_what_a_search_found_is_hidden_and_can_be_corrected(scene):
    session = ended_search(scene, 20)
    found = h.occlusion_pixels(session)
    assert found is not None
    assert np.mean(found) == pytest.approx(20 / WIDTH)
    assert session.document.scene.mask(0) is None  # nothing is painted
    occluders = session.document.scene.occluders(0)
    assert occluders is not None
    assert np.array_equal(occluders.weights == 0.0, found)
    taken = after(session, h.hide_found())
    assert np.array_equal(counts(taken) == 0.0, found)
    assert h.occlusion_pixels(taken) is None  # it is painted now: erase corrects it
    corrected = after(taken, brush((0.0, 0.0), radius=300.0, erase=True))
    assert not any(h.masks_of(corrected))
    assert not any(h.masks_of(after(taken, c.undo())))


def test_what_is_painted_is_hidden_from_every_object_or_from_one_alone():
    session = after(make_session(PERSPECTIVE), brush((40.5, 30.5)), add_object())
    assert np.sum(counts(session) == 0.0) > 50  # of the object that came later, too
    result = SearchResult(loss=0.1, unexplained=0.1)
    searched = replace(session, document=session.document.with_object(0, result=result))
    alone = after(searched, c.set_fields("pen", for_one=True), brush((90.5, 60.5)))
    assert counts(alone)[60, 90] == 0.0
    other = after(alone, pick_object(1))
    assert counts(other)[60, 90] == 1.0
    assert other.document.object.result is result  # its pixels are as they were
    painted = after(other, c.set_fields("pen", for_one=False), brush((60.5, 90.5)))
    assert [one.result for one in painted.document.scene.objects] == [None, None]
    # Erasing shows what is seen to be hidden, whatever hides it; a part is undone alone.
    erased = after(
        alone, c.set_fields("pen", for_one=False), brush((90.5, 60.5), radius=9.0, erase=True)
    )
    assert counts(erased)[60, 90] == 1.0
    assert counts(erased)[30, 40] == 0.0
    assert counts(after(alone, h.unhide()))[30, 40] == 0.0
    assert not any(h.masks_of(after(alone, c.set_fields("pen", for_one=False), h.unhide())))


def test_an_object_keeps_its_verdict_where_strokes_change_none_of_its_pixels():
    session, result = make_session(PERSPECTIVE), SearchResult(loss=0.1, unexplained=0.1)
    session = replace(session, document=session.document.with_object(result=result))
    at_edge = brush((2.5, 60.5), radius=3.0)
    beside = after(session, at_edge)
    assert beside.document.object.result is result
    assert after(beside, brush((80.5, 60.5))).document.object.result is None
    whole = after(session, c.alter_settings(lambda now: replace(now, pixels="whole")), at_edge)
    assert whole.document.object.result is None


def test_nothing_is_hidden_where_the_user_says_so_until_more_is_painted():
    nothing = c.alter_settings(lambda now: replace(now, in_front="nothing"))
    session = after(make_session(PERSPECTIVE), brush((40.5, 30.5)), nothing)
    assert np.all(counts(session) == 1.0)
    assert any(h.masks_of(session))  # it is kept
    painted = after(session, brush((80.5, 30.5)))
    assert painted.document.settings.in_front == "painted"
    assert counts(painted)[30, 40] == counts(painted)[30, 80] == 0.0


def record_of(session: Session) -> PoseRecord:
    return pose_json(as_saved(session.document.scene), session.document.active, 0)


def test_what_is_saved_as_seen_is_what_the_mask_leaves(scene):
    session = ended_search(scene)
    for now in (
        session,
        after(session, c.accept_search()),
        after(session, h.hide_found()),
        after(session, c.accept_search(), h.hide_found()),
        after(session, add_object(), c.nudge("move", 9.0), pick_object(1)),
        after(session, h.hide_found(), add_object(), c.nudge("move", 9.0), pick_object(1)),
    ):
        record, active = record_of(now), now.document.active
        masks = now.document.scene.mask(active), now.document.scene.occluders(active)
        mask = Mask.product([*filter(None, masks)])
        assert record.verdict is not None
        assert record.seen is not None
        assert 0.2 < record.seen < 0.8
        assert record.seen == pytest.approx(share_seen(now.document, mask), abs=0.03)
        assert verdict_of(now.document.object) == record.verdict.label
    # Painting asks for another search, and takes its word from the one before.
    painted = after(session, c.accept_search(), brush((150.0, 10.0)))
    assert record_of(painted).seen is None
    assert verdict_of(painted.document.object) == "not searched"
