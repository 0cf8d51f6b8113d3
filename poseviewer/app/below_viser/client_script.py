"""The page's own script, ``client.js``, and what it reports.

Why: viser has no zoom and pan that keep the registration, no keys, no drop of files, no folders of
which one is open.
Written for viser 1.1.1: the message ``RunJavascriptMessage``, put into
``client.gui._websock_interface``; a field's ``_impl.uuid``; and in the page
``window.__viserMutable`` (its camera, canvas, nodes, ``sendMessage``), the headers of folders
(Mantine's ``Paper`` in a ``Paper``, with a chevron that says whether it is open).
"""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from threading import Lock
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
        on_report: Callable[[Report, viser.ClientHandle], None],
    ) -> None:
        """``config``: what the script is told, as the head of ``client.js`` says;
        ``on_report(report, client)`` is called in viser's thread.
        """
        self._server = server
        self._config = config
        self._photo = (1, 1)
        self._hint = ""
        self._pen = ("", False)
        self._strip = self._rows = "[]"
        # A page that connects is told everything before it is told of a change.
        self._telling = Lock()
        # Pages report through a text field that nobody sees; viser has no other public way back.
        self._channel = server.gui.add_text("report", "", visible=False)

        @self._channel.on_update
        async def _(event: viser.GuiEvent) -> None:
            report = _parsed(self._channel.value)
            if event.client is None or report is None:
                return
            on_report(report, event.client)

        server.on_client_connect(self._greet)

    def show_photo(self, width: int, height: int) -> None:
        """The photo's size in px, on all pages; the whole photo is shown."""
        with self._telling:
            if self._photo != (width, height):
                self._photo = (width, height)
                self._run(f"window.poseviewer && window.poseviewer.setPhoto({width}, {height})")

    def show_hint(self, text: str) -> None:
        """A line over the photo in place of what the mouse does; "" brings that back."""
        with self._telling:
            if self._hint != text:
                self._hint = text
                self._run(f"window.poseviewer && window.poseviewer.setHint({json.dumps(text)})")

    def show_pen(self, shape: str, erase: bool) -> None:
        """What the main button draws on the photo: ``brush``, ``polygon``, ``scribble``, "" for
        nothing; whether strokes ``erase``, for their colour and for the page's report of them.
        """
        with self._telling:
            if self._pen != (shape, erase):
                self._pen = shape, erase
                self._run(f"window.poseviewer && {self._pen_call()}")

    def forget_strokes(self) -> None:
        """Pages need not show the strokes that are done any longer."""
        self._run("window.poseviewer && window.poseviewer.forgetStrokes()")

    def show_strip(self, photos: Sequence[Mapping[str, Any]]) -> None:
        """Small pictures of a set's photos below the large one: ``name``, ``picture`` (a URI),
        ``width`` and ``height`` of each; none: no strip.
        """
        with self._telling:
            self._strip, self._rows = json.dumps(photos), "[]"
            self._run(f"window.poseviewer && window.poseviewer.setStrip({self._strip})")

    def show_strip_rows(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """What is shown on each of them: whether it is ``large`` and ``off``, what is ``said`` of
        it, the verdict's ``word``, and the outline's ``path`` (SVG, 1000 units along each side).
        """
        with self._telling:
            if self._rows != (told := json.dumps(rows)):
                self._rows = told
                self._run(f"window.poseviewer && window.poseviewer.setStripRows({told})")

    def _pen_call(self) -> str:
        return f"window.poseviewer.setPen({json.dumps(self._pen[0])}, {json.dumps(self._pen[1])})"

    async def _greet(self, client: viser.ClientHandle) -> None:
        icon = base64.b64encode(_ICON.read_bytes()).decode()
        source = _SOURCE.read_text(encoding="utf-8")
        with self._telling:
            config = {
                **self._config,
                "channel": self._channel._impl.uuid,
                "photo": self._photo,
                "icon": f"data:image/svg+xml;base64,{icon}",
            }
            source = source.replace("/*CONFIG*/ {}", json.dumps(config), 1)
            hint = f"setHint({json.dumps(self._hint)})"
            strip = f"setStrip({self._strip})", f"setStripRows({self._rows})"
            source += "".join(f"\nwindow.poseviewer.{call};" for call in (hint, *strip))
            _run_on(client, f"{source}\n{self._pen_call()};")

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
