"""Texts of the panel on what is hidden."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from lxml import html

from poseviewer.app.page.hide_panel import HINTS, hidden_text, parts_left_out
from poseviewer.app.state import hiding as h
from tests.app.state.documents import after, make_session
from tests.meshes import make_two_boxes


def test_the_share_that_is_hidden_is_said():
    session = make_session()
    assert hidden_text(session) == ""
    stroke = h.Stroke("polygon", np.array([[0.0, 0.0], [160.0, 0.0], [160.0, 60.0], [0, 60.0]]), 1)
    assert hidden_text(after(session, h.paint(stroke))).startswith("**50.")


def test_names_of_parts_are_text():
    mesh = replace(make_two_boxes(), part_names=("body", "<b>mirror</b>"))
    assert parts_left_out(mesh) == ""
    page = html.fromstring(parts_left_out(mesh.without(["<b>mirror</b>"])))
    assert "<b>mirror</b>" in page.text_content()
    assert [json.loads(report) for report in page.xpath("//button/@data-report")] == [
        {"kind": "part", "index": 0}
    ]


def test_every_tool_has_its_hint():
    assert set(HINTS) == set(h.HIDING)
