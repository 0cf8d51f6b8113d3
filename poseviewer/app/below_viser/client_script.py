"""The page's own script, ``client.js``, and what it reports.

Why: viser has no zoom and pan that keep the registration, no keys, no drop of files, and no way to
make a panel narrower on one page.
Written for viser 1.1.1: the messages ``RunJavascriptMessage`` and ``GuiSetPanelWidthMessage``, put
into ``client.gui._websock_interface``; a panel's ``_placement_uuid``, a field's ``_impl.uuid``; and
in the page ``window.__viserMutable`` (its camera, canvas, nodes and ``sendMessage``).
"""

from __future__ import annotations

import base64
import json
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import viser
from viser import _messages

_SOURCE = Path(__file__).with_name("client.js")
_ICON = Path(__file__).with_name("icon.svg")

Report = dict[str, Any]


class ClientScript:
    """Puts the script on every page that connects, and hands on what pages report."""

    def __init__(
        self,
        server: viser.ViserServer,
        config: Mapping[str, Any],
        on_report: Callable[[Report, int], None],
    ) -> None:
        """``config``: what the script is told, as the head of ``client.js`` says;
        ``on_report(report, client_id)`` is called in viser's thread.
        """
        self._server = server
        self._config = config
        self._photo = (1, 1)
        self._hint = ""
        self._narrow_panels: list[tuple[viser.MainPanelHandle | viser.PanelHandle, float]] = []
        # Pages report through a text field that nobody sees; viser has no other public way back.
        self._channel = server.gui.add_text("report", "", visible=False)

        @self._channel.on_update
        async def _(event: viser.GuiEvent) -> None:
            report = _parsed(self._channel.value)
            if event.client is None or report is None:
                return
            if report["kind"] == "narrow":
                self._narrow(event.client)
            else:
                on_report(report, event.client.client_id)

        server.on_client_connect(self._greet)

    def show_photo(self, width: int, height: int) -> None:
        """The photo's size in px, on all pages; the whole photo is shown."""
        if self._photo != (width, height):
            self._photo = (width, height)
            self._run(f"window.poseviewer && window.poseviewer.setPhoto({width}, {height})")

    def show_hint(self, text: str) -> None:
        """A line over the photo in place of what the mouse does; "" brings that back."""
        if self._hint != text:
            self._hint = text
            self._run(f"window.poseviewer && window.poseviewer.setHint({json.dumps(text)})")

    def narrow_in_small_windows(
        self, panel: viser.MainPanelHandle | viser.PanelHandle, width: float
    ) -> None:
        """Make a panel so wide, in CSS px, on every page whose window is small."""
        self._narrow_panels.append((panel, width))

    def _narrow(self, client: viser.ClientHandle) -> None:
        for panel, width in self._narrow_panels:
            # A run of its own: pages heed it whatever was sent before.
            message = _messages.GuiSetPanelWidthMessage(
                panel._placement_uuid, width, counter=1, run_id=uuid.uuid4().hex
            )
            client.gui._websock_interface.queue_message(message)

    async def _greet(self, client: viser.ClientHandle) -> None:
        icon = base64.b64encode(_ICON.read_bytes()).decode()
        config = {
            **self._config,
            "channel": self._channel._impl.uuid,
            "photo": self._photo,
            "icon": f"data:image/svg+xml;base64,{icon}",
        }
        source = _SOURCE.read_text(encoding="utf-8")
        source = source.replace("/*CONFIG*/ {}", json.dumps(config), 1)
        hint = f"\nwindow.poseviewer.setHint({json.dumps(self._hint)});"
        _run_on(client, source + hint)

    def _run(self, source: str) -> None:
        for client in self._server.get_clients().values():
            _run_on(client, source)


def _run_on(client: viser.ClientHandle, source: str) -> None:
    client.gui._websock_interface.queue_message(_messages.RunJavascriptMessage(source))


def _parsed(text: object) -> Report | None:
    """What a page reported; None for what is no report (any page of ours may send anything)."""
    try:
        report = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        return None
    return report if isinstance(report, dict) and isinstance(report.get("kind"), str) else None
