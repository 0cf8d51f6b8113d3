"""A page that is no browser: it speaks viser's protocol, and so may break its rules.

The wire format is that of viser 1.1.1, ``infra/_infra.py``: zstd-compressed msgpack whose arrays
are numbers of raw buffers that follow it; they are left out here.
"""

from __future__ import annotations

import json
import re
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from poseviewer.files.state.uploads import pack

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
PATIENCE_S = 60.0
CHANNEL = re.compile(r'"channel": "([^"]+)"')
LOOK_AGAIN_S = 0.1
PART = 500_000
"""Bytes of an upload in one message."""

Message = dict[str, Any]


@dataclass
class Shown:
    """What the server has told a page to show, newest state first of all."""

    fields: dict[str, Message] = field(default_factory=dict)
    """Properties of inputs and texts, by uuid; ``kind`` among them."""
    notices: list[tuple[str, str]] = field(default_factory=list)
    """Title and text of every notice so far."""
    progress: list[tuple[int, int]] = field(default_factory=list)
    """Bytes of uploads that have arrived, and all of them, whenever the page was told."""
    channel: str = ""

    def take(self, message: Message) -> None:
        """Bring the state up to date."""
        kind = message["type"]
        if kind == "GuiUpdateMessage":
            self.fields.setdefault(message["uuid"], {}).update(message["updates"])
        elif kind == "GuiRemoveMessage":
            self.fields.pop(message["uuid"], None)
        elif kind in ("NotificationShowMessage", "NotificationUpdateMessage"):
            props = message.get("props") or message["updates"]
            self.notices.append((props.get("title", ""), props.get("body", "")))
        elif kind == "RunJavascriptMessage":
            found = CHANNEL.search(message["source"])
            self.channel = found.group(1) if found else self.channel
        elif kind == "FileTransferPartAck":
            self.progress.append((message["transferred_bytes"], message["total_bytes"]))
        elif "props" in message and "uuid" in message:
            value = {"value": message["value"]} if "value" in message else {}
            self.fields[message["uuid"]] = {"kind": kind, **value, **message["props"]}


class SocketPage:
    """One connected page. Messages are read in a thread; ``wait_until`` looks at what they say."""

    def __init__(self, url: str) -> None:
        self.shown = Shown()
        self._change = threading.Condition()
        self._sequence = time.time_ns() // 1_000_000
        self.closed, self.why = False, ""
        address = url.rstrip("/").replace("http://", "ws://")
        self._socket = connect(
            address, subprotocols=[PROTOCOL], max_size=None, compression=None, ping_interval=None
        )
        self._reader = threading.Thread(target=self._read, name="page", daemon=True)
        self._reader.start()
        self._send(
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
        self.wait_until(lambda: self.shown.channel)

    def __enter__(self) -> SocketPage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the app."""
        self._socket.close()
        self._reader.join(PATIENCE_S)

    # --- what a user does ------------------------------------------------------------------------

    def key(self, code: str) -> None:
        """A key over the photo."""
        self._sequence += 1
        report = {"kind": "key", "code": code, "sequence": self._sequence}
        self.change(self.shown.channel, json.dumps(report))

    def set(self, label: str, value: Any) -> None:
        """Another value of an input, by its label; the server does not send it back."""
        where = self.uuid(label)
        self.shown.fields[where]["value"] = value
        self.change(where, value)

    def change(self, where: str, value: Any) -> None:
        """Another value of an input, by its uuid."""
        self._send(type="GuiUpdateMessage", uuid=where, updates={"value": value})

    def upload(self, label: str, name: str, data: bytes, **announced: Any) -> None:
        """A file through an upload button, sent as the page's script does; what is ``announced`` of
        it may be untrue.
        """
        data = pack([(name, data)])
        source, transfer = self.uuid(label), str(uuid.uuid4())
        parts = [data[i : i + PART] for i in range(0, len(data), PART)]
        truth = {"part_count": len(parts), "size_bytes": len(data)}
        self._send(
            type="FileTransferStartUpload",
            source_component_uuid=source,
            transfer_uuid=transfer,
            filename=name,
            mime_type="",
            **{**truth, **announced},
        )
        for index, part in enumerate(parts):
            self._send(
                type="FileTransferPart",
                source_component_uuid=source,
                transfer_uuid=transfer,
                part_index=index,
                content=part,
            )

    # --- what a user sees ------------------------------------------------------------------------

    def uuid(self, label: str) -> str:
        """Of the input with this label; there is one at most."""
        found = [key for key, props in self._fields() if props.get("label") == label]
        if len(found) != 1:
            labels = sorted(str(props.get("label")) for _, props in self._fields())
            raise AssertionError(f"{len(found)} inputs {label!r} among {labels}")
        return found[0]

    def value(self, label: str) -> Any:
        """Of the input with this label."""
        return self.shown.fields[self.uuid(label)]["value"]

    def has(self, label: str) -> bool:
        """Whether an input with this label is seen."""
        return any(p.get("label") == label and p.get("visible") for _, p in self._fields())

    def text_with(self, words: str) -> str:
        """The first markdown of the panels that has these words; "" for none."""
        texts = (str(props.get("_markdown", "")) for _, props in self._fields())
        return next((text for text in texts if words in text), "")

    def wait_until(self, predicate: Callable[[], Any], timeout: float = PATIENCE_S) -> Any:
        """The first true answer of ``predicate``, asked after every batch of messages (and now and
        then, as it may look at more than the page).

        Raises:
            AssertionError: there was none for ``timeout`` seconds, or the server has gone.
        """
        end = time.monotonic() + timeout
        with self._change:
            while True:
                answer = predicate()
                if answer:
                    return answer
                left = end - time.monotonic()
                if left <= 0.0 or self.closed:
                    told = f"closed: {self.closed} {self.why}, notices {self.shown.notices[-3:]}"
                    raise AssertionError(f"in vain; {told}")
                self._change.wait(min(left, LOOK_AGAIN_S))

    # --- the wire --------------------------------------------------------------------------------

    def _send(self, **message: Any) -> None:
        self._socket.send(msgspec.msgpack.encode(message))

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        try:
            while True:
                data = self._socket.recv()
                assert isinstance(data, bytes)
                messages = _messages(data, unpack)
                with self._change:
                    for message in messages:
                        self.shown.take(message)
                    self._change.notify_all()
        except (ConnectionClosed, OSError) as error:
            with self._change:
                self.closed, self.why = True, str(error)
                self._change.notify_all()

    def _fields(self) -> list[tuple[str, Message]]:
        return list(self.shown.fields.items())


def _messages(data: bytes, unpack: zstandard.ZstdDecompressor) -> list[Message]:
    """The messages of one batch, without their arrays."""
    compressed = int.from_bytes(data[8:16], "little")
    return msgspec.msgpack.decode(unpack.decompress(data[16 : 16 + compressed]))["messages"]
