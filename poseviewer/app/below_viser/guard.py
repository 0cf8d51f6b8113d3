"""A viser server that answers only whom its policy lets pass: by Host, Origin and token.

Why: viser checks neither Host nor Origin, has no login, takes the next port if one is busy, and
lets any page open a public tunnel. A foreign page may send requests to this machine, and by DNS
rebinding read the answers (Jackson et al. 2007, "Protecting browsers from DNS rebinding attacks");
its Host or Origin gives it away. Other users and machines can reach the app as well; they lack the
random token of the run. It is in the printed address and in that of the page's websocket, but in no
cookie, which browsers send to all ports of a machine. ``first.html`` puts it there, and keeps it in
the storage of the page's origin, from which ``refused.html`` hands it to further tabs. viser shows
its own panel until the page is built; ``first.html`` covers it and says what poseviewer is.
viser takes fields of messages for what they are called; one of another type, such as a list as an
id, ends in a traceback in the log. Connections that say nothing take files from the whole process.
Written for viser 1.1.1 and websockets 16.1. viser makes its web server deep inside its constructor,
in its own thread, by ``websockets.asyncio.server.serve``; that call is intercepted, so that the
check stands before the first connection. Also used of viser: ``_websock_server``, the messages
``ShareUrlRequest`` and ``ShareUrlDisconnect``, ``infra._infra._message_consumer``, and of its page
the message ``set_server`` to the worker that has the websocket.
"""

import asyncio
import errno
import gzip
import hmac
import http
import io
import ipaddress
import logging
import os
import re
import secrets
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

import msgspec
import viser
import websockets.asyncio.server
from viser import _messages
from viser.infra import _infra
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from poseviewer.app.below_viser.wake_up import wake_in_the_loop
from poseviewer.errors import SettingsError, printable

VISERS_MODULE = "viser.infra._infra"
"""Module whose call of ``serve`` is intercepted."""
DEFAULT_PORT = 8080
PORTS_TRIED = 100
MAX_MESSAGE_BYTES = 4_000_000
"""Pages send parts of uploads of 512 KiB, and nothing larger."""
MAX_SILENT = 32
"""Connections that have not asked for anything yet: browsers open six at once, and macOS lets a
process have 256 files.
"""
SECURITY_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Content-Security-Policy": "connect-src 'self' data: blob:; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
VISERS_TITLE = b"<title>Viser</title>"
FIRST_HTML = Path(__file__).with_name("first.html")
"""Replaces the title of viser's page, with the token."""
TOKEN_IN_HTML = b"/*TOKEN*/"
REFUSED_HTML = Path(__file__).with_name("refused.html")
"""Follows the sentence about a token that is missing or wrong."""
FOREIGN_SOURCES = ("playbackPath", "websocket")
"""Parameters by which a link makes viser's page take messages, also scripts, from elsewhere."""

_log = logging.getLogger(__name__)


def _shorten(record: logging.LogRecord) -> bool:
    """Filter out connections that close before their first line; shorten unreadable messages."""
    if record.msg == "connection handler failed" and record.exc_info:
        error = record.exc_info[1]
        words = printable(f"{type(error).__name__}: {error}", 100)
        record.msg = f"a page sent what is no message, and was cut off ({words})"
        record.exc_info = None
        record.levelno = logging.WARNING
        record.levelname = "WARNING"
    return record.getMessage() != "opening handshake failed"


_log.addFilter(_shorten)

MAX_TARGET_LETTERS = 4000
"""Letters of a path and query: viser looks for a file of that name."""
Answer = Callable[[Any, Request], Response | None]


@dataclass(frozen=True, slots=True)
class AccessPolicy:
    """Rule of who may connect to the app at ``host`` and ``port``."""

    host: str
    port: int
    token: str = field(repr=False)
    tickets: set[str] = field(default_factory=set, repr=False)
    """Tokens that are valid until a page is connected."""

    def url(self, token: str) -> str:
        """The address for the user's browser, with a token."""
        # 0.0.0.0 and :: stand for all addresses of this machine.
        name = socket.gethostname() if self.host in ("", "0.0.0.0", "::") else self.host
        name = f"[{name}]" if ":" in name else name
        return f"http://{name}:{self.port}/?token={token}"

    def refusal(self, target: str, headers: Headers) -> str | None:
        """Sentence why a request for a path and query is refused; None: it may pass."""
        # Strangers read refusals: no token.
        instead = f"open {self.url('').partition('?')[0]} instead."
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(target) > MAX_TARGET_LETTERS:
            return f"The address has {len(target):,} characters; {instead}"
        if len(hosts) != 1:
            return f"The request names {len(hosts)} hosts, wanted one; {instead}"
        host, query = hosts[0].lower(), _query(target)
        if is_loopback(self.host) and not is_loopback(_name_in(host)):
            return (
                f"The request is for {hosts[0][:80]!r}, but this poseviewer serves this machine "
                f"alone; {instead}"
            )
        own = [f"http://{host}"], [f"https://{host}"]
        if origins and [origin.lower() for origin in origins] not in own:
            return (
                f"The request comes from a page of {origins[0][:80]!r}, and only poseviewer's own "
                f"page may talk to it; {instead}"
            )
        for name in FOREIGN_SOURCES:
            if name in query:
                return (
                    f"The address asks for {name!r}, which would hand this page to another server; "
                    f"{instead}"
                )
        return None

    def token_refusal(self, target: str) -> str | None:
        """Sentence why the token in a path and query is refused; None: it is the right one."""
        given = next(iter(_query(target).get("token", [])), "")
        # compare_digest takes no text beyond ASCII.
        data = given.encode(errors="surrogateescape")
        if any(hmac.compare_digest(data, t.encode()) for t in (self.token, *self.tickets)):
            return None
        return (
            f"The token {'is not the right one' if given else 'is missing'}; open the whole "
            "address that poseviewer printed, with its ?token=..., in this browser."
        )


@dataclass(frozen=True, slots=True)
class GuardedServer:
    """A running viser server with its policy."""

    server: viser.ViserServer
    policy: AccessPolicy

    @property
    def url(self) -> str:
        """The address to open, valid as long as the server runs."""
        return self.policy.url(self.policy.token)

    def url_to_hand_on(self) -> str:
        """An address for the first page that opens it, as others may read it."""
        self.policy.tickets.add(ticket := secrets.token_urlsafe())
        return self.policy.url(ticket)

    def stop(self) -> None:
        """Close all connections and the port."""
        with redirect_stdout(io.StringIO()):  # viser prints that it has stopped
            self.server.stop()


def serve(
    host: str = "127.0.0.1",
    port: int | None = None,
    label: str | None = None,
) -> GuardedServer:
    """Start a viser server that answers only its own page, and only with the token of this run.

    Args:
        host: address to listen at.
        port: to listen at; None: the first free one from 8080 on; 0: the system chooses.
        label: of viser's page.

    Raises:
        SettingsError: the port is taken or not allowed, or the host is no address of this machine.
    """
    listening = _listen(host, port)
    policy = AccessPolicy(host, listening.getsockname()[1], secrets.token_urlsafe())
    wake_in_the_loop()
    _infra._message_consumer = _hand_on_messages
    try:
        # viser prints its address, without the token, to the standard output.
        with _intercept_serve(listening, policy) as calls, redirect_stdout(io.StringIO()):
            # viser would listen here if it came past the guard.
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
    # By these messages a page could open a public tunnel.
    for kind in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(kind)
    return GuardedServer(server, policy)


@contextmanager
def _intercept_serve(listening: socket.socket, policy: AccessPolicy) -> Iterator[list[str]]:
    """Make viser's server listen on our socket and ask the policy; yields the calls."""
    calls: list[str] = []
    original = websockets.asyncio.server.serve

    def serve_by_policy(handler: Any, *args: Any, **settings: Any) -> Any:
        if getattr(handler, "__module__", "") != VISERS_MODULE:
            return original(handler, *args, **settings)  # not viser's server
        calls.append(handler.__qualname__)
        settings["process_request"] = _check_requests(policy, settings["process_request"])
        settings |= {"logger": _log, "max_size": MAX_MESSAGE_BYTES}
        settings |= {"create_connection": _Connection, "backlog": MAX_SILENT}
        return original(handler, sock=listening, **settings)

    websockets.asyncio.server.serve = serve_by_policy  # type: ignore[assignment,misc]
    try:
        yield calls
    finally:
        websockets.asyncio.server.serve = original  # type: ignore[misc]


class _Connection(ServerConnection):
    """A connection that is closed if it says nothing while many others come."""

    _silent: dict["_Connection", None] = {}  # noqa: RUF012 - of all servers, the oldest first

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._silent[self] = None
        if len(self._silent) > MAX_SILENT:
            oldest = next(iter(self._silent))
            oldest.has_asked()
            oldest.transport.abort()

    def has_asked(self) -> None:
        """Take it out of those that say nothing."""
        self._silent.pop(self, None)

    def connection_lost(self, exc: Exception | None) -> None:
        self.has_asked()
        super().connection_lost(exc)


async def _hand_on_messages(
    connection: ServerConnection, hand_on: Callable[[_messages.Message], None], kind: Any
) -> None:
    """Hand on messages whose fields are of their types; others end their page."""
    while True:
        message = kind.deserialize(await connection.recv(decode=False))
        values = {own.name: getattr(message, own.name) for own in fields(message) if own.init}
        msgspec.convert(values, type(message))
        hand_on(message)


def _check_requests(policy: AccessPolicy, answer: Answer) -> Answer:
    """Wrap an answer to HTTP and websocket requests so that the policy is asked first."""

    def process_request(connection: _Connection, request: Request) -> Response | None:
        connection.has_asked()
        if refusal := policy.refusal(request.path, request.headers):
            response = connection.respond(http.HTTPStatus.FORBIDDEN, f"{refusal}\n")
        elif refusal := policy.token_refusal(request.path):
            text = f"{refusal}\n{REFUSED_HTML.read_text(encoding='utf-8')}"
            response = connection.respond(http.HTTPStatus.FORBIDDEN, text)
            del response.headers["Content-Type"]  # else there were two
            response.headers["Content-Type"] = "text/html; charset=utf-8"
        else:
            try:
                response = answer(connection, request)
            except (OSError, ValueError):  # a name that no file can have
                response = connection.respond(http.HTTPStatus.NOT_FOUND, "NOT FOUND\n")
            if response is not None:
                _begin_page(response, policy.token)
            if "Upgrade" in request.headers:
                policy.tickets.clear()
        if response is not None:
            response.headers.update(SECURITY_HEADERS)
        return response

    return process_request


def _begin_page(response: Response, token: str) -> None:
    """Put ``first.html``, with the token, in place of the title of viser's page."""
    if response.headers.get("Content-Type", "").startswith("text/html"):
        is_zipped = response.headers["Content-Encoding"] == "gzip"
        response.body = _with_head(bytes(response.body), is_zipped, token)
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))


@lru_cache(maxsize=2)
def _with_head(page: bytes, is_zipped: bool, token: str) -> bytes:
    page = gzip.decompress(page) if is_zipped else page
    head = FIRST_HTML.read_bytes().replace(TOKEN_IN_HTML, token.encode(), 1)
    page = page.replace(VISERS_TITLE, head, 1)
    return gzip.compress(page) if is_zipped else page


def _listen(host: str, port: int | None) -> socket.socket:
    """Open a listening socket, as viser would silently take the next port if one is busy."""
    if port is not None and not 0 <= port <= 65535:
        raise SettingsError(f"Port {port}: wanted a number from 0 to 65535; choose another one.")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    ports = range(DEFAULT_PORT, DEFAULT_PORT + PORTS_TRIED) if port is None else [port]
    problem = 0
    for candidate in ports:
        try:
            listening = socket.create_server((host, candidate), family=family)
        except (OSError, UnicodeError) as error:
            problem = getattr(error, "errno", None) or -1
            if problem < 0 or problem == errno.EADDRNOTAVAIL:
                raise SettingsError(
                    f"Host {host!r}: not an address of this machine; wanted 127.0.0.1, or one that "
                    "is."
                ) from error
            continue
        # asyncio does not set this here; without it the end of a message waits for the page.
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return listening
    where = f"Port {port}" if port is not None else f"Ports {ports[0]} to {ports[-1]}"
    raise SettingsError(
        f"{where} of {host!r}: cannot be listened on ({os.strerror(problem)}); "
        "stop the other program, or choose another port (0 for any free one)."
    )


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a server that listens at the host."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _name_in(host: str) -> str:
    """Name in a lower-case Host header, without its port; "": there is none."""
    match = re.fullmatch(r"\[([0-9a-f:]+)\](:\d+)?|([^:@]+)(:\d+)?", host)
    return "" if match is None else match[1] or match[3]


def _query(target: str) -> dict[str, list[str]]:
    """Parameters of a path and query, as the page's script would read them."""
    return parse_qs(target.partition("?")[2], keep_blank_values=True)
