"""What comes first on a busy page: the stop of a search, and what the hand is moving."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from poseviewer.api import Case
from poseviewer.app.page import page as page_module
from poseviewer.app.state.session import OverlayRequest
from poseviewer.app.workers.maps import SIZE
from tests.app.running_app import RunningApp, running_app
from tests.scene import make_scene

# pyright: reportPrivateUsage=false


@pytest.fixture
def running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    (tmp_path / "files").mkdir()
    monkeypatch.chdir(tmp_path)
    with running_app(make_scene(tmp_path / "files"), tmp_path / "state") as app:
        yield app


def test_start_and_stop_do_not_wait_for_the_panels_turn(
    running: RunningApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running.page() as page:
        page.wait_until(lambda: "Search (space)" in page.labels())
        monkeypatch.setattr(page_module, "PANELS_S", 3600.0)
        page.key("Space")
        page.wait_until(lambda: "Stop (space)" in page.labels())
        page.key("Space")
        page.wait_until(lambda: "Search (space)" in page.labels())


def test_maps_wait_while_the_model_is_drawn(running: RunningApp) -> None:
    go_on = threading.Event()

    def slow() -> Iterator[None]:
        go_on.wait(60.0)
        yield from ()

    app = running.app
    with running.page() as page:
        app._overlay._quick.start(slow)  # pyright: ignore[reportArgumentType]
        app._mailbox.notify()
        page.wait_until(lambda: app._mapper._held)
        go_on.set()
        page.wait_until(lambda: not app._mapper._held)
        page.wait_until(lambda: page.maps() == 15)


@pytest.mark.slow
def test_a_search_is_left_to_find_the_losses_of_its_poses(
    running: RunningApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = running.app
    find_loss, during = app._overlay._find_loss, []

    def noting(request: OverlayRequest) -> None:
        during.append(app.session.searching)
        find_loss(request)

    monkeypatch.setattr(app._overlay, "_find_loss", noting)
    with running.page() as page:
        page.key("Space")
        page.wait_until(lambda: page.text_with("Converged"))
        page.wait_until(lambda: False in during)
    assert not any(during)


@pytest.mark.slow
def test_what_a_search_begins_with_is_made_beforehand(
    running: RunningApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared: list[Case] = []
    monkeypatch.setattr(Case, "prepare", lambda case: prepared.append(case))
    with running.page() as page:
        page.wait_until(lambda: page.maps() == 15)
        page.wait_until(lambda: len(prepared) == 1)
        assert prepared[0].registration.mesh is running.app.session.document.registration.mesh
        before = running.pose
        page.key("ArrowRight")  # the same model elsewhere: there is nothing more to make
        page.wait_until(lambda: running.pose is not before)
        page.wait_until(lambda: fine_maps_are_on_their_way(running))
    assert len(prepared) == 1


def fine_maps_are_on_their_way(running: RunningApp) -> bool:
    """Of the pose at hand: they come after what is made beforehand."""
    about_it = (m for m in running.app.session.landscapes if m.centre is running.pose)
    return any(len(piece.first_values) == SIZE for maps in about_it for piece in maps.slices)
