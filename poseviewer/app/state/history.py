"""History for undo and redo."""

from __future__ import annotations

from dataclasses import dataclass, replace

from poseviewer.app.state.document import Document

MAX_STEPS = 200
MAX_OPENED = 4
"""Number of photos (or sets), and of models beside the open ones, that undo keeps in memory."""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """The documents before and after the current one."""

    past: tuple[Document, ...] = ()
    future: tuple[Document, ...] = ()
    last_step: tuple[object, Document | None] = (None, None)
    """Key of the last step, and the document that it led to."""

    def with_step(
        self, before: Document, after: Document | None = None, key: object = None
    ) -> History:
        """Add a step and drop undone ones; consecutive steps with the same ``key`` are one."""
        is_same = key is not None and self.last_step == (key, before) and not self.future
        past = self.past if is_same else _drop_oldest((*self.past, _without_photo(before)))
        return History(past, last_step=(key, after))

    def undo(self, now: Document) -> tuple[History, Document]:
        """Undo a step, if there is one."""
        if not self.past:
            return self, now
        return History(self.past[:-1], (_without_photo(now), *self.future)), self.past[-1]

    def redo(self, now: Document) -> tuple[History, Document]:
        """Redo a step, if there is one."""
        if not self.future:
            return self, now
        past = _drop_oldest((*self.past, _without_photo(now)))
        return History(past, self.future[1:]), self.future[0]


def _without_photo(document: Document) -> Document:
    """The document that reads a frame's photo again: hundreds of frames would fill the memory."""
    scene = document.scene
    if not scene.frames:
        return document
    view = replace(scene.views[0], file=replace(scene.views[0].file))
    return replace(document, scene=replace(scene, views=(view,)))


def _drop_oldest(past: tuple[Document, ...]) -> tuple[Document, ...]:
    """The newest steps within the limits."""
    past = past[-MAX_STEPS:]
    photos, meshes = set(), set()
    max_meshes = MAX_OPENED + len(past[-1].scene.objects) - 1
    for index in reversed(range(len(past))):
        scene = past[index].scene
        if not scene.frames:
            photos.add(tuple(id(view.photo) for view in scene.views))
        meshes |= {id(item.model.mesh.whole) for item in scene.objects}
        if len(photos) > MAX_OPENED or len(meshes) > max_meshes:
            return past[index + 1 :]
    return past
