"""Write poses beside their photos, and the session whenever it has changed."""

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Literal, TypeVar

from poseviewer.app.state.display_edits import report_error
from poseviewer.app.state.document import Document, is_alone
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import pose_file_view, scene_to_save, stem_of
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError
from poseviewer.files.keypoints import load_keypoints, save_keypoints
from poseviewer.files.masks import mask_path, save_pose_and_mask
from poseviewer.files.scene_json import as_saved, pose_json, save_scene
from poseviewer.files.state.autosave import (
    AutosavedSession,
    SessionFile,
    discard,
    find_abandoned,
)
from poseviewer.files.state.uploads import copy_out
from poseviewer.scene.assets import ModelFile, PhotoFile

PERIOD_S = 0.5
"""While something moves the session is written so often: with the write itself and the main loop's
rest, less than a second is lost to a crash."""
RETRY_S = 10.0
"""A full disk is not mended in less."""


Asset = TypeVar("Asset", PhotoFile, ModelFile)
Kept = Document | Literal["nothing"]
"""Contents of the session's own file."""


class Autosaver:
    """Keeps the session on disk, and finds what an earlier one left; its own file is touched in one
    thread alone, and each time whole or not at all.
    """

    def __init__(self, state: Path) -> None:
        self._uploads = (state / "uploads").resolve()
        self._own: dict[Path, tuple[object, ...]] = {}
        self._named: dict[Path, Path] = {}  # by the usual path of each
        self._offered, self.offer = find_abandoned(state / "sessions") or (None, None)
        """Session that an earlier run left unsaved, until it is taken or refused."""
        self._is_adopted = False  # whether the offer has been opened: it is this session's own now
        self._file = SessionFile(state / "sessions")
        self._kept: Kept = "nothing"
        self.job = Worker(
            "autosave",
            self._to_keep,
            self._keeping,
            period_s=lambda now: PERIOD_S if now.is_moving else 0,
        )
        """Writes the session as soon as it has changed; says why it cannot, once."""

    def take_offer(self, wanted: bool) -> AutosavedSession | None:
        """The offer, for the last time. A ``wanted`` one stays on disk until it has been opened."""
        offer, self.offer = self.offer, None
        if not wanted:
            self._discard_offered()
        return offer

    def close(self, session: Session) -> None:
        """At a clean end: what is saved elsewhere needs no autosave; what is not, stays."""
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
        """The file's name, as it is shown; its folder is told when it is written."""
        return self._path(session.document).name

    def file_to_replace(self, document: Document) -> Path | None:
        """The file that saving would replace, if this session did not write it."""
        path = self._path(document)
        is_own = self._own.get(path) == _mark(path, document)
        return None if is_own or not any(_on_disk(path)) else path

    def save(self, session: Session, beside: bool = False) -> Path:
        """Write the pose of one object in one photo with its mask, else the scene with copies of
        uploads, beside the photo; under the next free name where ``beside``, else what is
        ``taken`` is kept as ``.bak``. Key points given by hand are written beside their model.

        Raises ``PoseViewerError``: it cannot be written there, or photo or models are no files.
        """
        own, scene = session.document, scene_to_save(session)
        path, kept = self._path(own), list[Path]()
        if beside:
            path = self._named[self._usual_path(own)] = _next_free(self._usual_path(own))
        elif self.file_to_replace(own):
            kept = [one for one in (path, mask_path(path)) if one.exists()]
        for one in kept:
            one.replace(one.with_suffix(f"{one.suffix}.bak"))
        try:
            if is_alone(own):
                save_pose_and_mask(path, pose_json(as_saved(scene)), scene.mask(0))
            else:
                save_scene(path, copy_out(path, as_saved(scene), self._uploads))
        except PoseViewerError:
            for one in kept:
                one.with_suffix(f"{one.suffix}.bak").replace(one)
            raise
        for one in scene.objects:
            _save_keypoints(one.model)
        self._own[path] = _mark(path, own)
        return path

    def _path(self, document: Document) -> Path:
        """The usual path, or the one that was taken beside it."""
        usual = self._usual_path(document)
        return self._named.get(usual, usual)

    def _usual_path(self, document: Document) -> Path:
        """Beside the photo; for uploads and the demo in the working directory."""
        view, ending = pose_file_view(document), "pose.json" if is_alone(document) else "scene.json"
        path = document.scene.views[view].path
        folder = Path.cwd() if path is None else path.resolve().parent
        is_ours = folder.name in ("demo_files", "assets") or self._uploads in folder.parents
        if is_ours or not os.access(folder, os.W_OK):
            folder = Path.cwd()
        return folder / f"{stem_of(document, view)}.{ending}"

    def _to_keep(self, session: Session) -> Kept:
        self._is_adopted |= session.saved is None
        return session.document if session.is_unsaved else "nothing"

    def _discard_offered(self) -> None:
        if self._offered is not None:
            discard(self._offered)
            self._offered = None


def _save_keypoints(model: ModelFile) -> None:
    """Write a model's key points beside it, unless it has them from its files."""
    path, keypoints = model.path, model.keypoints
    if path is None or keypoints is None or load_keypoints(path, model.mesh) is not None:
        return
    save_keypoints(path, keypoints, model.unit)


def _on_disk(path: Path) -> list[int]:
    """Times (ns) of a pose file and its mask, 0 where there is none."""
    return [f.stat().st_mtime_ns if f.exists() else 0 for f in (path, mask_path(path))]


def _mark(path: Path, document: Document) -> tuple[object, ...]:
    """Values that are equal while a file stays as it was written, for one photo and model."""
    scene = document.scene
    return *_on_disk(path), scene.views[0].photo.sha256, scene.objects[0].model.sha256


def _next_free(path: Path) -> Path:
    """The path with the first number from 2 on of which there is no file."""
    stem, kind, ending = path.name.rsplit(".", 2)
    numbered = (path.with_name(f"{stem}.{number}.{kind}.{ending}") for number in count(2))
    return next(one for one in numbered if not any(_on_disk(one)))


def make_autosave(document: Document) -> AutosavedSession:
    """All that is kept of a document."""
    scene, saved = document.scene, as_saved(document.scene, canonical=False)
    cameras, objects = tuple(view.camera for view in scene.views), []
    for one, known in zip(saved.objects, scene.objects, strict=True):
        start = {"start": known.start, "model": _with_absolute_path(one.model)}
        if known.start_cameras != cameras:
            start["start_cameras"] = known.start_cameras
        objects.append(replace(one, **start))
    views = tuple(replace(view, file=_with_absolute_path(view.file)) for view in scene.views)
    return AutosavedSession(
        saved_at=time.time(),
        active_object=document.object.id,
        active_view=document.view_index,
        photo_names=tuple(view.photo.name for view in scene.views),
        scene=replace(saved, views=views, objects=tuple(objects)),
    )


def _with_absolute_path(file: Asset) -> Asset:
    """A photo or a model by its absolute path."""
    return replace(file, path=file.path and file.path.resolve())
