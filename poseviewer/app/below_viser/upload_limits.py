"""Uploads that are too large are refused before they fill the memory.

Why: viser keeps every part of every upload, whatever size was announced, until all are there, and a
button keeps the last file. It tells every page, those to come too, how far an upload is, and they
show a nameless one: here its own page is told.
Written for viser 1.1.1: its two handlers of uploads, ``gui._handle_file_transfer_start`` and
``_part``, are called by ours, which look at the sizes first; ``gui._current_file_upload_states``,
``gui._websock_interface`` and its ``queue_message``, a button's ``_impl.value``; a page's notice of
an upload, ``upload-`` and its transfer's id.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser
from viser import _messages
from viser.infra import ClientId

from poseviewer.files.state.uploads import LARGEST_UPLOAD, display_name, why_unfit

SMALLEST_PART = 65_536
"""viser's page sends parts of 512 KiB; a page that announces far more and smaller ones is not
ours."""

Refuse = Callable[[int, str], None]
"""Tells a page, by its client's id, why its upload was refused."""


def bound_uploads(server: viser.ViserServer, refuse: Refuse) -> None:
    """Let pages upload no more than ``LARGEST_UPLOAD`` bytes at a time, all uploads together."""
    gui = server.gui
    bounds = _Bounds(server, refuse)
    interface = gui._websock_interface
    start, part = _messages.FileTransferStartUpload, _messages.FileTransferPart
    interface.unregister_handler(start, gui._handle_file_transfer_start)
    interface.unregister_handler(part, gui._handle_file_transfer_part)
    interface.register_handler(start, bounds.start)
    interface.register_handler(part, bounds.part)

    @server.on_client_connect
    async def _(client: viser.ClientHandle) -> None:
        # What one page alone is shown has no place for uploads.
        client.gui._websock_interface.unregister_handler(_messages.FileTransferStartUpload)


def take_upload(handle: viser.GuiUploadButtonHandle) -> viser.UploadedFile:
    """Take the last upload, which the button would keep in memory until the next one."""
    file = handle.value
    handle._impl.value = viser.UploadedFile("", b"")
    return file


class _Bounds:
    """viser's handlers of uploads, each behind a look at the sizes."""

    def __init__(self, server: viser.ViserServer, refuse: Refuse) -> None:
        self._server, self._gui, self._refuse = server, server.gui, refuse
        self._running: dict[str, Any] = self._gui._current_file_upload_states
        interface = self._gui._websock_interface
        self._tell_all = interface.queue_message
        interface.queue_message = self._tell  # pyright: ignore[reportAttributeAccessIssue]

    def start(self, client: ClientId, message: _messages.FileTransferStartUpload) -> None:
        """An upload is announced."""
        problem = self._problem(message)
        if problem:
            self._end(client, message, problem)
        else:
            self._gui._handle_file_transfer_start(client, message)

    def part(self, client: ClientId, message: _messages.FileTransferPart) -> None:
        """A part has come; one of an upload that was refused, or is another page's, is dropped."""
        upload = self._running.get(message.transfer_uuid)
        if upload is None or upload["client_id"] != client:
            return
        if upload["transferred_bytes"] + len(message.content) > upload["total_bytes"]:
            del self._running[message.transfer_uuid]
            name = display_name(upload["filename"])
            self._end(client, message, f"{name}: more bytes came than were announced; try again.")
            return
        self._gui._handle_file_transfer_part(client, message)

    def _problem(self, message: _messages.FileTransferStartUpload) -> str:
        """Say why an upload is not taken; "" where it is."""
        name, size, parts = display_name(message.filename), message.size_bytes, message.part_count
        if not 0 <= parts <= 1 + size // SMALLEST_PART:
            return f"{name}: announced as {size} bytes in {parts} parts; try again."
        others = sum(upload["total_bytes"] for upload in self._running.values())
        if others and size + others > LARGEST_UPLOAD >= size:
            return f"{name}: another upload is under way; wait for its end, then try again."
        return why_unfit(name, size)

    def _end(self, client: ClientId, message: Any, problem: str) -> None:
        """Let the button take files again, end the page's notice, which would call it done, and say
        why.
        """
        source, transfer = message.source_component_uuid, message.transfer_uuid
        self._tell_one(client, _messages.FileTransferPartAck(source, transfer, 0, total_bytes=0))
        self._tell_one(client, _messages.RemoveNotificationMessage(f"upload-{transfer}"))
        self._refuse(client, problem)

    def _tell(self, message: _messages.Message) -> None:
        """Send a message of viser to all pages; that of an upload to its own page alone."""
        if not isinstance(message, _messages.FileTransferPartAck):
            self._tell_all(message)
        elif message.transfer_uuid in self._running:
            self._tell_one(self._running[message.transfer_uuid]["client_id"], message)

    def _tell_one(self, client: ClientId, message: _messages.Message) -> None:
        handle = self._server.get_clients().get(client)
        if handle is not None:
            handle.gui._websock_interface.queue_message(message)
