"""Outlines beside that of the model at hand: of the objects that are not active, while the active
one is not dragged, and of all objects in each of several views.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.app.state.commands import change
from poseviewer.app.state.document import stands
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import Outlines, Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.fit.problem import is_seen
from poseviewer.fit.scene import PlacedModel
from poseviewer.fit.visibility import visibility_of_depths
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.contour import quick_silhouette, seen_lines

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

MOST_SAMPLES = 400_000
"""Most samples of the picture that tells which object hides which."""
DRAWN_PX = 320
"""Pixels of the longer side of the picture that a small photo's outline is found on: twice a
thumbnail's."""

Numbered = Mapping[int, PlacedModel]


class OutlineWorker:
    """A thread that draws outlines, one drawing at a time, when what they come from has changed."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._worker: Worker[Outlines] = Worker("outlines", notify)
        self._drawn: object = None
        self._renderers: dict[Mesh, SoftwareRenderer] = {}
        self._lines: dict[tuple[Mesh, Pose], FloatArray] = {}

    def take(self) -> Iterator[Edit]:
        """Give what is new since the last call; raises the error that the drawing ended in."""
        update = self._worker.take()
        if update is not None and update.error is not None:
            raise update.error
        if update is not None and update.item is not None:
            yield change(outlines=update.item)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    def follow(self, session: Session) -> None:
        """Begin what is to be drawn by now. The active object hides what is behind it only while it
        is at rest.
        """
        own, scene = session.document, session.document.scene
        numbers = [int(one.id) for one in scene.objects]
        large = {numbers[index]: scene.placed(index, own.at) for index in own.others}
        is_at_rest = large and not session.moving and stands(own.object)
        front = [scene.placed(own.active, own.at)] if is_at_rest else []
        shown = [index for index, one in enumerate(scene.objects) if not one.hidden]
        views = range(len(scene.views)) if len(scene.views) > 1 else ()
        small = [{numbers[i]: scene.placed(i, view) for i in shown} for view in views]
        placed = [*large.values(), *front, *(one for view in small for one in view.values())]
        drawn = [list(large), list(map(list, small)), [(one.mesh, one.pose) for one in placed]]
        if drawn != self._drawn and not self._worker.busy and session.preparation is None:
            self._drawn = drawn
            self._worker.start(lambda: iter([self._draw(large, front, small, placed)]))

    def _draw(
        self,
        large: Numbered,
        front: Sequence[PlacedModel],
        small: Sequence[Numbered],
        placed: Sequence[PlacedModel],
    ) -> Outlines:
        """Outlines in the large view, where neither what is drawn nor the ``front`` hides them, and
        in the small ones.
        """
        kept = {one.mesh: self._renderers.get(one.mesh) for one in placed}
        self._renderers = {mesh: own or renderer_of(mesh).clone() for mesh, own in kept.items()}
        known, self._lines = self._lines, {}

        def outline(one: PlacedModel, pose: Pose) -> FloatArray:
            lines = known.get((one.mesh, pose))
            if lines is None:
                lines = quick_silhouette(one.mesh, self._renderers[one.mesh], pose)
            self._lines[one.mesh, pose] = lines
            return lines

        def share(one: PlacedModel) -> FloatArray:
            if not is_seen(one.mesh, one.pose):
                return np.zeros((0, 2, 2))
            camera = one.pose.camera
            pose = one.pose.scaled(min(1.0, DRAWN_PX / max(camera.width, camera.height)))
            return outline(one, pose) / np.array([pose.camera.width, pose.camera.height])

        lines = {number: outline(one, one.pose) for number, one in large.items()}
        models = [*large.values(), *front]
        if lines and len(models) > 1:
            camera = models[0].pose.camera
            samples = min(1.0, (MOST_SAMPLES / (camera.width * camera.height)) ** 0.5)
            depths = [self._renderers[one.mesh].depth(one.pose.scaled(samples)) for one in models]
            found = visibility_of_depths(depths)
            for index, number in enumerate(large):
                seen = found.seen(index)
                if not np.array_equal(seen, found.drawn[index]):
                    lines[number] = seen_lines(lines[number], seen, samples)
        views = ({number: share(one) for number, one in view.items()} for view in small)
        return Outlines(lines, tuple(views))
