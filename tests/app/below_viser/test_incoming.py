"""Checks of what pages send: no more is uploaded than is allowed, only what makes sense goes on."""

import logging
import math
from collections.abc import Iterator
from typing import Any
from uuid import uuid4

import pytest

from poseviewer.opening.uploads import MAX_UPLOAD_BYTES, pack
from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import RunningApp, running_app
from tests.scene import Scene

PART = 500_000
"""Bytes of an upload in one message."""


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


@pytest.fixture(scope="module")
def page(running: RunningApp) -> Iterator[SocketPage]:
    with SocketPage(running.url) as opened:
        yield opened


def upload(running: RunningApp, page: SocketPage, name: str, data: bytes, **announced: Any) -> None:
    """A photo, sent as the page's script does; what is ``announced`` of it may be untrue."""
    data, transfer = pack([(name, data)]), {"source_component_uuid": running.uuid("Photo ...")}
    parts = [data[i : i + PART] for i in range(0, len(data), PART)]
    transfer |= {"transfer_uuid": str(uuid4())}
    size = {"part_count": len(parts), "size_bytes": len(data), **announced}
    page.send(type="FileTransferStartUpload", filename=name, mime_type="", **transfer, **size)
    for index, part in enumerate(parts):
        page.send(type="FileTransferPart", part_index=index, content=part, **transfer)


def refusal(page: SocketPage, name: str) -> str:
    """Sentence that the page is told of a file that was not taken."""
    return page.wait_until(
        lambda: next((text for text in page.notices() if text.startswith(name)), "")
    )


def held(running: RunningApp) -> int:
    """Number of uploads that viser is gathering."""
    return len(running.app._page._server.gui._current_file_upload_states)


def assert_taken(running: RunningApp, page: SocketPage, name: str) -> None:
    upload(running, page, name, running.scene.photo.read_bytes())
    page.wait_until(lambda: running.app.session.document.photo.label == name)
    assert held(running) == 0


def test_what_is_too_large_is_refused_when_it_is_announced(running, page):
    upload(running, page, "huge.png", b"", size_bytes=MAX_UPLOAD_BYTES + 1, part_count=400)
    said = "200,000,001 bytes; up to 200,000,000 can be uploaded, start poseviewer with its path."
    assert refusal(page, "huge.png") == f"huge.png: {said}"
    assert held(running) == 0
    upload(running, page, "parts.png", 1_200_000 * b"x", size_bytes=10**12)
    assert "1,000,000,000,000 bytes" in refusal(page, "parts.png")
    assert_taken(running, page, "after.png")


def test_what_is_more_than_announced_is_dropped(running: RunningApp, page: SocketPage) -> None:
    document = running.app.session.document
    upload(running, page, "grows.png", 1_200_000 * b"x", size_bytes=600_000)
    assert "more bytes came than were announced" in refusal(page, "grows.png")
    assert running.app.session.document is document
    assert_taken(running, page, "smaller.png")


def test_progress_is_told_to_its_own_page(running: RunningApp) -> None:
    def progress(one: SocketPage) -> list[tuple[int, int]]:
        told = one.all_of("FileTransferPartAck")
        return [(message["transferred_bytes"], message["total_bytes"]) for message in told]

    with SocketPage(running.url) as page, SocketPage(running.url) as other:
        assert_taken(running, page, "mine.png")
        size = len(pack([("mine.png", running.scene.photo.read_bytes())]))
        page.wait_until(lambda: progress(page))
        assert progress(page) == [(size, size)]
        with SocketPage(running.url) as later:
            assert progress(other) == progress(later) == []


def test_all_uploads_together_are_bounded(running: RunningApp, page: SocketPage) -> None:
    most = MAX_UPLOAD_BYTES - 1000
    with SocketPage(running.url) as other:
        upload(running, other, "slow.png", b"", size_bytes=most, part_count=300)
        page.wait_until(lambda: held(running) == 1)
        upload(running, page, "second.png", b"", size_bytes=2000, part_count=1)
        assert "another upload is under way" in refusal(page, "second.png")
        assert held(running) == 1
    page.wait_until(lambda: held(running) == 0)  # its page has gone
    assert_taken(running, page, "third.png")


def test_announcements_that_make_no_sense_are_refused(running, page):
    for size, parts in ((1000, 10_000_000), (-5, 1), (1000, -1)):
        upload(running, page, "odd.glb", b"", size_bytes=size, part_count=parts)
        assert refusal(page, f"odd.glb: announced as {size} bytes in {parts}")
        assert held(running) == 0


ODD_VALUES: tuple[tuple[str, Any], ...] = (
    ("Seed", math.nan),
    ("Seed", None),
    ("Seed", 2**63),
    ("Pixels", "no such choice"),
    ("Loss", ""),
    ("View", 7),
    ("Use greyscale", "yes"),
    ("Name", ["a"]),
    ("fx (px)", [1.0]),
    ("fx (px)", math.inf),
)


def test_a_value_that_an_input_cannot_have_goes_no_farther(
    running: RunningApp, page: SocketPage, caplog: pytest.LogCaptureFixture
) -> None:
    document = running.app.session.document
    for label, value in ODD_VALUES:
        uuid = running.uuid(label)
        page.wait_until(lambda: page.values(uuid))  # noqa: B023 - at once
        before = page.values(uuid)
        page.change(uuid, value)
        page.wait_until(lambda: len(page.values(uuid)) > len(before))  # noqa: B023
        assert page.values(uuid)[-1] == before[-1]
    page.change(running.uuid("Photo ..."), "a.png")
    page.change(running.uuid("Seed"), math.nan)
    page.wait_until(lambda: len(page.values(running.uuid("Seed"))) > 4)
    assert running.app.session.document is document
    assert [text for text in page.notices() if "went wrong" in text] == []
    with SocketPage(running.url) as later:  # pages to come are served
        later.wait_until(lambda: set(later.values(running.uuid("Seed"))) == {0})
    assert [record for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_what_is_said_of_forms_is_not_kept_for_later_pages(running, page):
    page.send(type="GuiFormDirtyMessage", uuid="no such form" * 1000)
    page.change(running.uuid("Name"), "a name")
    with SocketPage(running.url) as later:
        later.wait_until(lambda: later.values(running.uuid("Name"))[-1:] == ["a name"])
        assert later.all_of("GuiFormDirtyMessage") == []


def test_a_page_sets_values_of_inputs_alone_within_their_limits(
    running: RunningApp, page: SocketPage
) -> None:
    seed = running.uuid("Seed")
    page.send(type="GuiUpdateMessage", uuid=seed, updates={"removed": True, "value": 3})
    page.change(seed, 5)
    page.wait_until(lambda: running.app.session.document.settings.seed == 5)
    # A number is clipped to the limits of its field.
    page.change(running.uuid("Max evaluations"), 3)
    page.wait_until(lambda: running.app.session.document.settings.limits.evaluations == 10)
