"""Controls of the page: what a user does with one posts a request, and the session's value is
written back only where it differs.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

import viser

from poseviewer.app.below_viser.upload_limits import take_upload
from poseviewer.app.workers.exporting import Export
from poseviewer.app.workers.tasks import Request, download, upload
from poseviewer.files.file_set import Kind
from poseviewer.files.state.uploads import ACCEPTED

Post = Callable[[Request], None]

MARKUP = re.compile(r"[\\`*{}\[\]<>#|~!]|(?<![^\W_])_|_(?![^\W_])")
"""Characters that mean more in markdown; a picture there would make viser read its file."""


def plain(text: str) -> str:
    """A text from a file or a user, as markdown shows it letter for letter."""
    escaped = text.replace("&", "&amp;")
    return MARKUP.sub(lambda found: f"&#{ord(found.group())};", escaped)


class Field:
    """One input; ``command`` makes what a new value asks for (None: nothing)."""

    def __init__(self, handle: Any, post: Post, command: Callable[[Any], Request | None]) -> None:
        self.handle = handle

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is None:  # our own writing
                return
            asked = command(handle.value)
            if asked is not None:
                post(asked)

    def show(self, value: Any, *, visible: bool = True) -> None:
        """Bring the input to the session's value."""
        set_properties(self.handle, value=value, visible=visible)


AT_HAND = "● "
"""Before the label of the choice that is at hand."""


@dataclass(frozen=True, slots=True)
class Controls:
    """Makes the controls of ``gui``; their requests go to ``post``."""

    gui: viser.GuiApi
    post: Post

    def field(self, handle: Any, command: Callable[[Any], Request | None]) -> Field:
        """An input whose new values ask for ``command(value)``."""
        return Field(handle, self.post, command)

    def button(self, label: str, asked: Request, color: Any = "gray", **options: Any) -> Any:
        """A button that asks for one request; ``color`` None: the page's own."""
        return self.button_for(label, lambda _: asked, color, **options)

    def button_for(
        self, label: str, asked: Callable[[int], Request], color: Any = "gray", **options: Any
    ) -> Any:
        """A button that asks for ``asked(client_id)``, worked out when it is pressed."""
        handle = self.gui.add_button(label, color=color, **options)

        @handle.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self.post(asked(event.client.client_id))

        return handle

    def choices(self, label: str, asked: Mapping[str, Request], **options: Any) -> Any:
        """Buttons in one line, each with what it asks for."""
        handle = self.gui.add_button_group(label, tuple(asked), **options)

        @handle.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                self.post(asked[handle.value.removeprefix(AT_HAND)])

        return handle

    def download(self, label: str, what: Export, icon: Any = "download") -> None:
        """A button that sends ``what`` to the page on which it is pressed."""
        self.button_for(label, lambda client: download(what, client), icon=icon)

    def upload(self, label: str, kind: Kind | None, icon: Any, adds: bool = False) -> None:
        """A button that takes files of a kind, or (None) a folder, and what is dropped."""
        accepted = "folder" if kind is None else ",".join(ACCEPTED[kind])
        handle = self.gui.add_upload_button(label, mime_type=accepted, icon=icon, color="gray")

        @handle.on_upload
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                file = take_upload(handle)
                self.post(upload(kind, file.name, file.content, adds))


def on_press(**report: Any) -> str:
    """HTML attribute that has the page's script report a press, or Enter, on an element."""
    return f'data-report="{escape(json.dumps(report))}"'


def show_at_hand(choices: Any, label: str | None) -> None:
    """Mark which of ``choices`` is at hand; None: none of them."""
    plain = (option.removeprefix(AT_HAND) for option in choices.options)
    marked = tuple(AT_HAND * (option == label) + option for option in plain)
    set_properties(choices, options=marked)


def set_properties(handle: Any, **values: Any) -> None:
    """Assign where it changes something: every assignment is a message."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)
