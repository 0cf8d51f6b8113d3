"""Texts of the panel on a session."""

import html
import json
from dataclasses import replace

import numpy as np
import pytest
from lxml import html as lxml_html

from poseviewer.app.page.above_steps import parts_left_out
from poseviewer.app.page.controls import plain
from poseviewer.app.page.texts import (
    SEARCHING_HINT,
    USUAL_HINT,
    focal_note,
    hidden_text,
    hint_of,
    marks_text,
    search_text,
    verdict_text,
)
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state.session import Losses
from poseviewer.app.workers.exporting import saved_scene
from poseviewer.confidence.verdict import Verdict
from poseviewer.scene.types import SearchResult
from poseviewer.starts.loading import pose_record
from tests.app.state.documents import PERSPECTIVE, after, make_photo, make_session
from tests.meshes import make_two_boxes


def test_a_focal_length_that_is_a_guess_is_said_in_the_panel_and_in_the_file():
    assumed = make_photo().default_camera()
    for camera, guessed in ((assumed, True), (PERSPECTIVE, False)):
        session = make_session(camera)
        assert ("is assumed" in focal_note(session)) == guessed
        notes = pose_record(saved_scene(session)).notes
        assert any("is assumed" in note for note in notes) == guessed


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
    losses = Losses(session, note=f"{name}: no loss")
    document = session.document.with_marks(note=name)
    session = replace(session, losses=losses, document=document, tool="pairs")
    assert shown in search_text(session)
    assert shown in marks_text(session)
    for text in (search_text(session), marks_text(session)):
        assert name not in text


def test_reasons_of_a_file_are_no_markup_to_the_page():
    session = make_session()
    verdict = Verdict("lost", 0.1, ("<script>alert(1)</script>",))
    document = session.document.with_object(result=SearchResult(verdict, 0.1, 0.1))
    assert "<script" not in verdict_text(replace(session, document=document))
    assert "alert(1)" in verdict_text(replace(session, document=document))


def test_the_line_over_the_photo_says_what_space_does_next():
    session = make_session()
    assert hint_of(session) == USUAL_HINT  # it searches
    searching = after(session, c.start_search())
    assert hint_of(searching) == SEARCHING_HINT
    assert hint_of(after(searching, c.stop_search())) == USUAL_HINT
    assert hint_of(after(searching, c.set_tool("brush"))) != SEARCHING_HINT
    assert hint_of(after(session, c.change(look="residual"))) == ""  # its legend is there


def test_the_share_that_is_hidden_is_said():
    session = make_session()
    assert hidden_text(session) == ""
    stroke = h.Stroke("polygon", np.array([[0.0, 0.0], [160.0, 0.0], [160.0, 60.0], [0, 60.0]]), 1)
    assert hidden_text(after(session, h.paint(stroke))).startswith("**50.")


def test_names_of_parts_are_text():
    mesh = replace(make_two_boxes(), part_names=("body", "<b>mirror</b>"))
    assert parts_left_out(mesh) == ""
    page = lxml_html.fromstring(parts_left_out(mesh.without(["<b>mirror</b>"])))
    assert "<b>mirror</b>" in page.text_content()
    assert [json.loads(report) for report in page.xpath("//button/@data-report")] == [
        {"kind": "part", "index": 0}
    ]


def test_every_tool_has_its_hint():
    session = make_session()
    hints = {hint_of(replace(session, tool=tool)) for tool in h.HIDING}
    assert len(hints - {USUAL_HINT}) == len(h.HIDING)
