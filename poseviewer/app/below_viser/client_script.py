"""The page's script ``client.js``, and its reports.

Why: viser has no zoom and pan that keep the registration, no drags beyond 20 Hz, no dropping of
files, and nothing that opens a tab; its hotkeys also act in dialogs, sliders and checkboxes; its
fields send each key that is typed, and take what the server sends meanwhile.
Written for viser 1.1.1: the message ``RunJavascriptMessage``, put into
``client.gui._websock_interface``; a field's ``_impl.uuid``; and in the page
``window.__viserMutable`` (its camera, canvas, ``sendMessage``, ``messageQueue``), tabs that Enter
opens, fields and folders by their classes (``mantine-...``) and labels, docked panels
(``data-dock-...``), a phone's sheet by its style, and the notice of an upload (``upload-...``).
"""

import base64
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from threading import Lock
from typing import Any

import viser
from viser import _messages

_SOURCE = Path(__file__).with_name("client.js")
_ICON = Path(__file__).with_name("icon.svg")


class ClientScript:
    """Runs the script on every page that connects, and hands on the pages' reports."""

    def __init__(
        self,
        server: viser.ViserServer,
        config: Mapping[str, Any],
        on_report: Callable[[object, viser.ClientHandle], None],
    ) -> None:
        """``config`` is described in ``client.js``; ``on_report(report, client)`` is called in
        viser's thread, with unchecked reports.
        """
        self._server = server
        self._last_calls: dict[str, tuple[Any, ...]] = {}
        # A page gets all last calls before it gets new ones.
        self._lock = Lock()
        # Pages report through an invisible text field: viser has no other public way back.
        channel = server.gui.add_text("report", "", visible=False)
        icon = f"data:image/svg+xml;base64,{base64.b64encode(_ICON.read_bytes()).decode()}"
        config = {**config, "channel": channel._impl.uuid, "icon": icon}
        source = _SOURCE.read_text(encoding="utf-8")
        self._source = source.replace("/*CONFIG*/ {}", json.dumps(config), 1)

        @channel.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                on_report(channel.value, event.client)

        server.on_client_connect(self._greet)

    def show(self, function: str, *arguments: Any) -> None:
        """Call a function on all pages, also later ones, unless its last call was the same."""
        with self._lock:
            if self._last_calls.get(function) != arguments:
                self._last_calls[function] = arguments
                for client in self._server.get_clients().values():
                    _run_on(client, _call(function, arguments))

    async def _greet(self, client: viser.ClientHandle) -> None:
        with self._lock:
            calls = map(_call, self._last_calls, self._last_calls.values())
            _run_on(client, "\n".join([self._source, *calls]))


def _call(function: str, arguments: tuple[Any, ...]) -> str:
    return f"window.poseviewer?.{function}({', '.join(map(json.dumps, arguments))});"


def _run_on(client: viser.ClientHandle, source: str) -> None:
    client.gui._websock_interface.queue_message(_messages.RunJavascriptMessage(source))
