"""What pages may upload: no more than is allowed, and no more than they said."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

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


@pytest.mark.parametrize(("size", "parts"), [(1000, 10_000_000), (-5, 1), (1000, -1)])
def test_announcements_that_make_no_sense_are_refused(
    running: RunningApp, size: int, parts: int
) -> None:
    with running.page() as page:
        page.upload("Model ...", "odd.glb", b"", size_bytes=size, part_count=parts)
        assert refusal(page, "odd.glb").startswith(f"odd.glb: announced as {size} bytes in {parts}")
        assert held(running) == 0
