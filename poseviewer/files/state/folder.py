"""The folder in which poseviewer keeps what should outlive it; in it the last saved pose, a start
for the next photo of a series, and the tokens of addresses that other machines can reach.

An open page knows the token of the app that it came from; only where the app that is started again
at the same address has the same one, can the page come back by itself.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
import secrets
import stat
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs

from poseviewer.errors import PoseFileError, PoseViewerError, SettingsError
from poseviewer.files.writing import write_whole

if TYPE_CHECKING:  # the app's server, which asks for tokens alone, stands sooner without
    from poseviewer.files.pose import PoseRecord

VARIABLE = "POSEVIEWER_STATE"
LAST_POSE = "last.pose.json"

logger = logging.getLogger(__name__)


def state_folder() -> Path:
    """The user's own folder for poseviewer's state, made where it is missing, closed to others.

    The environment variable POSEVIEWER_STATE names another one.

    Raises:
        SettingsError: the folder cannot be made, or is another user's.
    """
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else platformdirs.user_state_path("poseviewer", appauthor=False)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat().st_uid
    except OSError as error:
        raise SettingsError(
            f"{folder}: cannot be made or looked into ({error.strerror}); poseviewer keeps its "
            f"state there, set {VARIABLE} to another folder."
        ) from error
    # Where the name is known beforehand, another user may have made the folder to read along.
    if sys.platform != "win32" and owner != os.getuid():
        raise SettingsError(
            f"{folder}: belongs to another user; poseviewer keeps its state there, set {VARIABLE} "
            "to a folder of your own."
        )
    return folder.absolute()


def keep_last_pose(record: PoseRecord, state: Path | None = None) -> None:
    """Keep a pose in the state folder (the user's own by default).

    That it was found on another photo is what it is kept for: only the photo's size stays, and no
    mask. A folder that cannot be written to is no reason to fail: the pose itself is saved.
    """
    from poseviewer.files.pose import PhotoReference, save_pose

    photo = record.photo
    size = None if photo is None else PhotoReference(width=photo.width, height=photo.height)
    try:
        folder = state_folder() if state is None else state
        kept = replace(record, photo=size, loss=None, unexplained=None, chart=None, mask=None)
        save_pose(folder / LAST_POSE, kept)
    except PoseViewerError as error:
        logger.warning("the last pose was not kept: %s", error)


def last_pose(state: Path | None = None) -> Path:
    """The file of the pose that was saved last.

    Raises:
        PoseFileError: none was saved yet.
        SettingsError: there is no state folder.
    """
    path = (state_folder() if state is None else state) / LAST_POSE
    if not path.is_file():
        raise PoseFileError(
            "No pose was saved yet, so there is no last one to start from; start from a pose file, "
            "point pairs or wheels."
        )
    return path


TOKEN_BYTES = 24
TOKEN = re.compile(rf"[A-Za-z0-9_-]{{{TOKEN_BYTES * 4 // 3}}}")
"""As ``secrets.token_urlsafe`` writes that number of bytes."""
KEPT = 20
"""Newest tokens that stay: an app at any free port leaves one at each crash."""


def new_token() -> str:
    """A random token, safe in an address and in a cookie."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def kept_token(state: Path, host: str, port: int) -> str:
    """The token that an app at ``host`` and ``port`` left in the state folder, else a new one,
    which is kept there, readable by the user alone.

    Where it cannot be kept it is still good, until the app ends; the log says so.
    """
    path = _token_path(state, host, port)
    token = _read_token(path)
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
        _token_path(state, host, port).unlink(missing_ok=True)
    except OSError as error:
        logger.warning("the address's token stays: %s", error)


def _token_path(state: Path, host: str, port: int) -> Path:
    # A host is what the user typed: it never becomes a path.
    return state / "tokens" / f"{hashlib.sha256(host.encode()).hexdigest()[:16]}-{port}"


def _read_token(path: Path) -> str | None:
    """What the file holds, if it is a token that only this user could read and write."""
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
