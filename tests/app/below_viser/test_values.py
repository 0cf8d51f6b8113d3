"""What pages send as the value of an input: only what it can have goes on."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from typing import Any

import pytest

from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import RunningApp, running_app, settle
from tests.scene import Scene

ODD_VALUES: tuple[tuple[str, Any], ...] = (
    ("Seed", math.nan),
    ("Seed", None),
    ("Seed", 2**63),
    ("Pixels", "no such choice"),
    ("Method", ""),
    ("View", 7),
    ("Use greyscale", "yes"),
    ("Name", ["a"]),
    ("fx  (px)", [1.0]),
    ("fx  (px)", math.inf),
)

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
    {"kind": "release"},
)


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


@pytest.mark.parametrize(("label", "value"), ODD_VALUES)
def test_a_value_that_an_input_cannot_have_goes_no_farther(
    running: RunningApp, label: str, value: Any, caplog: pytest.LogCaptureFixture
) -> None:
    with running.page() as page, SocketPage(running.url) as other:
        settle(other)
        document, before = running.app.session.document, page.value(label)
        page.set(label, value)
        page.wait_until(lambda: page.value(label) == before)  # it is told what counts
        assert other.value(label) == before
        assert running.app.session.document is document
    with running.page() as later:  # pages to come are served
        assert later.value(label) == before
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_attributes_of_an_input_are_no_page_s_to_set(running: RunningApp) -> None:
    with running.page() as page:
        page._send(
            type="GuiUpdateMessage", uuid=page.uuid("Seed"), updates={"removed": True, "value": 3}
        )
        page.set("Seed", 5)
        page.wait_until(lambda: running.app.session.document.settings.seed == 5)
        page.key("KeyZ")
        page.wait_until(lambda: running.app.session.document.settings.seed == 0)


def test_settings_are_bounded_as_their_fields_are(running: RunningApp) -> None:
    with running.page() as page:
        page.set("Seed", -1)
        page.set("Max evaluations", 3)
        page.wait_until(lambda: running.app.session.document.settings.limits.evaluations == 10)
        assert running.app.session.document.settings.seed == 0


def test_reports_that_make_no_sense_change_nothing(running: RunningApp) -> None:
    with running.page() as page:
        document = running.app.session.document
        for text in NOT_REPORTS:
            page.change(page.shown.channel, text)
        page.key("KeyB")  # answered after all of those
        page.wait_until(lambda: running.app.session.photo_alone)
        assert running.app.session.document is document
        assert running.app.session.drag is None
        assert not running.app.session.searching
