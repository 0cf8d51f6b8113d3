"""Meanings of reports of a page."""

import json

import pytest

from poseviewer.app.page.reports import meaning_of
from poseviewer.app.state import hiding as h
from poseviewer.app.state.edits import Edit, update
from poseviewer.app.workers.tasks import QueuedTask
from tests.app.state.documents import make_session

NOT_REPORTS = (
    "",
    "[1, 2]",
    '{"kind": 7}',
    '{"kind": "press"}',
    '{"kind": "press", "x": NaN, "y": 60}',
    '{"kind": "press", "x": 1e300, "y": -1e300}',
    '{"kind": "press", "x": 1' + 400 * "0" + ', "y": 60}',
    '{"kind": "drag", "x": 3, "y": 60}',
    '{"kind": "release"}',
    '{"kind": "double", "x": "here", "y": 60}',
    '{"kind": "pick", "first": Infinity, "second": 1, "u": 0.1, "v": 0.1}',
    '{"kind": "pick", "first": 77, "second": -3, "u": 0.1, "v": 0.1}',
    '{"kind": "enlarge", "first": NaN, "second": []}',
    '{"kind": "key"}',
    '{"kind": "key", "code": ["Space"]}',
    '{"kind": "key", "code": "NoSuchKey"}',
    '{"kind": "unfit", "name": "a", "size": "many"}',
    '{"kind": "not sent", "name": "a", "trouble": "none"}',
    '{"kind": "no such kind"}',
    200_000 * "[",
    7,
)


@pytest.mark.parametrize("report", NOT_REPORTS, ids=lambda report: str(report)[:60])
def test_reports_that_make_no_sense_change_nothing(report: object):
    meaning, session = meaning_of(report), make_session()
    if meaning is not None:
        assert isinstance(meaning, Edit)
        session = update(before := session, meaning)
        assert session.document is before.document
        assert session.drag is None


@pytest.mark.parametrize("shape", h.SHAPES)
def test_a_stroke_is_painted_or_grown(shape: str):
    points = [1.0, 2.0, 30.0, 4.0, 30.0, 40.0]
    report = {"kind": "stroke", "shape": shape, "points": points, "radius": 4.0, "erase": True}
    asked = meaning_of(json.dumps(report))
    if shape == "scribble":
        assert isinstance(asked, QueuedTask)
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
