"""Sessions kept while they run, so that one that ended without a word can be taken up again."""

from __future__ import annotations

import hashlib
import json
import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from poseviewer.errors import AutosaveError, PoseFileError
from poseviewer.files.checks import Reading, read_json
from poseviewer.files.pose.file import PoseRecord, record_as_json, record_from_json
from poseviewer.files.state.process_mark import process_start
from poseviewer.files.writing import write_whole
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform

FORMAT, VERSION = "poseviewer-autosave", 1
FILE_NAME = re.compile(r"session-([0-9]{1,10})-([0-9a-f]{16})\.json")
EXACT_TOLERANCE = 1e-6
"""By how much the exact numbers may differ from the pose file's, which are rounded."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class AutosavedSession:
    """What the user has open."""

    photo: Path | None
    """Where the photo lies."""
    photo_name: str
    """As it is shown."""
    photo_sha256: str | None
    model: Path | None
    model_name: str
    model_sha256: str | None
    pose: PoseRecord
    start: PoseRecord
    """Where the fit started."""
    settings: Mapping[str, Any]
    """What JSON can hold."""
    unsaved: bool
    """Whether there is something in it that the user has not saved."""
    saved_at: float
    """Seconds since 1970."""
    process: int
    """The process that runs the session."""


def save_autosave(folder: Path, session: AutosavedSession) -> Path:
    """Write a session into ``folder``, whole or not at all, over its process's earlier one.

    Raises:
        AutosaveError: the folder cannot be written to, or the session holds what JSON cannot.
    """
    path = folder / _file_name(session.process)
    try:
        text = json.dumps(_as_json(session), indent=1, allow_nan=False)
    except (ValueError, TypeError) as error:
        raise AutosaveError(
            f"{path.name}: the session holds what JSON cannot ({error}); it was not kept."
        ) from error
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise AutosaveError(
            f"{path.name}: cannot be written to {folder} ({error.strerror}); check that the "
            "folder is yours to write to."
        ) from error
    write_whole(path, text.encode(), AutosaveError)
    return path


def load_autosave(path: Path) -> AutosavedSession:
    """The session in a file, every number to its last digit.

    Raises:
        AutosaveError: there is no such file, or it is damaged.
    """
    reading = Reading(path.name, [])
    try:
        return _from_json(reading, reading.object(read_json(path), "its content"))
    except PoseFileError as error:
        found = str(error).removeprefix(f"{path.name}: ").rstrip(".")
        raise AutosaveError(
            f"{path.name}: the autosaved session cannot be used ({found}); it is left out."
        ) from error


def left_behind(folder: Path) -> list[Path]:
    """The sessions in ``folder`` whose processes no longer run, the newest first.

    Damaged ones are left out, with a line in the log.
    """
    found: list[tuple[float, Path]] = []
    for path in sorted(folder.glob("session-*.json")):
        match = FILE_NAME.fullmatch(path.name)
        if match is None or match[2] == _mark(process_start(int(match[1]))):
            continue
        try:
            found.append((load_autosave(path).saved_at, path))
        except AutosaveError as error:
            logger.warning("%s", error)
    return [path for _, path in sorted(found, reverse=True)]


def discard(path: Path) -> None:
    """Remove an autosaved session; nothing happens where it is gone already.

    Raises:
        AutosaveError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise AutosaveError(
            f"{path.name}: cannot be removed from {path.parent} ({error.strerror}); remove it "
            "by hand."
        ) from error


def _mark(start: str | None) -> str | None:
    return None if start is None else hashlib.sha256(start.encode()).hexdigest()[:16]


def _file_name(process: int) -> str:
    """One for each process, also where its number was another's before."""
    return f"session-{process}-{_mark(process_start(process)) or '0' * 16}.json"


def _as_json(session: AutosavedSession) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "photo": None if session.photo is None else str(session.photo),
        "photo_name": session.photo_name,
        "photo_sha256": session.photo_sha256,
        "model": None if session.model is None else str(session.model),
        "model_name": session.model_name,
        "model_sha256": session.model_sha256,
        "pose": _pose_as_json(session.pose),
        "start": _pose_as_json(session.start),
        "settings": dict(session.settings),
        "unsaved": session.unsaved,
        "saved_at": session.saved_at,
        "process": session.process,
    }


def _from_json(reading: Reading, data: dict[str, Any]) -> AutosavedSession:
    if (data.get("format"), data.get("version")) != (FORMAT, VERSION):
        raise reading.error("it has another format", f"wanted {FORMAT} {VERSION}")
    photo, model = (reading.text(data.get(key), key) for key in ("photo", "model"))
    if not isinstance(data.get("unsaved"), bool):
        raise reading.error("unsaved is missing", "wanted true or false")
    return AutosavedSession(
        photo=None if photo is None else Path(photo),
        photo_name=reading.text(data.get("photo_name"), "photo_name") or "",
        photo_sha256=reading.text(data.get("photo_sha256"), "photo_sha256"),
        model=None if model is None else Path(model),
        model_name=reading.text(data.get("model_name"), "model_name") or "",
        model_sha256=reading.text(data.get("model_sha256"), "model_sha256"),
        pose=_pose_from_json(reading, data.get("pose"), "pose"),
        start=_pose_from_json(reading, data.get("start"), "start"),
        settings=reading.object(data.get("settings"), "settings"),
        unsaved=data["unsaved"],
        saved_at=reading.number(data.get("saved_at"), "saved_at"),
        process=int(reading.number(data.get("process"), "process")),
    )


def _pose_as_json(record: PoseRecord) -> dict[str, Any]:
    """A pose file's content, and beside it the numbers that a pose file rounds.

    A pose file counts pixels from another place, and reading it mends rotations.
    """
    camera, rotation = record.pose.camera, record.pose.camera_from_model.rotation
    exact = {
        "width": camera.width,
        "height": camera.height,
        "cx": float(camera.cx),
        "cy": float(camera.cy),
        "rotation": rotation.tolist(),
    }
    return {"file": record_as_json(record), "exact": exact}


def _pose_from_json(reading: Reading, value: Any, what: str) -> PoseRecord:
    value = reading.object(value, what)
    exact = reading.object(value.get("exact"), f"{what}.exact")
    width, height = (reading.size(exact.get(key), key) for key in ("width", "height"))
    if width is None or height is None:
        raise reading.error(f"{what} has no size", "wanted width and height")
    record = record_from_json(reading, value.get("file"), width, height)
    rows = exact.get("rotation")
    if not isinstance(rows, list) or len(rows) != 3:
        raise reading.error(f"{what}.exact.rotation is odd", "wanted 3 rows of 3 numbers")
    rotation = np.array([reading.numbers(row, "exact.rotation", 3) for row in rows])
    cx, cy = (reading.number(exact.get(key), f"exact.{key}") for key in ("cx", "cy"))
    camera, transform = record.pose.camera, record.pose.camera_from_model
    rounded = np.array([camera.cx, camera.cy, *transform.rotation.ravel()])
    if not np.allclose(
        rounded, [cx, cy, *rotation.ravel()], rtol=EXACT_TOLERANCE, atol=EXACT_TOLERANCE
    ):
        raise reading.error(f"{what} says two different poses", "wanted one pose")
    pose = Pose(replace(camera, cx=cx, cy=cy), RigidTransform(rotation, transform.translation))
    return replace(record, pose=pose)
