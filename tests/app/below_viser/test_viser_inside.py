"""What the app uses of viser's and websockets' insides is there: fails when viser changes it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import viser
import websockets.asyncio.server
from viser import _messages
from viser.infra import _async_message_buffer, _infra
from websockets.asyncio.server import ServerConnection

import poseviewer
from poseviewer.app.below_viser.guard import VISERS_OWN

APP = Path(poseviewer.__file__).parent
CLIENT = Path(viser.__file__).parent / "client" / "src"

FIELDS = {
    "RunJavascriptMessage": ["source"],
    "FileTransferStartUpload": [
        "source_component_uuid",
        "transfer_uuid",
        "filename",
        "mime_type",
        "part_count",
        "size_bytes",
    ],
    "FileTransferPart": ["source_component_uuid", "transfer_uuid", "part_index", "content"],
    "FileTransferPartAck": [
        "source_component_uuid",
        "transfer_uuid",
        "transferred_bytes",
        "total_bytes",
    ],
    "GuiUpdateMessage": ["uuid", "updates"],
    "ShareUrlRequest": [],
    "ShareUrlDisconnect": [],
}


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    running = viser.ViserServer("127.0.0.1", 0, verbose=False)
    yield running
    running.stop()


def arguments(function: Any) -> list[str]:
    return list(inspect.signature(function).parameters)


def test_the_version_is_the_one_that_was_read():
    assert viser.__version__ == "1.1.1"


@pytest.mark.parametrize("name", FIELDS)
def test_messages_have_their_fields(name: str):
    message = getattr(_messages, name)
    assert [f for f in arguments(message) if not f.startswith("_")] == FIELDS[name]


def test_the_server_is_made_by_the_call_that_is_intercepted():
    assert _infra.__name__ == VISERS_OWN
    source = inspect.getsource(_infra)
    assert source.count("websockets.asyncio.server.serve(") == 1
    assert "process_request=" in source
    assert {"process_request", "logger"} <= set(arguments(websockets.asyncio.server.serve.__init__))
    assert arguments(ServerConnection.respond) == ["self", "status", "text"]


def test_buffers_wake_their_pages_as_is_known():
    push = inspect.getsource(_async_message_buffer.AsyncMessageBuffer.push)
    assert push.count("self.message_event.set()") == 1
    assert push.count("self.event_loop.call_soon_threadsafe(self.message_event.set)") == 1
    source = inspect.getsource(_infra)
    assert source.count("AsyncMessageBuffer(") == 2


def test_handlers_and_states_of_uploads_are_there(server: viser.ViserServer):
    gui = server.gui
    interface = gui._websock_interface
    for handler in (gui._handle_file_transfer_start, gui._handle_file_transfer_part):
        assert arguments(handler) == ["client_id", "message"]
        assert not inspect.iscoroutinefunction(handler)
        assert handler in [f for kind in interface._incoming_handlers.values() for f in kind]
    assert gui._current_file_upload_states == {}
    assert "self.gui._drop_uploads_from_client(" in inspect.getsource(viser.ViserServer)
    source = inspect.getsource(gui._handle_file_transfer_start)
    for key in ("client_id", "filename", "transferred_bytes", "total_bytes"):
        assert f'"{key}"' in source
    assert arguments(interface.queue_message) == ["message"]
    assert arguments(interface.register_handler) == ["message_cls", "callback"]
    assert arguments(interface.unregister_handler) == ["message_cls", "callback"]
    assert arguments(server._websock_server.unregister_handler) == ["message_cls", "callback"]


def test_the_handler_of_values_is_there(server: viser.ViserServer):
    gui = server.gui
    handler = gui._handle_gui_updates
    assert arguments(handler) == ["client_id", "message"]
    assert inspect.iscoroutinefunction(handler)
    assert gui._websock_interface._incoming_handlers[_messages.GuiUpdateMessage] == [handler]
    assert gui._gui_input_handle_from_uuid == {}


def test_handles_have_what_the_page_is_told_by(server: viser.ViserServer):
    assert isinstance(server.gui.add_text("", "")._impl.uuid, str)
    assert isinstance(server.gui.add_upload_button("")._impl.value, viser.UploadedFile)


def test_the_client_gives_what_the_script_takes():
    source = (CLIENT / "ViewerContext.ts").read_text(encoding="utf-8")
    for name in (
        "__viserMutable",
        "sendMessage",
        "canvas",
        "camera",
        "cameraControl",
        "nodeRefFromName",
        "requestRender",
    ):
        assert re.search(rf"\b{name}\b", source), name


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
