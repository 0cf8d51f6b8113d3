"""Save poses beside their photos, and autosave the session."""

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Literal, TypeVar

from poseviewer.app.state.document import Document, is_alone
from poseviewer.app.state.edits import Edit, report_error
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import pose_file_view, scene_to_save, stem_of
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError
from poseviewer.files.demo import PLACES
from poseviewer.files.keypoints import is_equal, keypoints_path, load_keypoints, save_keypoints
from poseviewer.files.masks import mask_paths, save_pose_and_masks
from poseviewer.files.scene_json import as_saved, pose_json, save_scene
from poseviewer.files.state.session_file import (
    AutosavedSession,
    SessionFile,
    discard,
    find_abandoned,
)
from poseviewer.opening.uploads import copy_out
from poseviewer.scene.assets import ModelFile, PhotoFile

PERIOD_S = 0.5
"""Period of autosaves during motion: a crash loses less than a second."""
RETRY_S = 10.0
"""Wait after a failed write, such as on a full disk."""

Asset = TypeVar("Asset", PhotoFile, ModelFile)
Kept = Document | Literal["nothing"]
"""Contents of the autosave."""


class Autosaver:
    """Saves and autosaves the session, and offers the autosave of an earlier run. One thread alone
    writes the autosave, each time whole or not at all.
    """

    def __init__(self, state: Path) -> None:
        self._state = state.resolve()
        self._written: dict[Path, tuple[object, ...]] = {}  # this session's files as it left them
        self._chosen: dict[Path, Path] = {}  # paths in place of the usual ones
        self._offered, self.offer = find_abandoned(state / "sessions") or (None, None)
        """Session that an earlier run left unsaved, until it is taken or refused."""
        self._is_adopted = False  # whether the offer has been opened
        self._file = SessionFile(state / "sessions")
        self._kept: Kept = "nothing"
        self.job = Worker(
            "autosave",
            self._to_keep,
            self._keeping,
            period_s=lambda now: PERIOD_S if now.is_moving or now.is_propagating else 0,
        )
        """Autosaves the session after every change; a failure is reported once."""

    def take_offer(self, wanted: bool) -> AutosavedSession | None:
        """Take the offer; if ``wanted``, its file stays until it has been opened."""
        offer, self.offer = self.offer, None
        if not wanted:
            self._discard_offered()
        return offer

    def close(self, session: Session) -> None:
        """End cleanly: the autosave stays only if the session is unsaved."""
        self.job.close()
        with suppress(PoseViewerError):
            self._keep(self._to_keep(session))
        self._file.close()

    def _keeping(self, wanted: Kept) -> Iterator[Edit]:
        for attempt in count():
            try:
                return self._keep(wanted)
            except PoseViewerError as error:
                if not attempt:
                    yield report_error(f"{error} Until then a crash would lose what is not saved.")
            self.job.require_current(wanted, RETRY_S)

    def _keep(self, wanted: Kept) -> None:
        if wanted == self._kept:
            return
        if isinstance(wanted, Document):
            self._file.save(make_autosave(wanted))
            if self._is_adopted:
                self._discard_offered()
        else:
            self._file.close()
            discard(self._file.path)
        self._kept = wanted

    def where(self, session: Session) -> str:
        """Name of the file to which the session would be saved."""
        return self._path(session.document).name

    def file_to_replace(self, document: Document) -> Path | None:
        """File of another session that saving would replace."""
        path = self._path(document)
        is_own = self._written.get(path) == _fingerprint(path, document)
        return None if is_own or not any(_times_on_disk(path)) else path

    def save(self, session: Session, beside: bool = False) -> tuple[Path, ...]:
        """Write the pose file with its masks, or else the scene with copies of uploads. A file that
        is replaced becomes a ``.bak`` file; ``beside`` takes a free name instead. Returns this
        file and the files of key points that were written.

        Raises:
            PoseViewerError: the folder cannot be written to, or photo or models are no files.
        """
        document, scene = session.document, scene_to_save(session)
        path, replaced = self._path(document), list[Path]()
        if beside:
            usual = self._usual_path(document)
            path = self._chosen[usual] = _next_free(usual)
        elif self.file_to_replace(document):
            replaced = [file for file in (path, *mask_paths(path)) if file.exists()]
        for file in replaced:
            file.replace(file.with_suffix(f"{file.suffix}.bak"))
        try:
            if is_alone(document):
                masks = scene.mask(0), scene.occluders(0)
                save_pose_and_masks(path, pose_json(as_saved(scene)), *masks)
            else:
                save_scene(path, copy_out(path, as_saved(scene), self._state / "uploads"))
        except PoseViewerError:
            for file in replaced:
                file.with_suffix(f"{file.suffix}.bak").replace(file)
            raise
        self._written[path] = _fingerprint(path, document)
        written = list[Path]()
        for item in scene.objects:
            if keypoints_path(item.model.location) not in written and _save_keypoints(item.model):
                written.append(keypoints_path(item.model.location))
        return (path, *written)

    def _path(self, document: Document) -> Path:
        usual = self._usual_path(document)
        return self._chosen.get(usual, usual)

    def _usual_path(self, document: Document) -> Path:
        """Path beside the photo, or beside the folder of a sequence; in the working directory for
        uploads and the demo, and where nothing can be written there.
        """
        view, is_sequence = pose_file_view(document), bool(document.stepped)
        kind = "pose" if is_alone(document) else "scene"
        name = f"{stem_of(document, view, is_sequence)}.{kind}.json"
        photo = document.scene.views[view].path
        if photo is None:
            return Path.cwd() / name
        folder = photo.resolve().parent
        beside = folder.parent if is_sequence else folder
        is_ours = beside.name in ("demo_files", "assets") or self._state in beside.parents
        is_usable = not is_ours and os.access(beside, os.W_OK)
        return (beside if is_usable else Path.cwd()) / name

    def _to_keep(self, session: Session) -> Kept:
        self._is_adopted |= session.saved is None
        return session.document if session.is_unsaved else "nothing"

    def _discard_offered(self) -> None:
        if self._offered is not None:
            discard(self._offered)
            self._offered = None


def _save_keypoints(model: ModelFile) -> bool:
    """Write a model's key points beside it, unless its files have the same; whether it wrote."""
    path, keypoints = model.path, model.keypoints
    if path is None or keypoints is None:
        return False
    file, known = keypoints_path(path), load_keypoints(path, model.mesh)
    if known is not None and (path.parent in PLACES or is_equal(known, keypoints)):
        return False
    if file.exists():
        file.replace(file.with_suffix(".json.bak"))
    save_keypoints(path, keypoints, model.unit)
    return True


def _times_on_disk(path: Path) -> list[int]:
    """Times (ns) of a pose file and its masks; 0: there is none."""
    return [f.stat().st_mtime_ns if f.exists() else 0 for f in (path, *mask_paths(path))]


def _fingerprint(path: Path, document: Document) -> tuple[object, ...]:
    """Values that are equal while a file stays as it was written for a photo and a model."""
    scene = document.scene
    photo = scene.frames[0].file.path if scene.frames else scene.views[0].file.sha256
    return *_times_on_disk(path), photo, scene.objects[0].model.sha256


def _next_free(path: Path) -> Path:
    """The path with the first free number from 2 on."""
    stem, kind, ending = path.name.rsplit(".", 2)
    numbered = (path.with_name(f"{stem}.{number}.{kind}.{ending}") for number in count(2))
    return next(file for file in numbered if not any(_times_on_disk(file)))


def make_autosave(document: Document) -> AutosavedSession:
    """Make the autosave of a document, with absolute paths."""
    scene, saved = document.scene, as_saved(document.scene, canonical=False)
    cameras, objects = tuple(view.camera for view in scene.views), []
    for record, item in zip(saved.objects, scene.objects, strict=True):
        changes = {"start": item.start, "model": _with_absolute_path(record.model)}
        if item.start_cameras != cameras:
            changes["start_cameras"] = item.start_cameras
        objects.append(replace(record, **changes))
    views = tuple(replace(view, file=_with_absolute_path(view.file)) for view in scene.views)
    return AutosavedSession(
        saved_at=time.time(),
        active_object=document.object.id,
        active_view=document.view_index,
        photo_names=tuple(view.name for view in scene.views),
        scene=replace(saved, views=views, objects=tuple(objects)),
    )


def _with_absolute_path(file: Asset) -> Asset:
    return replace(file, path=file.path and file.path.resolve())
