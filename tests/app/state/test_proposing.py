"""Proposed starts: asked for, stepped through, taken, and undone in one step."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import html
from PIL import Image

from poseviewer.app.page.handles import handles_of, path_of
from poseviewer.app.page.reports import meaning_of
from poseviewer.app.page.status import loss_bar, status_html
from poseviewer.app.page.strip import proposals_row
from poseviewer.app.page.texts import (
    NOT_FOUND,
    PROPOSED_HINT,
    UNSURE_HINT,
    USUAL_HINT,
    hint_of,
    proposals_text,
)
from poseviewer.app.state.document import Document, verdict_of
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.objects import add_object, pick_object
from poseviewer.app.state.results import ProposedStarts
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import propose_and_fit as made
from poseviewer.app.workers.jobs import start_query
from poseviewer.confidence.verdict import Verdict
from poseviewer.files.demo import demo_case
from poseviewer.files.mesh.named import NO_TEXTURE
from poseviewer.files.photo import load_photo
from poseviewer.files.scene_assets import load_model
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.assets import ModelFile
from poseviewer.starts.automatic import PoseHypothesis
from tests.app.state import edits as c
from tests.app.state.documents import (
    CAR,
    PERSPECTIVE,
    after,
    assert_same_pose,
    make_document,
    make_photo,
    make_session,
    open_files,
)
from tests.starts.backbone import save_random_backbone

POSES = tuple(
    Pose(PERSPECTIVE, RigidTransform.from_rotation_vector([turn, 0.1, 0.2], [0.1, 0.0, 7.0]))
    for turn in (0.1, 1.0, 2.0)
)
STARTS = tuple(PoseHypothesis(pose, 1.0, 0.3) for pose in POSES)
OUTLINES = tuple(
    np.array([[[20.0, 30.0 + i], [60.0, 30.0]], [[60.0, 30.0], [60.0, 50.0]]]) for i in range(3)
)


def nowhere(**more: bool) -> Session:
    """A model without a pose has been opened on a photo."""
    document = make_document().with_object(is_placed=False)
    return after(make_session(), c.open_document(document, **more))


def listed_in(session: Session, document: Document | None = None) -> Session:
    """The session after the starts at a document, by default its own, are found."""
    proposals = ProposedStarts(document or session.document, STARTS, OUTLINES)
    return after(session, c.list_starts(proposals))


def proposed(session: Session) -> Session:
    return listed_in(after(session, c.propose_starts()))


def test_starts_are_looked_for_in_a_box_that_is_seen_meanwhile():
    session = after(make_session(), c.set_tool("box"), c.press(20, 15), c.drag_to(90, 300))
    box = session.document.marks.box
    assert box == session.shown_box == (20, 15, 70, 105)  # cut to the photo of 160 x 120
    drawn = after(session, c.release())
    assert (drawn.tool, drawn.shown_box) == ("pose", box)
    assert drawn.proposals is not None
    assert drawn.is_proposing
    assert start_query(drawn.proposals.document).rectangle == box
    seen = drawn.document.pose.project(drawn.document.mesh.vertices)
    assert np.all((seen > [19, 14]) & (seen < [91, 121]))  # and the model is there already
    assert np.max(np.ptp(seen, axis=0) / [70, 105]) == pytest.approx(1.0, rel=0.01)
    for ending in (c.stop_proposing(), c.cancel_drag()):
        assert after(drawn, ending).shown_box is after(drawn, ending).proposals is None
    assert after(drawn, c.undo()).document is drawn.history.past[0]
    found = listed_in(drawn)
    searching = after(found, c.start_search())
    assert (found.shown_box, searching.shown_box) == (box, None)
    stopped = after(searching, c.stop_search())
    assert after(stopped, c.revert_search()).shown_box == box  # another proposal?
    assert after(stopped, c.accept_search()).proposals is None


def test_proposals_are_stepped_through_in_one_step_of_the_history():
    session = make_session()
    first = proposed(session)
    assert_same_pose(first.document.pose, POSES[0])
    second = after(first, c.step_proposals(1))
    assert_same_pose(second.document.pose, POSES[1])
    assert_same_pose(after(first, c.step_proposals(-1)).document.pose, POSES[2])
    assert after(second, c.undo()).document is session.document
    # What is moved by hand is a step of its own, and the proposals stay at hand.
    moved = after(second, c.nudge("move", 1.0), c.step_proposals(1))
    assert_same_pose(moved.document.pose, POSES[2])
    assert_same_pose(after(moved, c.undo(), c.undo()).document.pose, POSES[1])


def test_the_one_that_is_pressed_becomes_the_start():
    session = make_session()
    first = proposed(session)
    row = proposals_row(first)
    assert row.count("<image") == row.count("30 %") == 3
    press = {"kind": "start", "index": 2}
    assert json.loads(html.fromstring(row).xpath("//@data-report")[2]) == press
    pressed = meaning_of(json.dumps(press))
    assert isinstance(pressed, Edit)
    taken = after(first, pressed)
    assert_same_pose(taken.document.pose, POSES[2])
    assert_same_pose(taken.document.start, POSES[2])
    marked = [button.split(">")[0] for button in proposals_row(taken).split("<button")[1:]]
    assert ["pv-at" in button for button in marked] == [False, False, True]
    assert after(taken, c.undo()).document is session.document
    assert after(taken, c.take_start(3)) is taken
    assert proposals_row(session) == ""


def test_proposals_for_an_object_wait_while_another_one_is_active():
    first = proposed(after(make_session(), add_object(), pick_object(1)))
    other = after(first, pick_object(2))
    assert other.is_looking  # it was just added
    again = after(other, pick_object(1), c.step_proposals(1))
    assert_same_pose(again.document.pose, POSES[1])
    assert after(again, pick_object(2)).is_proposing  # these are still looked for
    # Another model, or photo, is another matter.
    replaced = other.document.with_object(0, model=ModelFile.of(CAR))
    changed = replace(other, document=replaced)
    assert after(changed, pick_object(1)).proposals is None


def test_old_news_and_other_photos_change_nothing():
    session = after(make_session(), c.propose_starts())
    assert session.proposals is not None
    assert after(session, c.propose_starts()).proposals is None  # its button ends it
    asked, other = session.proposals.document, make_document(photo=make_photo(1))
    assert listed_in(session, other) is session
    opened = listed_in(after(session, c.open_document(other)), asked)
    assert opened.document is other
    assert opened.proposals is None


def test_a_model_without_a_pose_is_looked_for_until_somebody_places_it():
    session = nowhere()
    assert session.is_looking
    for edit in (c.press(80, 60), c.cancel_drag(), c.view_from("front")):
        assert not after(session, edit).is_proposing
    assert after(session, c.set_tool("box"), c.show_style("solid")).is_looking
    assert after(session, c.toggle_box()).tool == "box"
    assert after(session, c.press(80, 60), c.release()).document.object.is_placed
    assert after(make_session(), add_object()).is_looking
    # A pose, and a session that is restored, are the user's.
    for known in (make_session(), nowhere(unsaved=True)):
        assert not known.is_proposing
    assert not after(make_session(), c.open_document(make_document())).is_proposing


def test_a_model_that_is_nowhere_shows_nothing_but_the_likeliest_proposal():
    session = nowhere()
    assert "pv-pin" not in handles_of(replace(session, tool="pose"))
    assert loss_bar(session) is None
    assert "The model is not placed yet." in status_html(session, "")
    listed = listed_in(session)
    first, second = (path_of(lines) for lines in OUTLINES[:2])
    for shown in (listed, after(listed, c.stop_proposing())):
        assert first in handles_of(shown)
        assert second not in handles_of(shown)
    assert hint_of(listed) == PROPOSED_HINT
    assert first not in handles_of(after(listed, c.take_start(1)))
    assert first not in handles_of(after(listed, c.toggle_model()))


def test_a_press_places_the_model_and_the_drag_goes_on_with_it():
    session = nowhere()
    pressed = after(session, c.press(80.0, 60.0))
    dragged = after(pressed, c.drag_to(95.0, 50.0), c.release())
    for placed, at in ((pressed, (80.0, 60.0)), (dragged, (95.0, 50.0))):
        document = placed.document
        assert document.pose.project(document.mesh.centre) == pytest.approx(at, abs=1e-6)
    assert after(dragged, c.undo(), c.undo()).document is session.document


def test_what_is_only_proposed_places_nothing():
    session = nowhere()
    document, listed = session.document, listed_in(session)
    assert listed.is_looking  # the best of them is fitted now
    assert not listed.document.object.is_placed
    assert "pv-at" not in proposals_row(listed)
    for by, index in ((1, 0), (-1, 2)):
        taken = after(listed, c.step_proposals(by))
        assert_same_pose(taken.document.pose, POSES[index])
        assert not taken.is_proposing
        assert after(taken, c.undo()).document is document
    nothing = after(session, c.list_starts(ProposedStarts(document, (), ())))
    assert not nothing.is_proposing
    assert hint_of(nothing).startswith(f"{NOT_FOUND}<b>press where")
    pressed = after(listed, c.press(80, 60), c.release())
    assert proposals_row(pressed).count("<image") == 3
    assert_same_pose(after(pressed, c.take_start(1)).document.pose, POSES[1])


def test_what_would_help_is_said_at_once_for_each_kind_of_model():
    car = replace(load_model(demo_case().model), path=None)
    notes = ("Normals were made.", NO_TEXTURE.format("wood.png"))
    lacking = replace(make_document().model.mesh, notes=notes)
    for model, helps in (
        (car.with_content(keypoints=None), "mark the wheels of the model"),
        (car, "Fit to box"),
        (make_document().model, "Fit to box"),
        (
            make_document().model.with_content(mesh=lacking),
            "texture <b>wood.png</b> is missing",
        ),
    ):
        document = make_document().with_object(model=model, is_placed=False)
        looking = after(make_session(), c.open_document(document))
        assert helps in hint_of(looking)
        nothing = after(looking, c.list_starts(ProposedStarts(looking.document)))
        assert hint_of(nothing).startswith(NOT_FOUND)
        assert helps in hint_of(nothing)
        unsure = after(listed_in(looking), c.stop_proposing())
        assert hint_of(unsure).startswith(UNSURE_HINT)
        assert (helps in hint_of(unsure)) is ("wheels" in helps)
        # A model that is placed is told about once: the next step takes the line away.
        placed = Session(document.with_object(is_placed=True))
        asked = after(placed, c.propose_starts())
        none = after(asked, c.list_starts(ProposedStarts(asked.document)))
        assert helps in hint_of(none)
        assert hint_of(after(none, c.nudge("move", 1.0))) == USUAL_HINT


@pytest.fixture(scope="module")
def edits(scene) -> tuple[Session, list[Edit]]:
    """A model that is nowhere on its photo, and what the search for it brings."""
    document = open_files(scene.photo, scene.model, None)
    session = Session(document.with_in_view(region=Rectangle(0, 0, 160, 120))).with_first_proposals
    return session, list(made(session.document, lambda: None))


@pytest.mark.slow
@pytest.mark.long
def test_a_network_proposes_what_texture_and_wheels_do_not(scene, tmp_path: Path):
    """Random weights propose something; whether it is right is tested with a trained network."""
    document = open_files(scene.photo, scene.model, None)
    session = Session(document).with_first_proposals
    none = after(session, *made(document, lambda: None)).proposals
    assert none is not None
    assert not none.starts
    save_random_backbone(tmp_path / "model.safetensors")
    listing, fitting = made(document, lambda: None, tmp_path / "model.safetensors")
    listed = after(session, listing).proposals
    assert listed is not None
    assert listed.starts
    _, request, _, index = fitting.arguments
    assert request.start.object.doubt == listed.starts[index].doubt


@pytest.mark.slow
@pytest.mark.long
def test_a_focal_length_that_wheels_guess_is_searched_for(tmp_path: Path):
    demo, photo = demo_case(), tmp_path / "photo.jpg"
    Image.open(demo.photo).resize((320, 240)).save(photo, quality=95)  # without EXIF
    document = open_files(photo, demo.model, None)
    session = Session(document).with_first_proposals
    found = after(session, *made(document, lambda: None))
    camera = found.document.pose.camera
    assert isinstance(camera, Perspective)
    assert camera.fx == pytest.approx(load_photo(demo.photo).default_camera().fx / 3, rel=0.1)
    assert found.document.settings == document.settings


@pytest.mark.slow
@pytest.mark.long
def test_a_model_that_is_found_is_placed_in_one_step(edits):
    session, (listing, fitting) = edits
    document, asked, latest, index = fitting.arguments
    listed = after(session, listing)
    assert not listed.document.object.is_placed
    # The camera is assumed, and the photo shows that the model's proportions do not go with it.
    result = replace(latest.best.objects[0].result, verdict=Verdict("found", 0.95))
    sure = replace(latest, scene=latest.scene.with_object(0, result=result))
    found = after(listed, c.take_fitted_start(document, asked, sure, index))
    assert (verdict_of(found.document.object), found.is_proposing) == ("found", False)
    assert_same_pose(found.document.pose, latest.progress.pose)
    assert found.search is not None
    assert not found.is_searching
    for back in (c.undo(), c.revert_search()):
        assert after(found, back).document is session.document


@pytest.mark.slow
@pytest.mark.long
def test_a_fit_that_is_not_sure_or_not_asked_for_any_more_places_nothing(edits):
    session, (listing, fitting) = edits
    document, asked, latest, index = fitting.arguments
    result = replace(latest.best.objects[0].result, verdict=Verdict("doubtful", 0.5))
    unsure = replace(latest, scene=latest.scene.with_object(0, result=result))
    listed = after(session, listing)
    left = after(listed, c.take_fitted_start(document, asked, unsure, index))
    assert (left.document, left.is_proposing) == (session.document, False)
    assert "none of them sure" in proposals_text(left)
    for edit in (c.press(80, 60), c.cancel_drag()):
        by_hand = after(listed, edit)
        assert after(by_hand, fitting).document is by_hand.document
    # It was fitted on other pixels.
    region = listed.document.with_in_view(region=Rectangle(0, 0, 160, 60))
    changed = replace(listed, document=region)
    assert after(changed, fitting).document is region
