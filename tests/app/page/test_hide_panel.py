"""What the panel says of what is hidden, and which reports of the page hide something."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from lxml import html

from poseviewer.app.page.hide_panel import HINTS, hidden_text, parts_left_out
from poseviewer.app.page.reports import request_of
from poseviewer.app.state import commands as c
from poseviewer.app.state import hiding as h
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.requests import Report
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


@pytest.mark.parametrize(
    ("shape", "kind"), [("brush", Edit), ("polygon", Edit), ("scribble", h.Grow)]
)
def test_a_stroke_is_painted_or_grown(shape: str, kind: type):
    points = [1.0, 2.0, 30.0, 4.0, 30.0, 40.0]
    content = {"kind": "stroke", "shape": shape, "points": points, "radius": 4.0, "erase": True}
    asked = request_of(Report(content, 0), make_session())
    assert isinstance(asked, kind)
    assert isinstance(asked, Edit | h.Grow)
    stroke = asked.stroke if isinstance(asked, h.Grow) else asked.arguments[0]
    assert stroke.points.tolist() == [[1.0, 2.0], [30.0, 4.0], [30.0, 40.0]]
    assert stroke.erase


@pytest.mark.parametrize(
    "change",
    [
        {"shape": "spiral"},
        {"points": []},
        {"points": [1.0]},
        {"points": [1.0, float("nan")]},
        {"points": "here"},
        {"radius": None},
    ],
)
def test_a_stroke_that_makes_no_sense_is_dropped(change: dict):
    content = {"kind": "stroke", "shape": "brush", "points": [1.0, 2.0], "radius": 4.0}
    content |= {"erase": False} | change
    assert request_of(Report(content, 0), make_session()) is None


def test_presses_are_for_the_tool_at_hand():
    session = after(make_session(), c.set_tool("part"))
    press = {"x": 80.0, "y": 60.0, "zoom": 1.0}
    assert request_of(Report({"kind": "press", **press}, 0), session) == h.leave_out(80.0, 60.0)
    assert request_of(Report({"kind": "double", **press}, 0), session) is None
    key = Report({"kind": "key", "code": "KeyH"}, 0)
    assert request_of(key, session) == c.set_tool("pose")
    assert request_of(key, make_session()) == c.set_tool("brush")
