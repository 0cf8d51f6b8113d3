"""Inputs of the page: whose value stands there, the page's or the session's."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
import viser

from poseviewer.app.below_viser.client_script import ClientScript
from poseviewer.app.below_viser.guard import GuardedServer, serve
from poseviewer.app.page.controls import Controls
from poseviewer.app.state.objects import alter_object
from poseviewer.app.workers.tasks import Request
from tests.app.below_viser.socket_page import SocketPage
from tests.app.running_app import RunningApp, running_app
from tests.app.state import edits as c
from tests.app.state.documents import after, make_session
from tests.scene import Scene

NOTE = "left front door dented, lamp broken"


@dataclass
class Fields:
    """Controls of a page, without an app behind: a note, and an opacity."""

    guarded: GuardedServer
    posted: list[Request] = field(default_factory=list)

    def __post_init__(self) -> None:
        gui = self.guarded.server.gui
        self.session = make_session()
        self.controls = Controls(gui, self.post, self.session)
        self.note = gui.add_text("Note", "")
        object_id = self.session.document.object_id
        self.controls.field(
            self.note,
            lambda text: alter_object(object_id, note=text),
            value=lambda session: session.document.object.note,
        )
        self.opacity = gui.add_slider("Opacity", 0.0, 1.0, 0.05, 1.0)
        self.controls.bind(self.opacity, "display", "opacity")

    def post(self, request: Request) -> int:
        self.posted.append(request)
        return len(self.posted)

    def show(self, seen: int) -> None:
        """Show the session, and wait until it is shown."""
        self.controls.show(self.session, seen)
        loop = self.guarded.server.get_event_loop()
        asyncio.run_coroutine_threadsafe(asyncio.sleep(0), loop).result(60.0)

    def handle(self, *requests: Any) -> None:
        self.session = after(self.session, *requests)


@pytest.fixture
def fields() -> Iterator[Fields]:
    guarded = serve("127.0.0.1", 0)
    try:
        yield Fields(guarded)
    finally:
        guarded.stop()


def uuid(handle: viser.GuiInputHandle[Any]) -> str:
    return handle._impl.uuid


@pytest.fixture
def page(fields: Fields) -> Iterator[SocketPage]:
    ClientScript(fields.guarded.server, {}, lambda *_: None)  # a page waits for it
    with SocketPage(fields.guarded.url) as opened:
        yield opened


def test_an_input_that_the_session_has_not_seen_stays(fields: Fields, page: SocketPage) -> None:
    page.change(uuid(fields.note), NOTE)
    page.change(uuid(fields.opacity), 0.3)
    page.wait_until(lambda: len(fields.posted) == 2)
    fields.handle(c.nudge("move", 1.0))  # as a search streams poses
    fields.show(seen=0)
    assert (fields.note.value, fields.opacity.value) == (NOTE, 0.3)
    fields.handle(fields.posted[0])
    fields.show(seen=1)
    assert (fields.note.value, fields.opacity.value) == (NOTE, 0.3)
    fields.handle(fields.posted[1], c.undo(), c.undo())  # now another value is the newest
    fields.show(seen=2)
    assert (fields.note.value, fields.opacity.value) == ("", 0.3)
    page.wait_until(lambda: page.values(uuid(fields.note))[-1] == "")


def test_a_page_is_told_its_own_value_again(fields: Fields, page: SocketPage) -> None:
    """An older one that is under way to it would stay there."""
    fields.handle(alter_object(fields.session.document.object_id, note="older"))
    fields.show(seen=0)
    page.wait_until(lambda: page.values(uuid(fields.note))[-1] == "older")
    page.change(uuid(fields.note), NOTE)
    page.wait_until(lambda: page.values(uuid(fields.note))[-1] == NOTE)


def test_what_is_refused_gives_way_to_what_holds(fields: Fields, page: SocketPage) -> None:
    fields.show(seen=0)
    page.change(uuid(fields.opacity), 0.3)
    page.wait_until(lambda: page.values(uuid(fields.opacity))[-1] == 0.3)
    fields.show(seen=1)  # it led to no other session
    page.wait_until(lambda: page.values(uuid(fields.opacity))[-1] == 1.0)


@pytest.fixture(scope="module")
def running(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(scene, tmp_path_factory.mktemp("state")) as app:
        yield app


def test_an_app_at_work_never_writes_an_older_value(running: RunningApp) -> None:
    """Each beginning of a note is sent at once, while poses come in without a pause."""
    app, name = running.app, running.uuid("Note")
    beginnings = [NOTE[: i + 1] for i in range(len(NOTE))]
    with SocketPage(running.url) as page:
        for text in beginnings:
            app._mailbox.post(c.nudge("turn", 0.1))
            page.change(name, text)
        page.wait_until(lambda: app.session.document.object.note == NOTE)
        page.wait_until(lambda: app._page._controls._shown[0] is app.session)
        page.wait_until(lambda: page.values(name)[-1] == NOTE)
        told = [beginnings.index(text) for text in page.values(name) if text]
    assert told == sorted(told)


def test_intrinsics_sent_at_once_are_all_taken(running: RunningApp) -> None:
    app = running.app
    wanted = {"fx (px)": 311.0, "fy (px)": 313.0, "cx (px)": 81.0, "cy (px)": 61.0}
    with SocketPage(running.url) as page:
        for label, value in wanted.items():
            page.change(running.uuid(label), value)
        camera = page.wait_until(
            lambda: (now := app.session.document.pose.camera).cy == 61.5 and now
        )
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (311.0, 313.0, 81.5, 61.5)
