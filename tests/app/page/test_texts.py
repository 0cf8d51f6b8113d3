"""What the panel says of a session."""

from __future__ import annotations

import html
from dataclasses import replace

import numpy as np
import pytest

from poseviewer.app.page.controls import plain
from poseviewer.app.page.panels import (
    SEARCHING_HINT,
    focal_note,
    hint_of,
    marks_text,
    search_text,
    verdict_text,
)
from poseviewer.app.state import commands as c
from poseviewer.app.state.document import SearchEnd
from poseviewer.app.state.session import Overlay, OverlayRequest
from poseviewer.app.workers.exporting import record_of
from poseviewer.files.pose import PoseRecord, RecordedVerdict
from tests.app.state.documents import PERSPECTIVE, after, make_photo, make_session


def test_a_focal_length_that_is_a_guess_is_said_in_the_panel_and_in_the_file():
    assumed = make_photo().default_camera()
    for camera, guessed in ((assumed, True), (PERSPECTIVE, False)):
        session = make_session(camera)
        assert ("is assumed" in focal_note(session)) == guessed
        assert any("is assumed" in note for note in record_of(session).notes) == guessed


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
    own = session.document
    asked = OverlayRequest(own.registration, own.settings, own.pose, own.pose, "outline")
    nowhere = (0.0, 0.0, 0.0, 0.0)
    overlay = Overlay(asked, np.zeros((0, 2, 2)), None, nowhere, None, f"{name}: no loss")
    marks = replace(session.document.marks, note=name)
    document = replace(session.document, marks=marks)
    session = replace(session, overlay=overlay, document=document, tool="pairs")
    assert shown in search_text(session)
    assert shown in marks_text(session)
    for text in (search_text(session), marks_text(session)):
        assert name not in text


def test_reasons_of_a_file_are_no_markup_to_the_page():
    session = make_session()
    verdict = RecordedVerdict("lost", 0.1, ("<script>alert(1)</script>",), {})
    record = PoseRecord(session.document.pose, verdict=verdict)
    document = replace(session.document, end=SearchEnd(record))
    assert "<script" not in verdict_text(replace(session, document=document))
    assert "alert(1)" in verdict_text(replace(session, document=document))


def test_the_line_over_the_photo_says_what_space_does_next():
    session = make_session()
    assert hint_of(session) == ""  # the usual line: it searches
    searching = after(session, c.StartSearch())
    assert hint_of(searching) == SEARCHING_HINT
    assert hint_of(after(searching, c.StopSearch())) == ""
    assert hint_of(after(searching, c.SetTool("brush"))) != SEARCHING_HINT
