"""What pages send: no more is uploaded than is allowed, and only what makes sense goes on."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from poseviewer.files.state.uploads import LARGEST_UPLOAD, pack
from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import RunningApp, running_app
from tests.scene import Scene


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


def refusal(page: SocketPage, name: str) -> str:
    """What the page is told of a file that was not taken."""
    return page.wait_until(
        lambda: next((text for _, text in page.shown.notices if text.startswith(name)), "")
    )


def held(running: RunningApp) -> int:
    """How many uploads viser is gathering."""
    return len(running.app._page._server.gui._current_file_upload_states)


def assert_taken(page: SocketPage, photo: Path, name: str) -> None:
    page.upload("Photo ...", name, photo.read_bytes())
    page.wait_until(lambda: page.text_with(f"**{name}**"))


def test_what_is_too_large_is_refused_when_it_is_announced(running: RunningApp) -> None:
    with running.page() as page:
        page.upload("Model ...", "huge.glb", b"", size_bytes=LARGEST_UPLOAD + 1, part_count=400)
        assert refusal(page, "huge.glb") == (
            "huge.glb: 200,000,001 bytes; up to 200,000,000 can be uploaded, make it smaller or "
            "start poseviewer with its path."
        )
        assert held(running) == 0
        page.upload("Model ...", "parts.glb", 1_200_000 * b"x", size_bytes=10**12)
        assert "1,000,000,000,000 bytes" in refusal(page, "parts.glb")
        assert_taken(page, running.scene.photo, "after.png")
        assert held(running) == 0


def test_what_is_more_than_announced_is_dropped(running: RunningApp) -> None:
    with running.page() as page:
        document = running.app.session.document
        page.upload("Model ...", "grows.glb", 1_200_000 * b"x", size_bytes=600_000)
        assert "more bytes came than were announced" in refusal(page, "grows.glb")
        assert held(running) == 0
        assert running.app.session.document is document
        assert_taken(page, running.scene.photo, "smaller.png")


def test_progress_is_told_to_its_own_page(running: RunningApp) -> None:
    with running.page() as page, running.page() as other:
        photo = running.scene.photo
        assert_taken(page, photo, "mine.png")
        other.wait_until(lambda: other.text_with("**mine.png**"))
        size = len(pack([("mine.png", photo.read_bytes())]))
        page.wait_until(lambda: page.shown.progress)  # its own messages may come after everybody's
        assert page.shown.progress == [(size, size)]
        with running.page() as later:
            assert other.shown.progress == later.shown.progress == []


def test_all_uploads_together_are_bounded(running: RunningApp) -> None:
    most = LARGEST_UPLOAD - 1000
    with running.page() as page:
        with running.page() as other:
            other.upload("Model ...", "slow.glb", b"", size_bytes=most, part_count=300)
            page.wait_until(lambda: held(running) == 1)
            page.upload("Photo ...", "second.png", b"", size_bytes=2000, part_count=1)
            assert "another upload is under way" in refusal(page, "second.png")
            assert held(running) == 1
        page.wait_until(lambda: held(running) == 0)  # its page has gone
        assert_taken(page, running.scene.photo, "third.png")


def test_announcements_that_make_no_sense_are_refused(running: RunningApp) -> None:
    with running.page() as page:
        for size, parts in ((1000, 10_000_000), (-5, 1), (1000, -1)):
            page.upload("Model ...", "odd.glb", b"", size_bytes=size, part_count=parts)
            assert refusal(page, f"odd.glb: announced as {size} bytes in {parts}")
            assert held(running) == 0


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


def test_a_value_that_an_input_cannot_have_goes_no_farther(
    running: RunningApp, caplog: pytest.LogCaptureFixture
) -> None:
    document = running.app.session.document
    with running.page() as page, running.page() as other:
        for label, value in ODD_VALUES:
            before = page.value(label)
            page.set(label, value)
            page.wait_until(lambda: page.value(label) == before)  # noqa: B023 - at once
            assert other.value(label) == before
        assert running.app.session.document is document
    with running.page() as later:  # pages to come are served
        assert later.value("Seed") == 0
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
