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
import socket
from dataclasses import dataclass
from urllib.parse import parse_qs

from websockets.datastructures import Headers

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
FOREIGN_SOURCES = frozenset(("websocket", "playbackPath"))
"""Parameters by which a link makes viser's page take its messages, scripts too, from elsewhere."""


@dataclass(frozen=True, slots=True)
class AccessPolicy:
    """Who may talk to an app that listens at ``host`` and ``port``."""

    host: str
    port: int
    token: str | None
    """None on loopback, where only programs of this machine come through."""

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

    def refusal(self, target: str, headers: Headers) -> str | None:
        """Say in one sentence why a request for a path and query is refused; None where it may
        pass.
        """
        # Without the token: a refusal is read by strangers.
        instead = f"open {self.url.partition('?')[0]} instead."
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1:
            return f"The request names {len(hosts)} hosts, wanted one; {instead}"
        host = hosts[0].lower()
        if self.token is None and host not in self._own_hosts:
            return (
                f"The request is for {hosts[0][:80]!r}, but this poseviewer serves this machine "
                f"alone; {instead}"
            )
        if origins and [o.lower() for o in origins] not in (
            [f"http://{host}"],
            [f"https://{host}"],
        ):
            return (
                f"The request comes from a page of {origins[0][:80]!r}, and only poseviewer's own "
                f"page may talk to it; {instead}"
            )
        # Read by hand: http.cookies gives up at the odd cookie of another server of this machine.
        pairs = [c.strip().partition("=") for h in headers.get_all("Cookie") for c in h.split(";")]
        tokens = [*_tokens(target), *(v for key, _, v in pairs if key == self.cookie_name)]
        if self.token is not None and not any(map(self._is_token, tokens)):
            return (
                f"The token {'is not the right one' if any(tokens) else 'is missing'}; open the "
                "whole address that poseviewer printed, with its ?token=..., in this browser."
            )
        foreign = FOREIGN_SOURCES & _query(target).keys()
        if foreign:
            return (
                f"The address asks for {min(foreign)!r}, which would hand this page to another "
                f"server; {instead}"
            )
        return None

    def cookie_to_set(self, target: str) -> str | None:
        """The Set-Cookie header for whoever came with the token in the address."""
        if not any(map(self._is_token, _tokens(target))):
            return None
        return f"{self.cookie_name}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    @property
    def _own_hosts(self) -> set[str]:
        """Host headers of the app's own page on this machine."""
        names = {*LOOPBACK_NAMES, _in_brackets(self.host).lower()}
        return {f"{name}:{self.port}" for name in names} | (names if self.port == 80 else set())

    def _is_token(self, given: str) -> bool:
        # As bytes: compare_digest takes no text beyond ASCII.
        return self.token is not None and hmac.compare_digest(given.encode(), self.token.encode())


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


def _query(target: str) -> dict[str, list[str]]:
    """The parameters behind the question mark, as the page's own script would read them."""
    return parse_qs(target.partition("?")[2], keep_blank_values=True)


def _tokens(target: str) -> list[str]:
    return _query(target).get("token", [])[:1]
