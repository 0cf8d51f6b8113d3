"""The folder in which poseviewer keeps what should outlive it: uploads, sessions, its token."""

import os
import re
import secrets
import sys
from contextlib import suppress
from pathlib import Path

import platformdirs

from poseviewer.errors import SettingsError

VARIABLE = "POSEVIEWER_STATE"
KEPT = f"poseviewer keeps its state there, set {VARIABLE} to"


def state_folder() -> Path:
    """The user's own folder of state, or POSEVIEWER_STATE, made where it is missing."""
    named = os.environ.get(VARIABLE)
    folder = Path(named) if named else platformdirs.user_state_path("poseviewer", appauthor=False)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner = folder.stat().st_uid
    except OSError as error:
        found = f"cannot be made or looked into ({error.strerror})"
        raise SettingsError(f"{folder}: {found}; {KEPT} another folder.") from error
    # Where the name is known beforehand, another user may have made the folder to read along.
    if sys.platform != "win32" and owner != os.getuid():
        raise SettingsError(f"{folder}: belongs to another user; {KEPT} a folder of your own.")
    return folder.absolute()


def load_token(folder: Path) -> str:
    """Load the token of the user's apps from a private file, or return a fresh one."""
    fresh, path = secrets.token_urlsafe(), folder / "token"
    with suppress(OSError, ValueError):
        with suppress(FileExistsError):
            path.touch(0o600, exist_ok=False)
            path.write_text(fresh, "ascii")
        kept = path.read_text("ascii")
        return kept if re.fullmatch(r"[\w-]{32,}", kept) else fresh
    return fresh
