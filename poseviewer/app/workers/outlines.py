"""Outlines beside that of the model at hand: of the objects that are not picked, while the picked
one is not dragged, and of the model in each photo of a set.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from poseviewer.app.state.document import SceneObject
from poseviewer.app.state.objects import OutlinesDrawn, StripDrawn
from poseviewer.app.state.session import Outlines, Session, Strip
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.fit.visibility import visibility_of_depths
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.contour import quick_silhouette, seen_lines
from poseviewer.starts.view_set import is_seen

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.renderer import SoftwareRenderer

MOST_SAMPLES = 400_000
"""Most samples of the picture that tells which object hides which."""
DRAWN_PX = 320
"""Pixels of the longer side of the picture that an outline in a set's photo is found on: twice a
thumbnail's."""

Command = TypeVar("Command")


class OutlineWorker(Generic[Command]):
    """A thread that draws outlines, one drawing at a time, when what they come from has changed."""

    def __init__(self, name: str, notify: Callable[[], None]) -> None:
        self._worker: Worker[Command] = Worker(name, notify)
        self._drawn: tuple[object, ...] = ()
        self._renderers: dict[Mesh, SoftwareRenderer] = {}

    def take(self) -> Iterator[Command]:
        """Give what is new since the last call."""
        update = self._worker.take()
        if update is not None and update.item is not None:
            yield update.item

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    def _is_idle(self, session: Session) -> bool:
        return not self._worker.busy and session.preparation is None

    def _start(self, draw: Callable[[], Command], *sources: object) -> None:
        """``draw``, unless that was done from the very same objects last."""
        if len(sources) == len(self._drawn) and all(map(operator.is_, sources, self._drawn)):
            return
        self._drawn = sources
        self._worker.start(lambda: (draw() for _ in range(1)))

    def _renderers_of(self, meshes: set[Mesh]) -> dict[Mesh, SoftwareRenderer]:
        """Renderers of this thread, kept from one drawing to the next."""
        kept = {mesh: made for mesh, made in self._renderers.items() if mesh in meshes}
        new = {mesh: renderer_of(mesh).clone() for mesh in meshes - kept.keys()}
        self._renderers = kept | new
        return self._renderers


class OthersWorker(OutlineWorker[OutlinesDrawn]):
    """Draws the objects that are not picked."""

    def start(self, session: Session, moving: bool) -> None:
        """Begin what is to be drawn by now. The picked object hides what is behind it only while it
        is at rest.
        """
        shown = session.document.standing
        at_rest = () if moving or not session.document.stands else (session.document,)
        drawn = (*shown, *at_rest) if shown else ()
        if self._is_idle(session):
            sources = (part for one in drawn for part in (one.registration.mesh, one.pose))
            self._start(
                lambda: self._draw(shown, at_rest), *(one.number for one in drawn), *sources
            )

    def _draw(
        self, shown: tuple[SceneObject, ...], picked: tuple[SceneObject, ...]
    ) -> OutlinesDrawn:
        """The outlines of what is shown, where neither of it nor what is picked hides them."""
        renderers = self._renderers_of({one.registration.mesh for one in (*shown, *picked)})
        pairs = [(one, renderers[one.registration.mesh]) for one in (*shown, *picked)]
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
        return OutlinesDrawn(Outlines(lines))


class StripWorker(OutlineWorker[StripDrawn]):
    """Draws the model in every photo of the set, small."""

    def start(self, session: Session) -> None:
        """Begin what is to be drawn by now."""
        document = session.document
        views = document.views
        if views is None or not self._is_idle(session):
            return
        poses, mesh = views.poses, document.registration.mesh
        self._start(lambda: self._draw(mesh, poses), mesh, views.views, *poses)

    def _draw(self, mesh: Mesh, poses: tuple[Pose, ...]) -> StripDrawn:
        renderer = self._renderers_of({mesh})[mesh]
        return StripDrawn(Strip(poses, tuple(_outline(mesh, renderer, pose) for pose in poses)))


def _outline(mesh: Mesh, renderer: SoftwareRenderer, pose: Pose) -> FloatArray:
    """(N, 2, 2): in shares of the photo; empty where it does not show the model."""
    if not is_seen(mesh, pose):
        return np.zeros((0, 2, 2))
    camera = pose.camera
    small = pose.scaled(min(1.0, DRAWN_PX / max(camera.width, camera.height)))
    lines = quick_silhouette(mesh, renderer, small)
    return lines / np.array([small.camera.width, small.camera.height])
