"""Texts of the panel on a session."""

import html
import json
from dataclasses import replace

import numpy as np
import pytest
from lxml import html as lxml_html

from poseviewer.app.page.above_steps import objects_list, parts_left_out
from poseviewer.app.page.controls import plain
from poseviewer.app.page.measure_panel import relative_html
from poseviewer.app.page.reports import meaning_of
from poseviewer.app.page.result import result_html
from poseviewer.app.page.status import status_html
from poseviewer.app.page.texts import (
    SEARCHING_HINT,
    SIZE_HINT,
    USUAL_HINT,
    files_text,
    focal_note,
    hint_of,
    loss_text,
    marks_text,
    notes_text,
    occlusion_text,
    offer_text,
    verdict_text,
)
from poseviewer.app.page.time_line import time_line
from poseviewer.app.state import hiding as h
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.results import LossReading, Results
from poseviewer.app.workers.exporting import scene_to_save
from poseviewer.app.workers.saving import make_autosave
from poseviewer.confidence.verdict import Verdict, percent_right
from poseviewer.errors import percent
from poseviewer.files.scene_json import as_saved, pose_json
from poseviewer.losses.default_loss import UnexplainedScale
from poseviewer.losses.loss import Unexplained
from poseviewer.scene.types import SearchResult
from tests.app.sequences import make_sequence
from tests.app.state import edits as c
from tests.app.state.documents import PERSPECTIVE, after, held, make_photo, make_session
from tests.app.state.test_objects import with_two
from tests.meshes import make_two_boxes


def test_a_focal_length_that_is_a_guess_is_said_in_the_panel_and_in_the_file():
    assumed = make_photo().default_camera()
    for camera, guessed in ((assumed, True), (PERSPECTIVE, False)):
        session = make_session(camera)
        assert ("is assumed" in focal_note(session)) == guessed
        notes = pose_json(as_saved(scene_to_save(session))).notes
        assert any("is assumed" in note for note in notes) == guessed
    by_wheels = replace(assumed, fx=4.2 * assumed.fx, fy=4.2 * assumed.fy)
    assert "rough guess by the wheels" in focal_note(make_session(by_wheels))


@pytest.mark.parametrize(
    "name",
    ["<img src=x onerror=alert(1)>.png", "![x](/etc/hostname)", "*a* `b` _c_ [d](e) | ~~f~~"],
)
def test_no_name_is_markup_to_the_page(name: str):
    """The page renders HTML in markdown, scripts too, and viser reads the files of pictures."""
    shown = plain(name)
    assert not set("<>*`[]!|~") & set(shown)
    assert html.unescape(shown) == name
    assert plain("demo_photo.jpg (1): 2 & 3") == "demo_photo.jpg (1): 2 &amp; 3"
    session = make_session()
    losses = LossReading(session.at_pose, note=f"{name}: no loss")
    document = session.document.with_marks(note=name)
    session = replace(session, results=Results(losses=losses), document=document, tool="pairs")
    assert shown in marks_text(session)
    assert name not in marks_text(session)
    worked = after(session, c.nudge("move", 1.0))
    (said,) = lxml_html.fromstring(status_html(worked, "")).xpath("//p")
    assert said.text_content() == f"{name}: no loss"


def test_what_files_say_is_text_in_every_piece_of_the_page():
    odd = "<img src=x onerror='a()'>\"&amp;"
    session, document = with_two(), make_sequence()
    objects = [
        replace(item, name=odd, model=replace(item.model, unit=odd))
        for item in session.document.scene.objects
    ]
    scene = replace(session.document.scene, objects=tuple(objects))
    session = replace(session, document=replace(session.document, scene=scene))
    session = after(session, c.set_fields("display", relative_to=f"{odd} (1)"))
    frames = [replace(one, file=replace(one.file, name=odd)) for one in document.scene.frames]
    scene = replace(document.scene, frames=tuple(frames))
    sequence = replace(session, document=replace(document, scene=scene))
    for piece in (
        objects_list(session),
        result_html(session),
        relative_html(session),
        time_line(sequence),
    ):
        page = lxml_html.fromstring(piece)
        assert page.xpath("//img") == []
        assert odd in page.text_content()


def test_reasons_of_a_file_are_no_markup_to_the_page():
    session = make_session()
    verdict = Verdict("lost", 0.1, ("<script>alert(1)</script>",))
    document = session.document.with_object(
        result=SearchResult(verdict=verdict, loss=0.1, unexplained=0.1)
    )
    assert "<script" not in verdict_text(replace(session, document=document))
    assert "alert(1)" in verdict_text(replace(session, document=document))


def test_the_line_over_the_photo_says_what_space_does_next():
    session = make_session()
    assert hint_of(session) == USUAL_HINT  # it searches
    searching = after(session, c.start_search())
    assert hint_of(searching) == SEARCHING_HINT
    assert hint_of(after(searching, c.stop_search())) == USUAL_HINT
    assert hint_of(after(searching, c.set_tool("brush"))) != SEARCHING_HINT
    assert hint_of(after(session, c.show_style("residual"))) == ""  # its legend is there


def test_after_a_press_the_line_offers_to_set_the_size_until_that_is_done():
    start = make_session()
    document = start.document.with_object(is_placed=False)
    pressed = after(replace(start, document=document), c.press(60.0, 50.0), c.drag_to(70.0, 50.0))
    placed = after(pressed, c.release())
    assert placed.document.object.is_placed
    assert hint_of(placed) == SIZE_HINT
    assert "Fit to box" in SIZE_HINT
    assert hint_of(after(placed, c.nudge("turn", 5.0))) == SIZE_HINT
    assert hint_of(after(placed, c.nudge("scale", -9.0))) == USUAL_HINT
    assert hint_of(after(placed, *[c.nudge("move", 1.0)] * 3)) == USUAL_HINT


def test_the_share_that_is_hidden_is_said():
    session = make_session()
    assert occlusion_text(session) == ""
    stroke = h.Stroke("polygon", np.array([[0.0, 0.0], [160.0, 0.0], [160.0, 60.0], [0, 60.0]]), 1)
    assert occlusion_text(after(session, h.paint(stroke))).startswith("**50.")


def test_what_is_said_of_a_pose_that_moves_is_said_to_be_coarse():
    session = make_session()
    scale = UnexplainedScale(100.0, 3, 3)
    losses = LossReading(session.at_pose, Unexplained(scale, scale.worst))
    rests = replace(session, results=Results(losses=losses))
    assert loss_text(rests) == "unexplained 1.000 at this pose"
    for moved in (held(rests), after(rests, c.nudge("move", 1.0))):
        moved = replace(moved, results=rests.results)
        assert loss_text(moved) == "unexplained about 1.000 at this pose"


def test_a_pose_has_one_value_that_of_the_search_which_its_file_has():
    """What is compared about the pose is not what the search compared about its start."""
    session = make_session()
    scale = UnexplainedScale(100.0, 3, 3)
    losses = LossReading(session.at_pose, Unexplained(scale, scale.worst))
    rests, loss = replace(session, results=Results(losses=losses)), scale.worst - 1.0
    own = scale.as_unexplained(loss)
    for name, shown in (("default", own), ("paper", 1.0)):
        result = SearchResult(loss=loss, unexplained=own, settings={"loss": name})
        found = replace(rests, document=rests.document.with_object(result=result))
        if name == "default":
            assert "about" not in loss_text(found)  # what is read at the pose comes later
        found = replace(found, results=Results(losses=replace(losses, at_pose=found.at_pose)))
        assert loss_text(found) == f"unexplained {shown:.3f} at this pose"
        saved = pose_json(as_saved(scene_to_save(found)))
        assert saved.unexplained == own


def test_the_status_has_verdict_share_and_first_reason_until_the_pose_is_another():
    session = make_session()
    assert "Open both, Place the model, then Search." in status_html(session)
    reasons = "Searches from near by came back to it.", "Another one."
    for word in ("found", "doubtful", "lost"):
        verdict = Verdict(word, 0.6, reasons)
        result = SearchResult(verdict=verdict, loss=0.1, unexplained=0.1)
        judged = replace(session, document=session.document.with_object(result=result))
        page = lxml_html.fromstring(status_html(judged))
        (badge,) = page.xpath("//b")
        assert badge.text_content() == f"Verdict: {word}"
        assert f"pv-{word}" in badge.get("class")
        assert len(badge.xpath("./svg")) == 1  # for those who see no colours
        assert page.xpath("//p")[0].text_content() == reasons[0]
        assert f"{percent_right(word, 0.6)} % likely right" in page.text_content()
        assert word in hint_of(replace(judged, saved=None))
        assert hint_of(replace(judged, saved=judged.document)) == USUAL_HINT
        moved = status_html(after(judged, c.nudge("move", 1.0)))
        assert "Verdict" not in moved
        assert "not searched" in moved


def test_a_guessed_focal_length_is_searched_for_by_the_button_beside():
    button = "//button[text()='Find the focal length']"
    assert lxml_html.fromstring(status_html(make_session())).xpath(button) == []
    guessed = make_session(make_photo().default_camera())
    (found,) = lxml_html.fromstring(status_html(guessed)).xpath(button)
    asked = meaning_of(found.get("data-report"))
    assert isinstance(asked, Edit)
    searching = after(guessed, asked)
    assert searching.search is not None
    assert searching.search.methods[0].free_focal
    (waits,) = lxml_html.fromstring(status_html(searching)).xpath(button)
    assert waits.get("data-report") is None


def test_size_and_origin_are_last_among_the_notes():
    session = make_session()
    scene = replace(session.document.scene, notes=("a.obj: no colours",))
    session = replace(session, document=replace(session.document, scene=scene))
    assert "origin" not in files_text(session)
    *_, note, last = notes_text(session).splitlines()
    assert note == "- a.obj: no colours"
    assert "its origin lies" in last


def test_a_share_has_one_form():
    assert percent(0.97) == "97 %"


def test_names_of_parts_are_text():
    mesh = replace(make_two_boxes(), part_names=("body", "<b>mirror</b>"))
    assert parts_left_out(mesh) == ""
    page = lxml_html.fromstring(parts_left_out(mesh.without(["<b>mirror</b>"])))
    assert "<b>mirror</b>" in page.text_content()
    assert [json.loads(report) for report in page.xpath("//button/@data-report")] == [
        {"kind": "part", "index": 0}
    ]


def test_the_offer_after_a_crash_says_what_it_was():
    sequence, two = make_sequence(), with_two().document
    for document, what in (
        (sequence, f"a sequence of {len(sequence.scene.frames)} frames"),
        (two, "2 objects"),
    ):
        said = offer_text(make_autosave(document))
        assert what in said
        assert plain(document.photo.name) in said
        assert "photos" not in said


def test_every_tool_has_its_hint():
    session = make_session()
    hints = {hint_of(replace(session, tool=tool)) for tool in h.HIDING}
    assert len(hints - {USUAL_HINT}) == len(h.HIDING)
