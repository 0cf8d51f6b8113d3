"""Pages are woken in the thread of the server's loop."""

import asyncio
import threading

from poseviewer.app.below_viser.guard import serve

PATIENCE_S = 60.0


def test_what_another_thread_has_is_told_by_the_loop():
    guarded = serve(port=0)
    inside = guarded.server._websock_server
    buffer, loop = inside._broadcast_buffer, inside._background_event_loop
    assert loop is not None
    held, goes_on = threading.Event(), threading.Event()

    def hold() -> None:
        buffer.message_event.clear()
        held.set()
        goes_on.wait()

    try:
        loop.call_soon_threadsafe(hold)
        held.wait()
        guarded.server.gui.add_text("Name", "")
        assert not buffer.message_event.is_set()
        goes_on.set()
        woken = asyncio.run_coroutine_threadsafe(buffer.message_event.wait(), loop)
        assert woken.result(PATIENCE_S)
    finally:
        goes_on.set()
        guarded.stop()
