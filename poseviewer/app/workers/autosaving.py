"""Where the app writes: poses beside their photos; and the session, as soon as something in it has
changed, in a thread of its own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from poseviewer.app.state.document import Document, SceneObject
from poseviewer.app.state.hiding import compared_mask
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import filed, masks_in_set
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError, sentence_of
from poseviewer.files.masks import mask_path, save_pose_and_mask
from poseviewer.files.pose import PoseRecord
from poseviewer.files.scene import SceneRecord, save_scene
from poseviewer.files.state.autosave import (
    AutosavedSession,
    KeptSet,
    SessionFile,
    discard,
    left_behind,
)
from poseviewer.files.view_set import save_in_set
from poseviewer.fit.settings import settings_as_json
from poseviewer.geometry.mask import Mask

PERIOD_S = 0.5
"""While something moves the session is written so often: with the write itself and the main loop's
rest, less than a second is lost to a crash."""
RETRY_S = 10.0
"""A full disk is not mended in less."""


class Autosaver:
    """Keeps the session on disk, and finds what an earlier one left.

    Its own file is touched in one thread alone, and each time whole or not at all; what was there
    stays until then. The newest wish wins.
    """

    def __init__(self, state: Path) -> None:
        self._uploads = state / "uploads"
        self._writer: Worker[None] = Worker("autosave")
        self._saved: Document | None = None
        """What is on disk, or on its way there."""
        self._next = 0.0
        self._moving = False
        self._trouble = self._adopted = False
        self._own: set[Path] = set()
        self._offered, self._offer = left_behind(state / "sessions") or (None, None)
        self._file = SessionFile(state / "sessions")

    def offer(self) -> AutosavedSession | None:
        """What an earlier session left unsaved, until it is taken or refused."""
        return self._offer

    def take_offer(self, wanted: bool) -> AutosavedSession | None:
        """The offer, for the last time. One that is ``wanted`` stays on disk until ``adopt``: it
        may turn out that it cannot be opened.
        """
        offer, self._offer = self._offer, None
        if not wanted:
            self._discard_offered()
        return offer

    def adopt(self, session: Session) -> None:
        """The offer has been opened: keep it as this session's own."""
        self._adopted = True
        self.save_now(session)

    def tick(self, session: Session) -> str:
        """Write the session, if it changed: at once, and now and then while a hand or a search
        moves the model. Gives why it cannot be written, once.
        """
        moving = session.before_drag is not None or session.searching
        if moving is not self._moving or not (moving or self._trouble):
            self._next = 0.0
        self._moving = moving
        if time.monotonic() >= self._next:
            self.save_now(session)
        return self._take_trouble()

    def save_now(self, session: Session) -> None:
        """Write the session, if it changed since."""
        document = session.document
        if document is self._saved or not session.unsaved:
            return
        self._next = time.monotonic() + PERIOD_S
        self._saved = document
        others = tuple(_as_picked(one, document.photo_path) for one in document.others)
        kept = replace(_as_picked(document, document.photo_path), others=others)

        def write() -> Iterator[None]:
            self._file.save(kept)
            if self._adopted:
                self._discard_offered()
            yield

        self._writer.start(write)

    def close(self, session: Session) -> None:
        """At a clean end: what is saved elsewhere needs no autosave; what is not, stays."""
        self.save_now(session)
        if not session.unsaved:
            self._writer.start(self._forget)
        self._writer.finish()
        self._file.close()

    def where(self, session: Session) -> str:
        """The pose file's name, as it is shown; its folder is told when it is written."""
        return self._pose_path(filed(session)).name

    def save_pose(self, session: Session, record: PoseRecord) -> Path:
        """Write the pose, and the mask, beside the photo. A file that another session wrote is kept
        as ``.bak``.

        Raises:
            PoseFileError: it cannot be written there.
        """
        session = filed(session)
        path = self._pose_path(session)
        is_others = path.exists() and path not in self._own
        kept = [one for one in (path, mask_path(path)) if is_others and one.exists()]
        for one in kept:
            one.replace(one.with_suffix(f"{one.suffix}.bak"))
        try:
            if session.document.views is not None and record.in_set is not None:
                save_in_set(path, record, masks_in_set(session.document))
            else:
                save_pose_and_mask(path, record, compared_mask(session))
        except PoseViewerError:
            for one in kept:
                one.with_suffix(f"{one.suffix}.bak").replace(one)
            raise
        self._own.add(path)
        self._saved = None
        self._writer.start(self._forget)
        return path

    def save_scene(self, session: Session, scene: SceneRecord, masks: Mapping[str, Mask]) -> Path:
        """Write all objects beside their photo, as ``save_pose`` does the picked one's pose."""
        pose = self._pose_path(session)
        path = pose.with_name(pose.name.removesuffix(".pose.json") + ".scene.json")
        if path.exists() and path not in self._own:
            path.replace(path.with_suffix(".json.bak"))
        save_scene(path, scene, masks)
        self._own.add(path)
        return path

    def _pose_path(self, session: Session) -> Path:
        """Beside the photo; for uploads and the demo, which lie in folders of ours, where the
        program was started.
        """
        path = session.document.photo_path
        photo = session.document.registration.photo
        if path is None or self._uploads in path.parents:
            # An uploaded name never becomes a path.
            return Path.cwd() / f"photo-{photo.sha256[:8]}.pose.json"
        folder = path.resolve().parent
        if not os.access(folder, os.W_OK) or folder.name in ("demo_files", "assets"):
            folder = Path.cwd()
        return folder / f"{path.stem}.pose.json"

    def _forget(self) -> Iterator[None]:
        self._file.close()
        discard(self._file.path)
        yield

    def _take_trouble(self) -> str:
        """Why the last write failed, where the one before did not."""
        ended = self._writer.take()
        if ended is None or not ended.finished:
            return ""
        known, self._trouble = self._trouble, ended.error is not None
        if ended.error is None:
            return ""
        self._saved, self._next = None, time.monotonic() + RETRY_S
        if known:
            return ""
        return f"{sentence_of(ended.error)} Until then a crash would lose what is not saved."

    def _discard_offered(self) -> None:
        if self._offered is not None:
            discard(self._offered)
            self._offered = None


def _as_picked(one: SceneObject, photo_path: Path | None) -> AutosavedSession:
    """The session in which an object is the only one."""
    own = one.registration
    photo = own.photo
    return AutosavedSession(
        photo=_absolute(photo_path),
        photo_name=photo.name,
        photo_sha256=photo.sha256,
        model=_absolute(one.model_path),
        model_name=own.mesh_name,
        pose=PoseRecord(
            one.pose,
            undistortion=photo.undistortion,
            without=own.mesh.left_out,
            symmetry=own.symmetry,
        )
        if one.searched is None
        else one.searched.record,
        start=PoseRecord(own.start, undistortion=photo.undistortion),
        settings=settings_as_json(one.settings),
        saved_at=time.time(),
        mask=one.compared_mask,
        number=one.number,
        name=one.name,
        hidden=one.hidden,
        locked=one.locked,
        views=_set_of(one),
    )


def _set_of(one: SceneObject) -> KeptSet | None:
    views = one.views
    if views is None:
        return None
    masks = {
        name: own.mask
        for name, own in zip(views.names, one.own_of_photos, strict=True)
        if own.mask is not None
    }
    left = (name for name, on in zip(views.names, views.compared, strict=True) if not on)
    folder = _absolute(views.choice.folder)
    return KeptSet(
        views.source.resolve(),
        replace(views.choice, folder=folder),
        views.scale,
        views.start_scale,
        views.free_size,
        tuple(left),
        masks,
    )


def _absolute(path: Path | None) -> Path | None:
    return None if path is None else path.resolve()
