"""The folder in which poseviewer keeps what should outlive it: uploads and sessions."""

import os
import sys
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
