"""The outlines of the objects that are not picked: drawn when they or the camera change, and not
while the picked one is dragged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.app.state.document import SceneObject
from poseviewer.app.state.objects import OutlinesDrawn
from poseviewer.app.state.session import Outlines, Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.fit.visibility import visibility_of_depths
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.contour import quick_silhouette, seen_lines

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.renderer import SoftwareRenderer

MOST_SAMPLES = 400_000
"""Of the picture in which it is found what hides what."""


class OthersWorker:
    """A thread that draws what is not picked."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._worker: Worker[Outlines] = Worker("others", notify)
        self._drawn: tuple[SceneObject, ...] = ()
        self._renderers: dict[Mesh, SoftwareRenderer] = {}

    def start(self, session: Session, moving: bool) -> None:
        """Begin what is to be drawn by now; one drawing at a time. The picked object hides what is
        behind it only while it is at rest.
        """
        shown = session.document.standing
        at_rest = () if moving or not session.document.stands else (session.document,)
        drawn = (*shown, *at_rest) if shown else ()
        is_drawn = _places(drawn) == _places(self._drawn)
        if is_drawn or self._worker.busy or session.preparation is not None:
            return
        self._drawn = drawn
        self._worker.start(lambda: self._draw(shown, at_rest))

    def take(self) -> Iterator[OutlinesDrawn]:
        """What is new since the last time."""
        update = self._worker.take()
        if update is not None and update.item is not None:
            yield OutlinesDrawn(update.item)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    def _draw(
        self, shown: tuple[SceneObject, ...], picked: tuple[SceneObject, ...]
    ) -> Iterator[Outlines]:
        """The outlines of what is shown, where neither of it nor what is picked hides them."""
        meshes = {one.registration.mesh for one in (*shown, *picked)}
        kept = {mesh: made for mesh, made in self._renderers.items() if mesh in meshes}
        new = {mesh: renderer_of(mesh).clone() for mesh in meshes - kept.keys()}
        self._renderers = kept | new
        pairs = [(one, self._renderers[one.registration.mesh]) for one in (*shown, *picked)]
        count = len(shown)
        lines = {one.number: quick_silhouette(r.mesh, r, one.pose) for one, r in pairs[:count]}
        if count and len(pairs) > 1:
            photo = shown[0].registration.photo
            samples = min(1.0, (MOST_SAMPLES / (photo.width * photo.height)) ** 0.5)
            found = visibility_of_depths([r.depth(one.pose.scaled(samples)) for one, r in pairs])
            for index, one in enumerate(shown):
                seen = found.seen(index)
                if not np.array_equal(seen, found.drawn[index]):
                    lines[one.number] = seen_lines(lines[one.number], seen, samples)
        yield Outlines(lines)


def _places(objects: tuple[SceneObject, ...]) -> list[tuple[int, int, int]]:
    """What their outlines come from."""
    return [(one.number, id(one.registration.mesh), id(one.pose)) for one in objects]
