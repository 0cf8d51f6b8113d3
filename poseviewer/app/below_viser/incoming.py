"""Checks of what pages send before viser takes it: too large uploads, and values that an input
cannot have, are refused.

Why: viser keeps all parts of an upload, whatever size was announced, until the last has come, and a
button keeps its last file. It reports the progress of an upload to all pages, which show a nameless
notice; here only the upload's page is told. viser sets any attribute of an input that a page names,
and sends any number on: one beyond 64 bits cuts off all pages, and an unknown choice ends in a
traceback. It keeps for all later pages that a form is unsent, whether there is such a form or not;
we have none.
Written for viser 1.1.1: its handlers ``gui._handle_file_transfer_start``, ``_part`` and
``gui._handle_gui_updates`` are called by ours; ``gui._current_file_upload_states``,
``gui._gui_input_handle_from_uuid``, ``gui._websock_interface`` and its ``queue_message``, a
button's ``_impl.value``; a page's notice of an upload, ``upload-`` and its transfer's id.
"""

import math
from collections.abc import Callable
from typing import Any

import viser
from viser import _messages as m
from viser.infra import ClientId

from poseviewer.opening.uploads import MAX_UPLOAD_BYTES, display_name, why_unfit

MIN_PART_BYTES = 65_536
"""Least size of a part: viser's page sends 512 KiB."""
MAX_EXACT_INTEGER = 2.0**53
"""Largest integer that JavaScript holds exactly."""

Refuse = Callable[[int, str], None]
"""Shows a client, by its id, why its upload was refused."""


def check_incoming(server: viser.ViserServer, refuse: Refuse) -> None:
    """Check uploads, of ``MAX_UPLOAD_BYTES`` bytes at a time, and values of inputs."""
    gui, checks = server.gui, _Checks(server, refuse)
    handlers: Any = {
        m.FileTransferStartUpload: (gui._handle_file_transfer_start, checks.start),
        m.FileTransferPart: (gui._handle_file_transfer_part, checks.part),
        m.GuiUpdateMessage: (gui._handle_gui_updates, checks.value),
    }
    for kind, (visers, ours) in handlers.items():
        gui._websock_interface.unregister_handler(kind, visers)
        gui._websock_interface.register_handler(kind, ours)

    gui._websock_interface.unregister_handler(m.GuiFormDirtyMessage)

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        # Elements of one page alone take no uploads, nor are they forms.
        client.gui._websock_interface.unregister_handler(m.FileTransferStartUpload)
        client.gui._websock_interface.unregister_handler(m.GuiFormDirtyMessage)


def take_upload(handle: viser.GuiUploadButtonHandle) -> viser.UploadedFile:
    """Take the last upload out of its button, which would keep it in memory."""
    file = handle.value
    handle._impl.value = viser.UploadedFile("", b"")
    return file


class _Checks:
    """viser's handlers, each behind a check."""

    def __init__(self, server: viser.ViserServer, refuse: Refuse) -> None:
        self._server = server
        self._gui = server.gui
        self._refuse = refuse
        self._running: dict[str, Any] = self._gui._current_file_upload_states
        interface = self._gui._websock_interface
        self._tell_all = interface.queue_message
        interface.queue_message = self._tell  # pyright: ignore[reportAttributeAccessIssue]

    def start(self, client: ClientId, message: m.FileTransferStartUpload) -> None:
        """Check the announcement of an upload."""
        problem = self._problem(message)
        if problem:
            self._end(client, message, problem)
        else:
            self._gui._handle_file_transfer_start(client, message)

    def part(self, client: ClientId, message: m.FileTransferPart) -> None:
        """Check a part; those of refused uploads, and of other pages', are dropped."""
        upload = self._running.get(message.transfer_uuid)
        if upload is None or upload["client_id"] != client:
            return
        if upload["transferred_bytes"] + len(message.content) <= upload["total_bytes"]:
            self._gui._handle_file_transfer_part(client, message)
            return
        del self._running[message.transfer_uuid]
        name = display_name(upload["filename"])
        self._end(client, message, f"{name}: more bytes came than were announced; try again.")

    async def value(self, client: ClientId, message: m.GuiUpdateMessage) -> None:
        """Check a new value of an input."""
        handle = self._gui._gui_input_handle_from_uuid.get(message.uuid)
        if handle is None or isinstance(handle.value, viser.UploadedFile):  # files come in parts
            return
        if message.updates.keys() == {"value"} and _can_have(handle, message.updates["value"]):
            await self._gui._handle_gui_updates(client, message)
        else:
            self._tell_all(m.GuiUpdateMessage(message.uuid, {"value": handle.value}))

    def _problem(self, message: m.FileTransferStartUpload) -> str:
        """Sentence why an upload is refused; "": it is taken."""
        name = display_name(message.filename)
        size = message.size_bytes
        parts = message.part_count
        if not 0 <= parts <= 1 + size // MIN_PART_BYTES:
            return f"{name}: announced as {size} bytes in {parts} parts; try again."
        others = sum(upload["total_bytes"] for upload in self._running.values())
        if others and size + others > MAX_UPLOAD_BYTES >= size:
            return f"{name}: another upload is under way; wait for its end, then try again."
        return why_unfit(name, size)

    def _end(self, client: ClientId, message: Any, problem: str) -> None:
        """End an upload: free the button, close the notice, and show the problem."""
        source, transfer = message.source_component_uuid, message.transfer_uuid
        self._tell_one(client, m.FileTransferPartAck(source, transfer, 0, total_bytes=0))
        self._tell_one(client, m.RemoveNotificationMessage(f"upload-{transfer}"))
        self._refuse(client, problem)

    def _tell(self, message: m.Message) -> None:
        """Send a message to all pages, or that of an upload to its own page."""
        if not isinstance(message, m.FileTransferPartAck):
            self._tell_all(message)
        elif message.transfer_uuid in self._running:
            self._tell_one(self._running[message.transfer_uuid]["client_id"], message)

    def _tell_one(self, client: ClientId, message: m.Message) -> None:
        handle = self._server.get_clients().get(client)
        if handle is not None:
            handle.gui._websock_interface.queue_message(message)


def _can_have(handle: Any, value: object) -> bool:
    """Whether an input can have the value."""
    old = handle.value
    if hasattr(handle, "options"):
        return value in handle.options
    if isinstance(old, bool | str):
        return type(value) is type(old)
    if isinstance(old, int):
        return isinstance(value, int | float) and abs(value) <= MAX_EXACT_INTEGER
    return not isinstance(old, float) or (isinstance(value, int | float) and not math.isinf(value))
