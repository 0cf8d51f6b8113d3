"""A page that is no browser: it speaks viser's protocol, and so may break its rules.

The wire format is that of viser 1.1.1, ``infra/_infra.py``: zstd-compressed msgpack whose arrays
are numbers of raw buffers that follow it; they are left out here.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
PATIENCE_S = 60.0
LOOK_AGAIN_S = 0.1

Message = dict[str, Any]


class SocketPage:
    """One connected page. Messages are read in a thread; ``wait_until`` looks at what they say."""

    def __init__(self, url: str) -> None:
        self.told: list[Message] = []
        self._change = threading.Condition()
        self._closed = ""
        address = url.replace("http://", "ws://")
        self._socket = connect(
            address, subprotocols=[PROTOCOL], max_size=None, compression=None, ping_interval=None
        )
        self._reader = threading.Thread(target=self._read, name="page", daemon=True)
        self._reader.start()
        self.send(
            type="ViewerCameraMessage",
            wxyz=(1.0, 0.0, 0.0, 0.0),
            position=(0.0, 0.0, 0.0),
            fov=0.8,
            near=1.0,
            far=100.0,
            image_height=800,
            image_width=1200,
            look_at=(0.0, 0.0, 1.0),
            up_direction=(0.0, -1.0, 0.0),
        )
        self.wait_until(lambda: self.all_of("RunJavascriptMessage"))

    def __enter__(self) -> SocketPage:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._reader.join(PATIENCE_S)

    def send(self, **message: Any) -> None:
        """Send a message."""
        self._socket.send(msgspec.msgpack.encode(message))

    def change(self, uuid: str, value: Any) -> None:
        """Send another value of an input."""
        self.send(type="GuiUpdateMessage", uuid=uuid, updates={"value": value})

    def all_of(self, kind: str) -> list[Message]:
        """All messages of a kind so far."""
        return [message for message in self.told if message["type"] == kind]

    def notices(self) -> list[str]:
        """Texts of all notices so far."""
        return [message["props"]["body"] for message in self.all_of("NotificationShowMessage")]

    def values(self, uuid: str) -> list[Any]:
        """All values of an input that the page was told."""
        own = [message for message in self.told if message.get("uuid") == uuid]
        told = [message.get("updates", message) for message in own]
        return [message["value"] for message in told if "value" in message]

    def wait_until(self, predicate: Callable[[], Any]) -> Any:
        """The first true answer of ``predicate``, asked after every batch of messages (and now and
        then, as it may look at more than the page).

        Raises:
            AssertionError: there was none for a minute, or the server has gone.
        """
        end = time.monotonic() + PATIENCE_S
        with self._change:
            while not (answer := predicate()):
                left = end - time.monotonic()
                assert left > 0.0, f"in vain; notices {self.notices()[-3:]}"
                assert not self._closed, self._closed
                self._change.wait(min(left, LOOK_AGAIN_S))
            return answer

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        try:
            while True:
                data = self._socket.recv()
                assert isinstance(data, bytes)
                packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
                with self._change:
                    self.told += msgspec.msgpack.decode(unpack.decompress(packed))["messages"]
                    self._change.notify_all()
        except (ConnectionClosed, OSError) as error:
            with self._change:
                self._closed = f"closed: {error}"
                self._change.notify_all()
