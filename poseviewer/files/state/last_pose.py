"""The pose that was saved last, kept as a start for the next photo of a series."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from poseviewer.errors import PoseFileError, PoseViewerError
from poseviewer.files.pose.file import PhotoReference, PoseRecord, save_pose
from poseviewer.files.state.folder import state_folder

FILE = "last.pose.json"

_log = logging.getLogger(__name__)


def keep_last_pose(record: PoseRecord, state: Path | None = None) -> None:
    """Keep a pose in the state folder (the user's own by default).

    That it was found on another photo is what it is kept for: only the photo's size stays. A
    folder that cannot be written to is no reason to fail: the pose itself is saved.
    """
    photo = record.photo
    size = None if photo is None else PhotoReference(width=photo.width, height=photo.height)
    try:
        folder = state_folder() if state is None else state
        save_pose(folder / FILE, replace(record, photo=size, loss=None, chart=None))
    except PoseViewerError as error:
        _log.warning("the last pose was not kept: %s", error)


def last_pose(state: Path | None = None) -> Path:
    """The file of the pose that was saved last.

    Raises:
        PoseFileError: none was saved yet.
        SettingsError: there is no state folder.
    """
    path = (state_folder() if state is None else state) / FILE
    if not path.is_file():
        raise PoseFileError(
            "No pose was saved yet, so there is no last one to start from; start from a pose file, "
            "point pairs or wheels."
        )
    return path
