"""The guard of the web app, asked over real sockets as a browser would, or a stranger."""

import gzip
import http.client
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from urllib.request import Request, urlopen

import msgspec.msgpack
import pytest
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from poseviewer.app.below_viser import guard
from poseviewer.app.below_viser.guard import (
    FOREIGN_SOURCES,
    MAX_MESSAGE_BYTES,
    MAX_SILENT,
    GuardedServer,
    serve,
)
from poseviewer.errors import SettingsError
from tests.app.below_viser.socket_page import PROTOCOL

Headers = dict[str, str]


@contextmanager
def no_thread_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    for thread in set(threading.enumerate()) - before:
        thread.join(10)
        assert not thread.is_alive()


@contextmanager
def running(host: str, port: int | None = 0) -> Iterator[GuardedServer]:
    with no_thread_left():
        guarded = serve(host, port)
        try:
            yield guarded
        finally:
            guarded.stop()


@pytest.fixture(scope="module")
def local() -> Iterator[GuardedServer]:
    with running("127.0.0.1") as guarded:
        yield guarded


@pytest.fixture(scope="module")
def wide() -> Iterator[GuardedServer]:
    with running("0.0.0.0") as guarded:
        yield guarded


def get(guarded: GuardedServer, path: str | None = None, **headers) -> tuple[int, str, Headers]:
    """Status, text and headers of the answer to a GET with these headers; path None: with token."""
    path = f"/?token={guarded.policy.token}" if path is None else path
    connection = http.client.HTTPConnection("127.0.0.1", guarded.policy.port, timeout=20)
    try:
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        response = connection.getresponse()
        text = response.read().decode("utf-8", "replace")
        return response.status, text, dict(response.getheaders())
    finally:
        connection.close()


def websocket(guarded: GuardedServer, path: str | None = None, **headers: str) -> int:
    """101 where a websocket with these headers is accepted, else the status of the refusal."""
    asked = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    asked |= {"Sec-WebSocket-Key": 22 * "A" + "==", "Sec-WebSocket-Protocol": PROTOCOL}
    return get(guarded, path, **asked, **headers)[0]


def test_own_page_passes_by_every_name_of_this_machine_and_through_a_tunnel(local):
    port, token = local.policy.port, local.policy.token
    assert local.url == f"http://127.0.0.1:{port}/?token={token}"
    for name in ("127.0.0.1", "LOCALHOST", "[::1]"):
        for host in (name, f"{name}:{port}", f"{name}:9000"):
            status, text, answered = get(local, Host=host, Origin=f"http://{host}")
            assert (status, "<html" in text.lower()) == (200, True)
            assert guard.SECURITY_HEADERS.items() <= answered.items()
            assert websocket(local, Host=host, Origin=f"https://{host}") == 101
    assert get(local, f"/?darkMode&token={token}")[0] == 200
    assert websocket(local) == 101


REFUSED = {
    "The request comes from a page of": [
        {"Origin": "http://evil.example:{port}"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "http://127.0.0.1:{port}.evil.example"},
        {"Origin": "ftp://127.0.0.1:{port}"},
        {"Origin": "null"},
    ],
    # After DNS rebinding a page's own name leads here: its Origin then fits its Host.
    "The request is for": [
        {"Host": "evil.example:{port}", "Origin": "http://evil.example:{port}"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1.evil.example:{port}"},
        {"Host": "127.0.0.1:{port}@evil.example"},
        {"Host": "192.168.0.7:{port}"},
        {"Host": "127.0.0.1:x"},
        {"Host": "[::1"},
        {"Host": ""},
    ],
}


@pytest.mark.parametrize(
    ("said", "headers"), [(said, headers) for said, all_ in REFUSED.items() for headers in all_]
)
def test_foreign_pages_and_names_are_refused(local, said, headers):
    headers = {name: value.format(port=local.policy.port) for name, value in headers.items()}
    status, text, answered = get(local, **headers)
    assert status == 403
    assert text.startswith(said)
    assert text.count("\n") == 1
    assert answered["Content-Type"] == "text/plain; charset=utf-8"
    assert guard.SECURITY_HEADERS.items() <= answered.items()
    assert websocket(local, **headers) == 403


@pytest.mark.parametrize(
    "request_lines",
    [
        "/ HTTP/1.1",
        "/ HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nHost: evil.example",
        "/?token=é HTTP/1.1\r\nHost: localhost",
    ],
    ids=["no host", "two hosts", "a token that is no ASCII"],
)
def test_what_no_browser_asks_is_refused(local, request_lines):
    port = local.policy.port
    with socket.create_connection(("127.0.0.1", port), 20) as plain:
        plain.sendall(f"GET {request_lines.format(port=port)}\r\n\r\n".encode("latin-1"))
        assert plain.recv(100).startswith(b"HTTP/1.1 403 ")


ELSEWHERE = "which would hand this page to another server"


@pytest.mark.parametrize(
    ("path", "said"),
    [
        *((f"/?token={{}}&{name}=ws://evil.example", ELSEWHERE) for name in FOREIGN_SOURCES),
        ("/?token={}&web%73ocket=ws://evil.example", ELSEWHERE),
        ("/?token={}&a=1&websocket=ws://evil.example", ELSEWHERE),
        ("/" + "a" * 5000 + "?token={}", "The address has 5,0"),
        ("/?token=" + "a" * 5000, "The address has 5,0"),
    ],
)
def test_paths_that_lead_elsewhere_or_are_too_long_are_refused(local, path, said):
    status, text, _ = get(local, path.format(local.policy.token))
    assert status == 403
    assert said in text


TOKENS = (
    ("/", 403),
    ("/?token=", 403),
    ("/?token=%C3%A4", 403),
    ("/?token={token}x", 403),
    ("/?token=wrong&token={token}", 403),
    ("/?token={token}", 200),
    ("/index.html?darkMode&token={token}", 200),
)


@pytest.mark.parametrize("served", ["local", "wide"])
@pytest.mark.parametrize(("path", "status"), TOKENS)
def test_everyone_needs_the_token(request, served, path, status):
    guarded: GuardedServer = request.getfixturevalue(served)
    token = guarded.policy.token
    assert guarded.url.endswith(f":{guarded.policy.port}/?token={token}")
    path, cookies = path.format(token=token), {"Cookie": f"poseviewer={token}; token={token}"}
    for headers in ({}, cookies):
        found, text, answered = get(guarded, path, **headers)
        assert found == status
        assert websocket(guarded, path, **headers) == (101 if status == 200 else 403)
        assert "Set-Cookie" not in answered
        assert answered["Cache-Control"] == "no-store"
        assert answered["Content-Type"].startswith("text/html")
        assert (token in text) == (status == 200)
        if status == 403:
            assert text.startswith("The token is")


def test_the_token_is_new_in_each_run_and_no_text_about_the_server_has_it(local, wide):
    assert len({local.policy.token, wide.policy.token}) == 2
    assert len(local.policy.token) > 40
    assert local.policy.token not in repr(local)


def test_the_page_of_another_name_talks_to_its_own_server_alone(wide: GuardedServer) -> None:
    host = f"my-machine.example:{wide.policy.port}"
    assert get(wide, Host=host)[0] == 200
    assert websocket(wide, Host=host, Origin=f"http://{host}") == 101
    assert websocket(wide, Host=host, Origin="http://evil.example") == 403


def test_the_address_that_a_browser_is_started_with_is_good_until_its_page_is_there() -> None:
    with running("127.0.0.1") as guarded:
        path = "/" + guarded.url_to_hand_on().rpartition("/")[2]
        assert guarded.policy.token not in path
        assert websocket(guarded, "/") == 403  # a stranger's leaves it as it is
        assert guarded.policy.token in get(guarded, path)[1]  # for the websocket, and later tabs
        assert websocket(guarded) == 101
        assert get(guarded, path)[0] == 403
        assert get(guarded)[0] == 200  # the page may be loaded anew


@pytest.mark.parametrize("coding", ["identity", "gzip"])
def test_the_page_says_what_it_is_before_viser_is_there(local: GuardedServer, coding: str) -> None:
    with urlopen(Request(local.url, headers={"Accept-Encoding": coding})) as answer:
        page = answer.read()
    assert answer.headers["Content-Length"] == str(len(page))
    text = (gzip.decompress(page) if coding == "gzip" else page).decode()
    assert text.count("<title>poseviewer</title>") == 1
    assert "poseviewer finds where a known 3D model stands in a photo." in text
    assert "<title>Viser</title>" not in text


def test_a_page_cannot_open_a_public_tunnel(local: GuardedServer) -> None:
    handled = {kind.__name__ for kind in local.server._websock_server._incoming_handlers}
    assert "ShareUrlRequest" not in handled
    assert "GuiUpdateMessage" in handled


def test_a_viser_that_comes_past_the_guard_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poseviewer.app.below_viser.guard.VISERS_MODULE", "another.module")
    with no_thread_left(), pytest.raises(RuntimeError, match=r"unguarded; install viser 1\.1\.1"):
        serve("127.0.0.1", 0)


def test_a_busy_port_is_an_error_if_named_and_else_the_next_free_one_is_taken(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        text = rf"^Port {port} of '127.0.0.1': cannot be listened on \(Address already in use\);"
        with pytest.raises(SettingsError, match=text):
            serve("127.0.0.1", port)
        monkeypatch.setattr("poseviewer.app.below_viser.guard.DEFAULT_PORT", port)
        with running("127.0.0.1", None) as guarded:
            assert port < guarded.policy.port < port + 100
            assert get(guarded)[0] == 200


@pytest.mark.parametrize(
    ("host", "port", "text"),
    [
        ("no such host", 0, "Host 'no such host': not an address of this machine"),
        ("203.0.113.7", None, "Host '203.0.113.7': not an address of this machine; wanted 127"),
        ("::1", 70000, "Port 70000: wanted a number from 0 to 65535"),
    ],
)
def test_addresses_that_cannot_be_are_settings_errors(host, port, text):
    with pytest.raises(SettingsError, match=f"^{text}"):
        serve(host, port)


def test_nothing_is_printed_and_the_port_is_given_back(capfd: pytest.CaptureFixture[str]) -> None:
    with running("localhost") as guarded:
        port = guarded.policy.port
        with socket.create_connection(("127.0.0.1", port), 20):
            pass  # a connection that says nothing
        assert get(guarded)[0] == 200
    assert capfd.readouterr() == ("", "")
    if sys.platform != "win32":
        with socket.create_server(("127.0.0.1", port)):
            pass


@pytest.mark.parametrize("path", ["/" + "a" * 300, "/a%00b", "/no/such"])
def test_a_path_that_is_no_file_is_not_found(local, path):
    assert get(local, f"{path}?token={local.policy.token}")[0] == 404


def test_of_connections_that_say_nothing_the_oldest_are_closed(local):
    with ExitStack() as stack:
        address = ("127.0.0.1", local.policy.port)
        opened = [
            stack.enter_context(socket.create_connection(address, 5)) for _ in range(MAX_SILENT + 3)
        ]
        for oldest in opened[:3]:
            with suppress(ConnectionResetError):
                assert oldest.recv(1) == b""
        assert get(local)[0] == 200
        for newest in opened[-2:]:
            newest.settimeout(0.0)
            with pytest.raises(BlockingIOError):
                newest.recv(1)


def test_messages_are_sent_at_once() -> None:
    # With Nagle's algorithm the second half of a message waits for the page's next one.
    with (
        guard._listen("127.0.0.1", 0) as listening,
        socket.create_connection(listening.getsockname()),
        listening.accept()[0] as accepted,
    ):
        assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def read_all(page: Connection) -> None:
    """Read what the server still sends, until it ends."""
    while True:
        page.recv(20.0)


ODD_ID = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": ["a"], "updates": {}})


@pytest.mark.parametrize(
    "garbage",
    [b"", b"\x91" * 5000, b"\x81\xa4type\xa4Nope", "a text", ODD_ID, bytes(MAX_MESSAGE_BYTES + 1)],
    ids=["empty", "deep", "unknown", "text", "list as id", "large"],
)
def test_what_is_no_message_ends_its_page_alone_with_a_line_in_the_log(local, garbage, caplog):
    is_large, url = len(garbage) > MAX_MESSAGE_BYTES, local.url.replace("http", "ws")
    with connect(url, subprotocols=[PROTOCOL], max_size=None) as page:
        with suppress(ConnectionClosedError):
            page.send(garbage)
        with pytest.raises(ConnectionClosedError, match="too big" if is_large else None):
            read_all(page)
    assert websocket(local) == 101  # others are served
    assert all(record.exc_info is None for record in caplog.records)
    said = [text for text in caplog.messages if "no message" in text]
    assert len(said) == (0 if is_large else 1)
    assert all(text.isprintable() and len(text) < 200 for text in said)
