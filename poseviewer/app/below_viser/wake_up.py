"""Pages are told what is new in the thread of the server's loop, whoever asks for it.

Why: viser sets its asyncio event in the thread that has something new, too. Such an event is not
safe for threads: now and then that raised "deque mutated during iteration" where an input was
changed, or came between a page's last look and its wait, and the page was told nothing any more.
Written for viser 1.1.1: ``AsyncMessageBuffer.push`` sets ``message_event`` at once and then again
by ``call_soon_threadsafe``, or at the end of an atomic block; ``infra._infra`` makes one buffer for
all pages, and one for each.
"""

import asyncio
from dataclasses import dataclass, field

from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer


class _LoopsEvent(asyncio.Event):
    """Set in the thread of a running loop alone."""

    def set(self) -> None:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return  # ``push`` has asked the loop to do it
        super().set()


@dataclass
class _Buffer(AsyncMessageBuffer):
    message_event: asyncio.Event = field(default_factory=_LoopsEvent)


def wake_in_the_loop() -> None:
    """Let servers that start from now on wake their pages in their own thread."""
    _infra.AsyncMessageBuffer = _Buffer  # pyright: ignore[reportPrivateImportUsage]
