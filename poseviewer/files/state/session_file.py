"""Sessions saved while they run, so that one that crashed can be opened again.

The frames of a sequence are in a file of their own, which only grows by those that change.
"""

import json
import logging
import secrets
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import msgspec

from poseviewer.errors import AutosaveError, PoseViewerError
from poseviewer.files import scene_json as s
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile
from poseviewer.files.writing import append, lock_file, write_whole, writing_to
from poseviewer.scene.types import Frame, Scene

FORMAT = "poseviewer-autosave"
VERSION = 2
EXPIRY_S = 30 * 24 * 3600.0
"""Age of a session, left behind, at which nobody will come back for it; its uploads may go then."""
MAX_LINES_PER_FRAME = 3
"""Lines of a file of frames, for each of them, at which it is written anew."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AutosavedSession:
    """Scene and view state of a session."""

    saved_at: float
    """Seconds since 1970."""
    active_object: str
    active_view: int
    """Index of the view that is shown large."""
    photo_names: tuple[str, ...]
    """Names of the views' photos as they are shown; empty: those of the files."""
    scene: Scene
    notes: tuple[str, ...] = ()
    """Notes on what could not be read."""

    @property
    def photo_name(self) -> str:
        """Name of the photo that is shown large."""
        at = self.active_view
        return self.photo_names[at] if self.photo_names else self.scene.views[at].name

    @property
    def model_name(self) -> str:
        """Name of the active object's model."""
        return self.scene.objects[self.scene.index(self.active_object)].model.name


class SessionFile:
    """File of this process's session; a file beside it is locked while the process lives."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / f"session-{secrets.token_hex(8)}.json"
        self._lock: IO[bytes] | None = None
        self._frames: tuple[Frame, ...] = ()  # as they are in the file
        self._lines = 0

    def save(self, session: AutosavedSession) -> None:
        """Write the session, whole or not at all, over the earlier one."""
        folder = self.path.parent
        with writing_to(folder, self.path.name, AutosaveError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _lock_path(self.path).exists():  # at first, and where the folder was removed
                self.close()
                self._lock = lock_file(_lock_path(self.path))
            self._save_frames(session.scene.frames)
        session = replace(session, scene=replace(session.scene, frames=()))
        form = s.form_of(AutosavedSession).encode(session)
        data = {"format": FORMAT, "version": VERSION, **msgspec.to_builtins(form)}
        write_whole(self.path, json.dumps(data, allow_nan=False).encode(), AutosaveError)

    def _save_frames(self, frames: tuple[Frame, ...]) -> None:
        path, encode = _frames_path(self.path), s.form_of(Frame).encode
        if not frames:
            path.unlink(missing_ok=True)
        is_same = bool(frames) and len(frames) == len(self._frames) and path.exists()
        known = self._frames if is_same else (None,) * len(frames)
        changed = [i for i, frame in enumerate(frames) if frame is not known[i]]
        if len(changed) + self._lines > MAX_LINES_PER_FRAME * len(frames) or not is_same:
            changed, is_same = range(len(frames)), False
            self._lines = 0
        data = (msgspec.to_builtins([i, encode(frames[i])], enc_hook=float) for i in changed)
        lines = "".join(f"{json.dumps(row, allow_nan=False)}\n" for row in data).encode()
        if is_same and lines:
            append(path, lines)
        elif lines:
            write_whole(path, lines, AutosaveError)
        self._frames, self._lines = frames, self._lines + len(changed)

    def close(self) -> None:
        """Leave the session behind, or nothing where none was saved."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None
            _lock_path(self.path).unlink(missing_ok=True)


def load_autosave(path: Path) -> AutosavedSession:
    """Load a session, every number to its last digit.

    Raises:
        AutosaveError: it is damaged.
    """
    file, of_session = InputFile(path, largest=MAX_DATA_BYTES), s.form_of(AutosavedSession)
    try:
        with file.naming_errors():
            data = file.load_object()
            file.require_format(data, FORMAT, VERSION)
            notes = list[str]()
            if (frames := _frames_path(path)).exists():
                file.object(data.get("scene"), "scene")["frames"] = _load_frames(frames, notes)
            form: Any = file.decode(data, of_session.kind, raw=s.FILES)
            s.require_whole(file, form.scene)
            session: AutosavedSession = of_session.decode(form)
            session.scene.index(session.active_object)
            if not 0 <= session.active_view < len(session.scene.views):
                raise file.error(f"active_view is {session.active_view}", "wanted one of the views")
            return replace(session, notes=tuple(notes))
    except PoseViewerError as error:
        reason = str(error).removeprefix(f"{path.name}: ").rstrip(".")
        found = f"the autosaved session cannot be used ({reason})"
        raise AutosaveError(f"{path.name}: {found}; it is left out.") from error


def find_abandoned(folder: Path) -> tuple[Path, AutosavedSession] | None:
    """Find the newest session in ``folder`` whose process no longer runs, and its file.

    Damaged ones are logged and left out; those of ``EXPIRY_S`` ago are removed.
    """
    sessions = []
    for path in sorted(folder.glob("session-*.json")):
        try:
            held = lock_file(_lock_path(path))
            if held is None:
                continue
            held.close()
            if time.time() - path.stat().st_mtime > EXPIRY_S:
                discard(path)
            else:
                sessions.append((path, load_autosave(path)))
        except (AutosaveError, OSError) as error:
            logger.warning("%s", error)
    return max(sessions, key=lambda session: session[1].saved_at, default=None)


def files_of_sessions(folder: Path) -> frozenset[Path]:
    """The photos and models of all sessions in ``folder``: of apps that run, and left behind."""
    paths = set[Path]()
    for path in folder.glob("session-*.json"):
        with suppress(AutosaveError):
            scene = load_autosave(path).scene
            paths |= {one.file.location for one in (*scene.views, *scene.frames)}
            paths |= {item.model.location for item in scene.objects}
    return frozenset(paths)


def discard(path: Path) -> None:
    """Remove an autosaved session; nothing happens where it is gone already."""
    try:
        for own in (path, _frames_path(path), _lock_path(path)):
            own.unlink(missing_ok=True)
    except OSError as error:
        found = f"cannot be removed from {path.parent} ({error.strerror})"
        raise AutosaveError(f"{path.name}: {found}; remove it by hand.") from error


def _load_frames(path: Path, notes: list[str]) -> list[Any]:
    """Load the last line of each frame; one that was broken off is left out, with a note."""
    frames, broken = dict[int, Any](), 0
    for line in InputFile(path, largest=MAX_DATA_BYTES).load_bytes().splitlines():
        try:
            index, frame = json.loads(line)
            frames[int(index)] = frame
        except (ValueError, TypeError):
            broken += 1
    if broken:
        found = f"Changes of frames that were cut off as they were saved, left out: {broken:,}"
        notes.append(f"{found}; these frames have the poses from before.")
    if sorted(frames) != list(range(len(frames))):
        raise ValueError("frames are missing")
    return [frames[index] for index in sorted(frames)]


def _frames_path(path: Path) -> Path:
    return path.with_suffix(".frames")


def _lock_path(path: Path) -> Path:
    return path.with_suffix(".lock")
