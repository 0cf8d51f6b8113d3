"""Values of inputs, written in the thread in which those of pages come in.

Why: viser gives an input a page's value and then calls back, both in its own thread. A value that
another thread wrote between the two would be taken for the page's. And a page is not told the value
that it sent: an older one, still under way to it, would stay there.
Written for viser 1.1.1: ``_event_loop`` of ``server.gui``; a handle's ``_impl`` with its ``uuid``
and ``gui_api._websock_interface``; and the message ``GuiUpdateMessage``.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import viser
from viser import _messages


def call_in_loop(gui: viser.GuiApi, call: Callable[..., None], *arguments: Any) -> None:
    """Call a function soon, between two values of pages."""
    with suppress(RuntimeError):  # the server has ended
        gui._event_loop.call_soon_threadsafe(call, *arguments)


def confirm_value(handle: Any) -> None:
    """Tell all pages an input's value, also the page that it came from."""
    impl = handle._impl
    message = _messages.GuiUpdateMessage(impl.uuid, {"value": impl.value})
    impl.gui_api._websock_interface.queue_message(message)
