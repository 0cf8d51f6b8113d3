"""A page of the app without a browser: speaks viser's protocol, and reports as our script does.

The wire format is that of viser 1.1.1, ``infra/_infra.py``: zstd-compressed msgpack whose arrays
are numbers of raw buffers that follow it.
"""

from __future__ import annotations

import json
import re
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import msgspec.msgpack
import numpy as np
import viser
import zstandard
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from poseviewer.files.state.uploads import pack

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
PATIENCE_S = 60.0
OUTLINE, PICTURE, PHOTO = "/model/outline", "/model/picture", "/photo"
CHANNEL = re.compile(r'"channel": "([^"]+)"')
LOOK_AGAIN_S = 0.1
NEWS_KEPT = 2000
PART = 500_000
"""Bytes of an upload in one message."""

Message = dict[str, Any]


@dataclass
class Shown:
    """What the server has told a page to show, newest state first of all."""

    nodes: dict[str, Message] = field(default_factory=dict)
    """Properties of the scene's nodes, by name; ``visible`` and ``position`` among them."""
    fields: dict[str, Message] = field(default_factory=dict)
    """Properties of inputs and texts, by uuid; ``kind`` among them."""
    modals: dict[str, str] = field(default_factory=dict)
    """Titles of the open modals, by uuid."""
    waits: set[str] = field(default_factory=set)
    """Notices that something is under way, by uuid."""
    notices: list[tuple[str, str]] = field(default_factory=list)
    """Title and text of every notice so far."""
    progress: list[tuple[int, int]] = field(default_factory=list)
    """Bytes of uploads that have arrived, and all of them, whenever the page was told."""
    downloads: dict[str, bytes] = field(default_factory=dict)
    channel: str = ""
    widths: list[float] = field(default_factory=list)
    """Of panels, in CSS px, as the page was told one after another."""
    _files: dict[str, str] = field(default_factory=dict)

    def take(self, message: Message) -> None:
        """Bring the state up to date."""
        kind = message["type"]
        if kind == "SetSceneNodeVisibilityMessage":
            self.nodes.setdefault(message["name"], {})["visible"] = message["visible"]
        elif kind == "SetPositionMessage":
            self.nodes.setdefault(message["name"], {})["position"] = message["position"]
        elif kind == "SceneNodeUpdateMessage":
            self.nodes.setdefault(message["name"], {}).update(message["updates"])
        elif kind == "RemoveSceneNodeMessage":
            self.nodes.pop(message["name"], None)
        elif kind == "GuiUpdateMessage":
            self.fields.setdefault(message["uuid"], {}).update(message["updates"])
        elif kind == "GuiRemoveMessage":
            self.fields.pop(message["uuid"], None)
        elif kind == "GuiModalMessage":
            self.modals[message["uuid"]] = message["title"]
        elif kind == "GuiCloseModalMessage":
            self.modals.pop(message["uuid"], None)
        elif kind in ("NotificationShowMessage", "NotificationUpdateMessage"):
            props = message.get("props") or message["updates"]
            self.notices.append((props.get("title", ""), props.get("body", "")))
            if props.get("loading"):
                self.waits.add(message["uuid"])
        elif kind == "RemoveNotificationMessage":
            self.waits.discard(message["uuid"])
        elif kind == "RunJavascriptMessage":
            found = CHANNEL.search(message["source"])
            self.channel = found.group(1) if found else self.channel
        elif kind == "GuiSetPanelWidthMessage":
            self.widths.append(message["width"])
        elif kind == "FileTransferPartAck":
            self.progress.append((message["transferred_bytes"], message["total_bytes"]))
        elif kind == "FileTransferStartDownload":
            self._files[message["transfer_uuid"]] = message["filename"]
            self.downloads[message["filename"]] = b""
        elif kind == "FileTransferPart":
            name = self._files[message["transfer_uuid"]]
            before = self.downloads.get(name)
            if before is not None:  # else they were cleared since it began
                self.downloads[name] = before + message["content"]
        elif "props" in message and "name" in message:
            self.nodes[message["name"]] = dict(message["props"])
        elif "props" in message and "uuid" in message:
            value = {"value": message["value"]} if "value" in message else {}
            self.fields[message["uuid"]] = {"kind": kind, **value, **message["props"]}


class SocketPage:
    """One connected page. Messages are read in a thread; ``wait_until`` looks at what they say."""

    def __init__(self, url: str) -> None:
        self.shown = Shown()
        self.outlines: list[tuple[float, NDArray[np.float32]]] = []
        """When each outline came (``time.perf_counter``), and its points (N, 2, 3)."""
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the app."""
        self._socket.close()
        self._reader.join(PATIENCE_S)

    # --- what a user does ------------------------------------------------------------------------

    def report(self, **content: Any) -> None:
        """What the page's script sends."""
        self._sequence += 1
        self.report_text(json.dumps({**content, "sequence": self._sequence}))

    def report_text(self, text: Any) -> None:
        """A report in any words."""
        self.change(self.shown.channel, text)

    def press(self, x: float, y: float, **held: bool) -> None:
        """The main button goes down at a point of the photo, in px."""
        self.report(kind="press", x=x, y=y, zoom=1.0, **held)

    def drag(self, x: float, y: float) -> None:
        """The pointer moves, the button down."""
        self.report(kind="drag", x=x, y=y)

    def release(self) -> None:
        """The button goes up."""
        self.report(kind="release")

    def key(self, code: str, **held: bool) -> None:
        """A key over the photo."""
        self.report(kind="key", code=code, **held)

    def click(self, label: str) -> None:
        """A button of the panels or of a dialog, by its label, once it is there."""
        self.wait_until(lambda: any(props.get("label") == label for _, props in self._fields()))
        self.change(self.uuid(label), True)

    def set(self, label: str, value: Any) -> None:
        """Another value of an input, by its label; the server does not send it back."""
        where = self.uuid(label)
        self.shown.fields[where]["value"] = value
        self.change(where, value)

    def change(self, where: str, value: Any) -> None:
        """Another value of an input, by its uuid."""
        self._send(type="GuiUpdateMessage", uuid=where, updates={"value": value})

    def upload(self, label: str, name: str, data: bytes, **announced: Any) -> None:
        """A file through an upload button; what is ``announced`` of it may be untrue."""
        self.upload_set(label, [(name, data)], **announced)

    def upload_set(self, label: str, files: list[tuple[str, bytes]], **announced: Any) -> None:
        """Files together, as the page's script sends them."""
        name, data = files[0][0], pack(files)
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

    def labels(self) -> set[str]:
        """Of all inputs that are not hidden."""
        return {str(p["label"]) for _, p in self._fields() if p.get("label") and p.get("visible")}

    def texts(self) -> list[str]:
        """Markdown and HTML of the panels."""
        return [
            str(props.get("_markdown", props.get("content", ""))) for _, props in self._fields()
        ]

    def text_with(self, words: str) -> str:
        """The first text of the panels that has these words; "" for none."""
        return next((text for text in self.texts() if words in text), "")

    def curve(self) -> NDArray[np.float64]:
        """(2, N): evaluations and losses of the search's plot; empty where it is hidden."""
        found = (p for _, p in self._fields() if p.get("kind") == "GuiUplotMessage")
        plot = next((p for p in found if p["visible"]), None)
        return np.zeros((2, 0)) if plot is None else np.array(plot["data"], np.float64)[:2]

    def maps(self) -> int:
        """How many maps of the loss are shown."""
        return max((text.count("<image ") for text in self.texts()), default=0)

    def outline(self) -> NDArray[np.float32]:
        """(N, 2, 3): the outline's segments, in world units; empty where there is none."""
        node = self.shown.nodes.get(OUTLINE, {})
        if not node.get("visible"):
            return np.zeros((0, 2, 3), np.float32)
        return np.asarray(node["points"], np.float32).reshape(-1, 2, 3)

    def is_shown(self, name: str) -> bool:
        """Whether a node of the scene is there, and visible."""
        node = self.shown.nodes.get(name)
        return node is not None and bool(node.get("visible", True))

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
                    raise AssertionError(f"in vain; closed: {self.closed}; {self._summary()}")
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
                messages = list(_messages(data, unpack))
                with self._change:
                    self._take(messages)
                    self._change.notify_all()
        except (ConnectionClosed, OSError) as error:
            with self._change:
                self.closed, self.why = True, str(error)
                self._change.notify_all()

    def _take(self, messages: list[Message]) -> None:
        now = time.perf_counter()
        for message in messages:
            self.shown.take(message)
            if message.get("name") == OUTLINE and "points" in message.get("updates", {}):
                points = np.asarray(message["updates"]["points"], np.float32)
                self.outlines = [*self.outlines[-NEWS_KEPT:], (now, points.reshape(-1, 2, 3))]

    def _fields(self) -> list[tuple[str, Message]]:
        return list(self.shown.fields.items())

    def _summary(self) -> str:
        texts = [text[:200] for text in self.texts() if text]
        notices = self.shown.notices[-3:]
        return f"{self.why} notices {notices}, texts {texts}, nodes {[*self.shown.nodes]}"


def _messages(data: bytes, unpack: zstandard.ZstdDecompressor) -> Iterator[Message]:
    """The messages of one batch, arrays in place."""
    compressed = int.from_bytes(data[8:16], "little")
    batch = msgspec.msgpack.decode(unpack.decompress(data[16 : 16 + compressed]))
    offset, buffers = 16 + compressed, list[bytes]()
    for length in batch["binaryBufferLengths"]:
        offset += -offset % 8
        buffers.append(data[offset : offset + length])
        offset += length
    for message in batch["messages"]:
        yield _with_arrays(message, buffers)


def _with_arrays(value: Any, buffers: list[bytes]) -> Any:
    if isinstance(value, dict):
        if "__binary_index" in value:
            return np.frombuffer(buffers[value["__binary_index"]], np.dtype(value["dtype"]))
        return {key: _with_arrays(item, buffers) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_arrays(item, buffers) for item in value]
    return value
