"""A viser server that answers only those whom the AccessPolicy lets pass.

Why: viser checks neither Host nor Origin, has no login, takes the next port where one is busy, and
lets any page open a public tunnel.
Written for viser 1.1.1 and websockets 16.1. viser makes its web server deep inside its constructor,
in its own thread, by ``websockets.asyncio.server.serve``; that one call is intercepted, so that the
check is in place before the first connection. Else of viser: ``_websock_server`` and the messages
``ShareUrlRequest`` and ``ShareUrlDisconnect``.
"""

from __future__ import annotations

import errno
import http
import io
import logging
import os
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from typing import Any

import viser
import websockets.asyncio.server
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from poseviewer.app.below_viser.access import AccessPolicy, is_loopback
from poseviewer.app.below_viser.wake_up import wake_in_the_loop
from poseviewer.errors import SettingsError, printable

VISERS_OWN = "viser.infra._infra"
"""The module whose call of ``serve`` is intercepted."""
DEFAULT_PORT, PORTS_TRIED = 8080, 100
TOKEN_BYTES = 24
LARGEST_MESSAGE = 4_000_000
"""Bytes: pages send parts of uploads of 512 KiB, and nothing larger."""
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "connect-src 'self' data: blob:; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}

_log = logging.getLogger(__name__)


def _in_a_line(record: logging.LogRecord) -> bool:
    """Drop the record of a connection closed before its first line; shorten that of an unreadable
    message to a line.
    """
    if record.msg == "connection handler failed" and record.exc_info:
        error = record.exc_info[1]
        found = printable(f"{type(error).__name__}: {error}", 100)
        record.msg = f"a page sent what is no message, and was cut off ({found})"
        record.exc_info, record.levelno, record.levelname = None, logging.WARNING, "WARNING"
    return record.getMessage() != "opening handshake failed"


_log.addFilter(_in_a_line)

Answer = Callable[[ServerConnection, Request], Response | None]


@dataclass(frozen=True, slots=True)
class GuardedServer:
    """A running viser server and the policy it is guarded by."""

    server: viser.ViserServer
    policy: AccessPolicy

    @property
    def url(self) -> str:
        """The address to open, with the token where one is needed."""
        return self.policy.url

    def stop(self) -> None:
        """Close all connections and the port."""
        with redirect_stdout(io.StringIO()):  # viser prints that it has stopped
            self.server.stop()


def serve(
    host: str = "127.0.0.1", port: int | None = None, label: str | None = None
) -> GuardedServer:
    """Start a viser server that answers only its own page and programs of this machine.

    Without a ``port`` the first free one from 8080 on is taken; 0 lets the system choose.

    Raises:
        SettingsError: the port is taken or not allowed, or the host is no address of this machine.
    """
    listening = _listen(host, port)
    token = None if is_loopback(host) else secrets.token_urlsafe(TOKEN_BYTES)
    policy = AccessPolicy(host, listening.getsockname()[1], token)
    wake_in_the_loop()
    try:
        # viser prints its address, without the token, to the standard output.
        with _guarded_serve(listening, policy) as calls, redirect_stdout(io.StringIO()):
            # Where viser itself would listen, if it ever came past the guard.
            server = viser.ViserServer("127.0.0.1", 0, label, verbose=False)
    except BaseException:
        listening.close()
        raise
    if len(calls) != 1:
        server.stop()
        listening.close()
        raise RuntimeError(
            f"viser {viser.__version__} starts its server in another way than 1.1.1, unguarded; "
            "install viser 1.1.1."
        )
    # A page could ask viser to open a public tunnel to this server; no more.
    for kind in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(kind)
    return GuardedServer(server, policy)


@contextmanager
def _guarded_serve(listening: socket.socket, policy: AccessPolicy) -> Iterator[list[str]]:
    """While open, viser's server listens on our socket and asks the policy; gives the calls."""
    calls: list[str] = []
    original = websockets.asyncio.server.serve

    def guarded(handler: Any, *args: Any, **settings: Any) -> Any:
        if getattr(handler, "__module__", "") != VISERS_OWN:
            return original(handler, *args, **settings)  # somebody else's server
        calls.append(handler.__qualname__)
        answer = settings.pop("process_request", None)
        settings.pop("host", None)
        settings.pop("port", None)
        settings |= {"process_request": _checked(policy, answer), "logger": _log}
        settings["max_size"] = LARGEST_MESSAGE
        return original(handler, sock=listening, **settings)

    websockets.asyncio.server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield calls
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]


def _checked(policy: AccessPolicy, answer: Answer | None) -> Answer:
    """An answer to requests, HTTP and websocket alike, that asks the policy first."""

    def process_request(connection: ServerConnection, request: Request) -> Response | None:
        refusal = policy.refusal(request.path, request.headers)
        if refusal is not None:
            response = connection.respond(http.HTTPStatus.FORBIDDEN, f"{refusal}\n")
        else:
            response = None if answer is None else answer(connection, request)
        if response is not None:
            for name, value in SECURITY_HEADERS.items():
                response.headers[name] = value
            cookie = None if refusal is not None else policy.cookie_to_set(request.path)
            if cookie is not None:
                response.headers["Set-Cookie"] = cookie
        return response

    return process_request


def _listen(host: str, port: int | None) -> socket.socket:
    """A listening socket. viser would silently take the next port where one is busy."""
    if port is not None and not 0 <= port <= 65535:
        raise SettingsError(f"Port {port}: wanted a number from 0 to 65535; choose another one.")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    ports = range(DEFAULT_PORT, DEFAULT_PORT + PORTS_TRIED) if port is None else [port]
    problem = 0
    for candidate in ports:
        try:
            listening = socket.create_server((host, candidate), family=family)
        except (OSError, UnicodeError) as error:
            problem = error.errno if isinstance(error, OSError) else -1
            if problem is None or problem < 0 or problem == errno.EADDRNOTAVAIL:
                raise SettingsError(
                    f"Host {host!r}: not an address of this machine; wanted 127.0.0.1, or one that "
                    "is."
                ) from error
        else:
            # asyncio sets this only on sockets that say they are TCP; what is accepted here does
            # not. Without it the end of a message waits until the page has something to send.
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return listening
    where = f"Port {port}" if port is not None else f"Ports {ports[0]} to {ports[-1]}"
    raise SettingsError(
        f"{where} of {host!r}: cannot be listened on ({os.strerror(problem)}); "
        "stop the other program, or choose another port (0 for any free one)."
    )
