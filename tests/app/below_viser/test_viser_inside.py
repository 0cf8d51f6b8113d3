"""Viser's insides that the app uses: fails when viser changes them."""

import inspect
import re
from pathlib import Path

import pytest
import viser
from viser.infra import _async_message_buffer, _infra

import poseviewer

APP = Path(poseviewer.__file__).parent
CLIENT = Path(viser.__file__).parent / "client" / "src"

USED = {
    _infra: ("websockets.asyncio.server.serve(", "process_request=", "AsyncMessageBuffer("),
    _async_message_buffer: (
        "self.message_event.set()",
        "self.event_loop.call_soon_threadsafe(self.message_event.set)",
    ),
    viser.ViserServer: ("self.gui._drop_uploads_from_client(",),
    viser.GuiApi: ("self._event_loop = event_loop",),
    viser.GuiApi._handle_gui_updates: ("await cb(GuiEvent(client, client_id, handle))",),
    viser.GuiApi._handle_file_transfer_start: tuple(
        f'"{key}"' for key in ("client_id", "filename", "transferred_bytes", "total_bytes")
    ),
}
"""Code that ours counts on and that no other test would miss, by where it stands."""


def test_the_version_is_the_one_that_was_read():
    assert viser.__version__ == "1.1.1"


@pytest.mark.parametrize("where", USED, ids=lambda where: where.__name__)
def test_what_is_counted_on_is_there(where):
    source = inspect.getsource(where)
    assert [code for code in USED[where] if code not in source] == []


def test_the_client_gives_what_the_script_takes():
    source = (CLIENT / "ViewerContext.ts").read_text(encoding="utf-8")
    for name in (
        "__viserMutable",
        "messageQueue",
        "drainMessageQueue",
        "sendMessage",
        "canvas",
        "camera",
        "cameraControl",
        "requestRender",
    ):
        assert re.search(rf"\b{name}\b", source), name
    used = {
        "MessageHandler.tsx": "messageQueue.splice(0, numMessages)",
        "ControlPanel/Generated.tsx": "useThrottledMessageSender(50)",
        "WebsocketInterface.tsx": "viewerMutable.sendMessage = (message) =>",
    }
    for name, code in used.items():
        assert code in (CLIENT / name).read_text(encoding="utf-8"), name


def test_nothing_else_reaches_below_viser():
    inside = re.compile(
        r"from viser\._|from viser import _|viser\._\w|import websockets|from websockets"
        r"|\._(?:impl|websock\w*)\b|__viserMutable"
    )
    room = APP / "app" / "below_viser"
    found = {
        str(path.relative_to(APP))
        for path in APP.rglob("*.py")
        if not path.is_relative_to(room) and inside.search(path.read_text(encoding="utf-8"))
    }
    assert found == set()
