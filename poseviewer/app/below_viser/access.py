"""Who may talk to the app: answers to the Host, the Origin and the token of a request.

A page of another site may send requests to this machine, and by DNS rebinding even read the
answers (Jackson et al. 2007, "Protecting browsers from DNS rebinding attacks"). Its requests give
themselves away by their Host or their Origin. Where other machines can reach the app, whoever
comes must also know a random token, by the address that poseviewer prints or by the cookie that
this address sets.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import parse_qs

TOKEN_BYTES = 24
LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
FOREIGN_SOURCES = frozenset(("websocket", "playbackPath"))
"""Parameters by which a link makes viser's page take its messages, scripts too, from elsewhere."""


@dataclass(frozen=True, slots=True)
class PageRequest:
    """Headers of a request, each as often as it was sent."""

    target: str
    """Path and query."""
    hosts: Sequence[str]
    origins: Sequence[str] = ()
    cookies: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class AccessPolicy:
    """Who may talk to an app that listens at ``host`` and ``port``."""

    host: str
    port: int
    token: str | None
    """None on loopback, where only programs of this machine come through."""

    @classmethod
    def for_address(cls, host: str, port: int) -> AccessPolicy:
        """The policy for an address, with a fresh token unless it is a loopback one."""
        token = None if is_loopback(host) else secrets.token_urlsafe(TOKEN_BYTES)
        return cls(host, port, token)

    @property
    def url(self) -> str:
        """The address for the user's browser, with the token where one is needed."""
        # 0.0.0.0 and :: mean every address of this machine, and are none themselves.
        name = socket.gethostname() if self.host in ("", "0.0.0.0", "::") else self.host
        query = "" if self.token is None else f"?token={self.token}"
        return f"http://{_in_brackets(name)}:{self.port}/{query}"

    @property
    def cookie_name(self) -> str:
        """Browsers share cookies between the ports of a machine; the name keeps them apart."""
        return f"poseviewer_{self.port}"

    def refusal(self, asked: PageRequest) -> str | None:
        """Say in one sentence why a request is refused; None where it may pass."""
        return (
            self._wrong_host(asked)
            or self._wrong_origin(asked)
            or self._wrong_token(asked)
            or self._wrong_query(asked)
        )

    def cookie_to_set(self, asked: PageRequest) -> str | None:
        """The Set-Cookie header for whoever came with the token in the address."""
        if self.token is None or not self._is_token(_token_in(asked.target)):
            return None
        return f"{self.cookie_name}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    def _wrong_host(self, asked: PageRequest) -> str | None:
        if len(asked.hosts) != 1:
            return f"The request names {len(asked.hosts)} hosts, wanted one; open {self._plain_url}"
        name, port = _name_and_port(asked.hosts[0])
        if self.token is not None:
            return None
        ours = {*LOOPBACK_NAMES, _in_brackets(self.host).lower()}
        if name in ours and port == self.port:
            return None
        return (
            f"The request is for {asked.hosts[0][:80]!r}, but this poseviewer serves this machine "
            f"alone; open {self._plain_url}"
        )

    def _wrong_origin(self, asked: PageRequest) -> str | None:
        if not asked.origins:
            return None
        host = asked.hosts[0].lower()
        if [o.lower() for o in asked.origins] in ([f"http://{host}"], [f"https://{host}"]):
            return None
        return (
            f"The request comes from a page of {asked.origins[0][:80]!r}, and only poseviewer's "
            f"own page may talk to it; open {self._plain_url}"
        )

    def _wrong_token(self, asked: PageRequest) -> str | None:
        if self.token is None:
            return None
        given = [_token_in(asked.target), *_cookies_named(self.cookie_name, asked.cookies)]
        if any(self._is_token(token) for token in given):
            return None
        found = "is not the right one" if any(given) else "is missing"
        return (
            f"The token {found}; open the whole address that poseviewer printed, "
            "with its ?token=..., in this browser."
        )

    def _wrong_query(self, asked: PageRequest) -> str | None:
        found = FOREIGN_SOURCES & set(_query(asked.target))
        if not found:
            return None
        return (
            f"The address asks for {min(found)!r}, which would hand this page to another server; "
            f"open {self._plain_url}"
        )

    def _is_token(self, given: str | None) -> bool:
        if self.token is None or given is None:
            return False
        # As bytes: compare_digest takes no text beyond ASCII.
        return hmac.compare_digest(given.encode(), self.token.encode())

    @property
    def _plain_url(self) -> str:
        """The address without the token: a refusal is read by strangers."""
        return f"{self.url.partition('?')[0]} instead."


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine can reach a server that listens there."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _in_brackets(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _name_and_port(host: str) -> tuple[str, int | None]:
    """A Host header's name in lower case and its port; http's own where it has none."""
    name, colon, port = host.lower().rpartition(":")
    if not colon or host.endswith("]"):
        return host.lower(), 80
    return name, int(port) if port.isascii() and port.isdigit() and len(port) <= 5 else None


def _query(target: str) -> dict[str, list[str]]:
    """The parameters behind the question mark, as the page's own script would read them."""
    return parse_qs(target.partition("?")[2], keep_blank_values=True)


def _token_in(target: str) -> str | None:
    return _query(target).get("token", [None])[0]


def _cookies_named(name: str, headers: Sequence[str]) -> list[str]:
    """Read by hand: http.cookies gives up at the odd cookie of another server of this machine."""
    pairs = [pair.strip().partition("=") for header in headers for pair in header.split(";")]
    return [value for key, _, value in pairs if key == name]
