"""What the panel says of what is hidden, and which reports of the page hide something."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from lxml import html

from poseviewer.app.page.hide_panel import HINTS, hidden_text, parts_left_out
from poseviewer.app.page.reports import meaning_of
from poseviewer.app.state import hiding as h
from poseviewer.app.state.edits import Edit
from poseviewer.app.workers.tasks import Task
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


@pytest.mark.parametrize("shape", h.SHAPES)
def test_a_stroke_is_painted_or_grown(shape: str):
    points = [1.0, 2.0, 30.0, 4.0, 30.0, 40.0]
    report = {"kind": "stroke", "shape": shape, "points": points, "radius": 4.0, "erase": True}
    asked = meaning_of(json.dumps(report))
    if shape == "scribble":
        assert isinstance(asked, Task)
        return
    assert isinstance(asked, Edit)
    (stroke,) = asked.arguments
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
    report = {"kind": "stroke", "shape": "brush", "points": [1.0, 2.0], "radius": 4.0}
    assert meaning_of(json.dumps(report | {"erase": False} | change)) is None
