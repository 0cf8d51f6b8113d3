"""The folder in which poseviewer keeps what should outlive it; in it the last saved pose, a start
for the next photo of a series.
"""

from __future__ import annotations

import logging
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import platformdirs

from poseviewer.errors import PoseFileError, PoseViewerError, SettingsError

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
