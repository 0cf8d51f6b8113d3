"""The token of an address at which other machines can reach the app, kept over a crash.

An open page knows the token of the app that it came from; only where the app that is started again
at the same address has the same one, can the page come back by itself.
"""

from __future__ import annotations

import hashlib
import logging
import re
import secrets
import stat
import sys
from pathlib import Path

from poseviewer.errors import SettingsError
from poseviewer.files.writing import write_whole

TOKEN_BYTES = 24
TOKEN = re.compile(rf"[A-Za-z0-9_-]{{{TOKEN_BYTES * 4 // 3}}}")
"""As ``secrets.token_urlsafe`` writes that number of bytes."""
KEPT = 20
"""Newest tokens that stay: an app at any free port leaves one at each crash."""

logger = logging.getLogger(__name__)


def new_token() -> str:
    """A random token, safe in an address and in a cookie."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def kept_token(state: Path, host: str, port: int) -> str:
    """The token that an app at ``host`` and ``port`` left in the state folder, else a new one,
    which is kept there, readable by the user alone.

    Where it cannot be kept it is still good, until the app ends; the log says so.
    """
    path = _path(state, host, port)
    token = _read(path)
    if token is not None:
        return token
    token = new_token()
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_whole(path, token.encode(), SettingsError, private=True)
        _remove_oldest(path.parent)
    except (OSError, SettingsError) as error:
        logger.warning("the address's token is not kept: %s", error)
    return token


def forget_token(state: Path, host: str, port: int) -> None:
    """The next app at ``host`` and ``port`` has another token."""
    try:
        _path(state, host, port).unlink(missing_ok=True)
    except OSError as error:
        logger.warning("the address's token stays: %s", error)


def _path(state: Path, host: str, port: int) -> Path:
    # A host is what the user typed: it never becomes a path.
    return state / "tokens" / f"{hashlib.sha256(host.encode()).hexdigest()[:16]}-{port}"


def _read(path: Path) -> str | None:
    """What the file holds, if it is a token that nobody else could have read or written."""
    try:
        mode = path.lstat().st_mode
        text = path.read_text(encoding="ascii") if stat.S_ISREG(mode) else ""
    except (OSError, UnicodeError):
        return None
    if sys.platform != "win32" and mode & 0o077:
        return None
    return text if TOKEN.fullmatch(text) else None


def _remove_oldest(folder: Path) -> None:
    newest = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in newest[KEPT:]:
        path.unlink(missing_ok=True)
