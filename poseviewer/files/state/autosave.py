"""Sessions saved while they run, so that one that crashed can be opened again."""

from __future__ import annotations

import base64
import json
import logging
import secrets
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np

from poseviewer.errors import AutosaveError, PoseFileError
from poseviewer.files.checks import Reading, kind_of
from poseviewer.files.masks import mask_as_png, mask_from_png
from poseviewer.files.pose import PoseRecord, record_as_json, record_from_json
from poseviewer.files.view_set import SetChoice
from poseviewer.files.writing import lock_file, write_whole
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.transform import RigidTransform

FORMAT, VERSION = "poseviewer-autosave", 1
LARGEST_FILE = 500_000_000
"""Bytes: it may hold a mask of 100 megapixels, in shades of grey."""
EXACT_TOLERANCE = 1e-6
"""By how much the exact numbers may differ from the pose file's, which are rounded."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class KeptSet:
    """The set of photos that a session has open."""

    path: Path
    choice: SetChoice
    scale: float
    """At the pose."""
    start_scale: float
    """At the start pose."""
    free_size: bool
    left_out: tuple[str, ...]
    """Names of the photos that are not compared."""
    masks: Mapping[str, Mask]
    """What counts, by the photos' names."""


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
    pose: PoseRecord
    start: PoseRecord
    """Where the fit started."""
    settings: Mapping[str, Any]
    """What JSON can hold."""
    saved_at: float
    """Seconds since 1970."""
    mask: Mask | None = None
    """What of the photo counts."""
    number: int = 1
    """Of the object that is picked, among those of the photo."""
    name: str = ""
    """What the user calls it."""
    hidden: bool = False
    locked: bool = False
    others: tuple[AutosavedSession, ...] = ()
    """The photo's other objects, each as if it were picked."""
    views: KeptSet | None = None
    """Where the photo is one of a set."""


class SessionFile:
    """The file of this process's session in a folder.

    Beside it lies a file that is locked as long as the process lives: so others can tell whether
    the session was left behind.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / f"session-{secrets.token_hex(8)}.json"
        self._lock: IO[bytes] | None = None

    def save(self, session: AutosavedSession) -> None:
        """Write the session, whole or not at all, over the earlier one.

        Raises:
            AutosaveError: the folder cannot be written to.
        """
        folder = self.path.parent
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _lock_path(self.path).exists():  # at first, and where the folder was removed
                self.close()
                self._lock = lock_file(_lock_path(self.path))
        except OSError as error:
            raise AutosaveError(
                f"{self.path.name}: cannot be written to {folder} ({error.strerror}); check that "
                "the folder is yours to write to."
            ) from error
        text = json.dumps(session, default=_as_json, indent=1, allow_nan=False)
        write_whole(self.path, text.encode(), AutosaveError)

    def close(self) -> None:
        """Leave the session behind, or nothing where none was saved."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None
            _lock_path(self.path).unlink(missing_ok=True)


def load_autosave(path: Path) -> AutosavedSession:
    """The session in a file, every number to its last digit.

    Raises:
        AutosaveError: there is no such file, or it is damaged.
    """
    reading = Reading(path, largest=LARGEST_FILE)
    try:
        with reading.naming_errors():
            return _from_json(reading, reading.load_object())
    except PoseFileError as error:
        found = str(error).removeprefix(f"{path.name}: ").rstrip(".")
        raise AutosaveError(
            f"{path.name}: the autosaved session cannot be used ({found}); it is left out."
        ) from error


def left_behind(folder: Path) -> tuple[Path, AutosavedSession] | None:
    """The newest session in ``folder`` whose process no longer runs, and its file.

    Damaged ones are left out, with a line in the log.
    """
    newest = None
    for path in sorted(folder.glob("session-*.json")):
        try:
            lock = _lock_path(path)
            held = lock_file(lock) if lock.exists() else BytesIO()  # version 0.1.0 made none
            if held is None:
                continue
            held.close()
            session = load_autosave(path)
        except (AutosaveError, OSError) as error:
            logger.warning("%s", error)
            continue
        if newest is None or session.saved_at > newest[1].saved_at:
            newest = path, session
    return newest


def files_of_sessions(folder: Path) -> frozenset[Path]:
    """The photos and models of all sessions in ``folder``: of apps that run, and left behind."""
    found = set[Path | None]()
    for path in folder.glob("session-*.json"):
        with suppress(AutosaveError):
            session = load_autosave(path)
            found |= {f for one in (session, *session.others) for f in (one.photo, one.model)}
    return frozenset(path for path in found if path is not None)


def discard(path: Path) -> None:
    """Remove an autosaved session; nothing happens where it is gone already.

    Raises:
        AutosaveError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
        _lock_path(path).unlink(missing_ok=True)
    except OSError as error:
        raise AutosaveError(
            f"{path.name}: cannot be removed from {path.parent} ({error.strerror}); remove it "
            "by hand."
        ) from error


def _lock_path(path: Path) -> Path:
    return path.with_suffix(".lock")


def _as_json(value: Any) -> Any:
    """Simpler content for what ``json`` cannot write."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mask):
        return base64.b64encode(mask_as_png(value)).decode()
    if isinstance(value, PoseRecord):
        return _pose_as_json(value)
    if isinstance(value, Mapping):
        return dict(value)
    named = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, KeptSet):
        return named | _as_json(named.pop("choice"))
    if isinstance(value, AutosavedSession):
        return {"format": FORMAT, "version": VERSION, **named}
    return named


def _from_json(reading: Reading, data: dict[str, Any]) -> AutosavedSession:
    if (data.get("format"), data.get("version")) != (FORMAT, VERSION):
        raise reading.error("it has another format", f"wanted {FORMAT} {VERSION}")
    return AutosavedSession(*reading.fields(data, "", **_CHECKS))


def _path(reading: Reading, value: Any, what: str) -> Path | None:
    """A path may hold bytes that are no text, and is kept as it is."""
    reading.text(value, what)
    return None if value is None else Path(value)


def _name(reading: Reading, value: Any, what: str) -> str:
    return reading.text(value, what) or ""


def _mask(reading: Reading, value: Any, what: str) -> Mask | None:
    text = reading.text(value, what)
    if text is None:
        return None
    try:
        return mask_from_png(base64.b64decode(text, validate=True))
    except (ValueError, cv2.error) as error:
        raise reading.error(f"{what} is no picture ({error})", "wanted a PNG in base64") from None


def _whole(reading: Reading, value: Any, what: str) -> int:
    return int(reading.number(value, what))


def _others(reading: Reading, value: Any, what: str) -> tuple[AutosavedSession, ...]:
    if not isinstance(value, list):
        raise reading.error(f"{what} is {kind_of(value)}", "wanted a list of objects")
    return tuple(_from_json(reading, reading.object(one, what)) for one in value)


def _views(reading: Reading, value: Any, what: str) -> KeptSet | None:
    if value is None:
        return None
    path, photos, folder, rig_object, scale, start_scale, free_size, left_out, masks = (
        reading.fields(value, what, path=_path, photos=Reading.texts, folder=_path,
        rig_object=Reading.size, scale=Reading.positive, start_scale=Reading.positive,
        free_size=_truth, left_out=Reading.texts, masks=Reading.object)
    )  # fmt: skip
    if path is None:
        raise reading.error(f"{what}.path is missing", "wanted a file or a folder")
    read = {name: _mask(reading, text, f"{what}.masks") for name, text in masks.items()}
    known = {name: mask for name, mask in read.items() if mask is not None}
    choice = SetChoice(photos, folder, rig_object)
    return KeptSet(path, choice, scale, start_scale, free_size, left_out, known)


def _truth(reading: Reading, value: Any, what: str) -> bool:
    if not isinstance(value, bool):
        raise reading.error(f"{what} is {kind_of(value)}", "wanted true or false")
    return value


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
    width, height, cx, cy, rotation = reading.fields(
        value.get("exact"), f"{what}.exact", width=Reading.size, height=Reading.size,
        cx=Reading.number, cy=Reading.number, rotation=Reading.matrix,
    )  # fmt: skip
    if width is None or height is None:
        raise reading.error(f"{what} has no size", "wanted width and height")
    record = record_from_json(reading, value.get("file"), width, height)
    camera, transform = record.pose.camera, record.pose.camera_from_model
    rounded = np.array([camera.cx, camera.cy, *transform.rotation.ravel()])
    if not np.allclose(
        rounded, [cx, cy, *rotation.ravel()], rtol=EXACT_TOLERANCE, atol=EXACT_TOLERANCE
    ):
        raise reading.error(f"{what} says two different poses", "wanted one pose")
    pose = Pose(replace(camera, cx=cx, cy=cy), RigidTransform(rotation, transform.translation))
    return replace(record, pose=pose)


_CHECKS = {
    "photo": _path,
    "photo_name": _name,
    "photo_sha256": Reading.text,
    "model": _path,
    "model_name": _name,
    "pose": _pose_from_json,
    "start": _pose_from_json,
    "settings": Reading.object,
    "saved_at": Reading.number,
    "mask": _mask,
    "number": _whole,
    "name": _name,
    "hidden": _truth,
    "locked": _truth,
    "others": _others,
    "views": _views,
}
"""Of the session's fields, in their order."""
