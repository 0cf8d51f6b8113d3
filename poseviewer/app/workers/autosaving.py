"""Write poses beside their photos; and the session, as soon as something in it has changed, in a
thread of its own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from msgspec import structs

from poseviewer.app.state.document import Document, is_alone
from poseviewer.app.state.session import Session
from poseviewer.app.workers.exporting import filed_view, saved_scene
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError, sentence_of
from poseviewer.files.masks import mask_path, save_pose_and_mask
from poseviewer.files.scene_file import place_of, save_scene
from poseviewer.files.state.autosave import (
    AutosavedSession,
    SessionFile,
    discard,
    left_behind,
)
from poseviewer.files.state.uploads import taken_out
from poseviewer.files.structs import CameraNumbers
from poseviewer.starts.loading import pose_record, record_of

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
        """Document on disk, or on its way there."""
        self._next = 0.0
        self._moving = False
        self._trouble = self._adopted = False
        self._own: set[Path] = set()
        self._offered, self._offer = left_behind(state / "sessions") or (None, None)
        self._file = SessionFile(state / "sessions")

    def offer(self) -> AutosavedSession | None:
        """Session that an earlier run left unsaved, until it is taken or refused."""
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

        def write() -> Iterator[None]:
            self._file.save(kept_of(document))
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
        """The file's name, as it is shown; its folder is told when it is written."""
        return self._path(session.document).name

    def save(self, session: Session) -> Path:
        """Write the pose of one object in one photo with its mask, or else the scene, beside the
        photo; files of ours that a scene names are copied to it. A file that another session wrote
        is kept as ``.bak``.

        Raises:
            PoseViewerError: it cannot be written there, or photo or models are no files.
        """
        own, scene = session.document, saved_scene(session)
        path = self._path(own)
        is_others = path.exists() and path not in self._own
        kept = [one for one in (path, mask_path(path)) if is_others and one.exists()]
        for one in kept:
            one.replace(one.with_suffix(f"{one.suffix}.bak"))
        try:
            if is_alone(own):
                save_pose_and_mask(path, pose_record(scene), scene.mask(0))
            else:
                save_scene(path, taken_out(path, record_of(scene), self._uploads))
        except PoseViewerError:
            for one in kept:
                one.with_suffix(f"{one.suffix}.bak").replace(one)
            raise
        self._own.add(path)
        self._saved = None
        self._writer.start(self._forget)
        return path

    def _path(self, document: Document) -> Path:
        """Beside the photo; for uploads and the demo, which lie in folders of ours, where the
        program was started.
        """
        view = document.scene.views[filed_view(document)]
        path, ending = view.path, "pose.json" if is_alone(document) else "scene.json"
        if path is None or self._uploads in path.parents:
            # An uploaded name never becomes a path.
            return Path.cwd() / f"photo-{view.photo.sha256[:8]}.{ending}"
        folder = path.resolve().parent
        if not os.access(folder, os.W_OK) or folder.name in ("demo_files", "assets"):
            folder = Path.cwd()
        return folder / f"{path.stem}.{ending}"

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


def kept_of(document: Document) -> AutosavedSession:
    """All that is kept of a document."""
    scene = document.scene
    views = tuple(replace(view, path=_absolute(view.path)) for view in scene.views)
    objects = tuple(
        replace(one, model=replace(one.model, path=_absolute(one.model.path)))
        for one in scene.objects
    )
    record = record_of(replace(scene, views=views, objects=objects), canonical=False)
    cameras = tuple(view.camera for view in views)
    started = tuple(
        structs.replace(
            one,
            start=place_of(state.start),
            start_cameras=()
            if state.cameras == cameras
            else tuple(map(CameraNumbers.of, state.cameras)),
        )
        for one, state in zip(record.objects, document.states, strict=True)
    )
    return AutosavedSession(
        saved_at=time.time(),
        active_object=document.object.id,
        active_view=document.at,
        photo_names=tuple(view.photo.name for view in views),
        scene=structs.replace(record, objects=started),
    )


def _absolute(path: Path | None) -> Path | None:
    return None if path is None else path.resolve()
