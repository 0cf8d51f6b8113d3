"""Pages are woken in the thread of the server's loop, whoever has a message for them.

Why: viser also sets its asyncio event in the thread that queues a message, which is not
thread-safe: now and then "deque mutated during iteration" was raised, or a page missed the event
and got no message any more.
Written for viser 1.1.1: ``AsyncMessageBuffer.push`` sets ``message_event`` at once and then again
by ``call_soon_threadsafe``, or at the end of an atomic block; ``infra._infra`` makes one buffer for
all pages, and one for each.
"""

import asyncio
from dataclasses import dataclass, field

from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer


class _LoopsEvent(asyncio.Event):
    """Event that is set only in the thread of a running loop."""

    def set(self) -> None:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return  # ``push`` has asked the loop to set it
        super().set()


@dataclass
class _Buffer(AsyncMessageBuffer):
    message_event: asyncio.Event = field(default_factory=_LoopsEvent)


def wake_in_the_loop() -> None:
    """Make servers that start from now on wake their pages in their own thread."""
    _infra.AsyncMessageBuffer = _Buffer  # pyright: ignore[reportPrivateImportUsage]
