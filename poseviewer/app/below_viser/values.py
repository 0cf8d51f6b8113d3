"""Values of inputs that no page of ours sends go no farther.

Why: viser sets whatever attribute of an input a page names, turns every number for a field of whole
numbers into one, and sends it on: one beyond 64 bits cuts off all pages, those to come too; a
choice that is none ends in a traceback.
Written for viser 1.1.1: its handler ``gui._handle_gui_updates`` is called by ours, which looks at
the value first; ``gui._gui_input_handle_from_uuid``, ``gui._websock_interface`` and its
``queue_message``.
"""

from __future__ import annotations

import math
from typing import Any

import viser
from viser import _messages
from viser.infra import ClientId

LARGEST_WHOLE = 2.0**53
"""Largest whole number that a page's script counts exactly."""


def check_values(server: viser.ViserServer) -> None:
    """Take from pages only values that an input can have; else all are told which it has."""
    gui = server.gui
    interface, known = gui._websock_interface, gui._gui_input_handle_from_uuid

    async def take(client: ClientId, message: _messages.GuiUpdateMessage) -> None:
        handle = known.get(message.uuid)
        if handle is None:
            return
        if message.updates.keys() == {"value"} and _is_one_of(handle, message.updates["value"]):
            await gui._handle_gui_updates(client, message)
        else:
            update = {"value": handle.value}
            interface.queue_message(_messages.GuiUpdateMessage(message.uuid, update))

    interface.unregister_handler(_messages.GuiUpdateMessage, gui._handle_gui_updates)
    interface.register_handler(_messages.GuiUpdateMessage, take)


def _is_one_of(handle: Any, value: object) -> bool:
    """Whether an input can have the value."""
    options, own = getattr(handle, "options", None), handle.value
    if options is not None:
        return value in options
    if isinstance(own, bool | str):
        return type(value) is type(own)
    if isinstance(own, int):
        return isinstance(value, int | float) and abs(value) <= LARGEST_WHOLE
    if isinstance(own, float):
        return isinstance(value, int | float) and not math.isinf(value)
    return True
