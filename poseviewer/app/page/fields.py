"""Inputs of the page, bound to the session: a change posts a command, and the session's value is
written back only where it differs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import viser

from poseviewer.app.state.requests import Download, Export, Request

Post = Callable[[Request], None]


class Field:
    """One input; ``command`` makes what a new value asks for (None: nothing)."""

    def __init__(self, handle: Any, post: Post, command: Callable[[Any], Request | None]) -> None:
        self.handle = handle
        self._text: dict[str, Any] = {}

        @handle.on_update
        async def _(event: viser.GuiEvent) -> None:
            if event.client is None:  # our own writing
                return
            asked = command(handle.value)
            if asked is not None:
                post(asked)

    def show(self, value: Any, *, visible: bool = True, disabled: bool = False) -> None:
        """Bring the input to the session's value."""
        if self.handle.value != value:
            self.handle.value = value
        set_property(self.handle, "visible", visible)
        set_property(self.handle, "disabled", disabled)


def button(
    gui: viser.GuiApi, label: str, post: Post, asked: Callable[[int], Request], **options: Any
) -> Any:
    """A button that asks for ``asked(client_id)``."""
    handle = gui.add_button(label, **options)

    @handle.on_click
    async def _(event: viser.GuiEvent) -> None:
        if event.client is not None:
            post(asked(event.client.client_id))

    return handle


def download_button(
    gui: viser.GuiApi, label: str, post: Post, what: Export, icon: Any = "download"
) -> Any:
    """A button that sends ``what`` to the page on which it is pressed."""
    return button(gui, label, post, lambda client: Download(what, client), icon=icon, color="gray")


def choices(gui: viser.GuiApi, label: str, post: Post, asked: Mapping[str, Request]) -> Any:
    """Buttons in one line, each with what it asks for."""
    handle = gui.add_button_group(label, tuple(asked))

    @handle.on_click
    async def _(event: viser.GuiEvent) -> None:
        if event.client is not None:
            post(asked[handle.value])

    return handle


def set_property(handle: Any, name: str, value: Any) -> None:
    """Assign where it changes something: every assignment is a message."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)
