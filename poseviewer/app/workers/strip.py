"""The strip of a set's photos: the model's outline in each of them, while it moves."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.app.state.session import Session, Strip
from poseviewer.app.state.views import StripDrawn
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.contour import quick_silhouette
from poseviewer.starts.view_set import is_seen

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.renderer import SoftwareRenderer

DRAWN_PX = 320
"""Pixels of the longer side of the picture that an outline is found on: twice a thumbnail's."""


class StripWorker:
    """A thread that draws the model in every photo of the set, small."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._worker: Worker[Strip] = Worker("strip", notify)
        self._drawn: tuple[object, ...] = ()
        self._renderer: tuple[Mesh, SoftwareRenderer] | None = None

    def start(self, session: Session, swung: Pose | None) -> None:
        """Begin what is to be drawn by now, one drawing at a time; ``swung``: the pose in the large
        photo, in place of the session's.
        """
        document = session.shown
        views = document.views
        if views is None or self._worker.busy or session.preparation is not None:
            return
        poses, mesh = views.poses, document.registration.mesh
        sure = session.covariance
        if swung is not None and sure is not None:  # the size swings along
            scale = views.scale * math.exp(-sure.log_size_at(swung))
            poses = views.views.posed(views.at, swung, scale)
        drawn = mesh, views.views, *poses
        if len(drawn) == len(self._drawn) and all(map(operator.is_, drawn, self._drawn)):
            return
        self._drawn = drawn
        self._worker.start(lambda: self._draw(mesh, poses))

    def take(self) -> Iterator[StripDrawn]:
        """What is new since the last time."""
        update = self._worker.take()
        if update is not None and update.item is not None:
            yield StripDrawn(update.item)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    def _draw(self, mesh: Mesh, poses: tuple[Pose, ...]) -> Iterator[Strip]:
        if self._renderer is None or self._renderer[0] is not mesh:
            self._renderer = mesh, renderer_of(mesh).clone()
        yield Strip(poses, tuple(_outline(mesh, self._renderer[1], pose) for pose in poses))


def _outline(mesh: Mesh, renderer: SoftwareRenderer, pose: Pose) -> FloatArray:
    """(N, 2, 2): in shares of the photo; empty where it does not show the model."""
    if not is_seen(mesh, pose):
        return np.zeros((0, 2, 2))
    camera = pose.camera
    small = pose.scaled(min(1.0, DRAWN_PX / max(camera.width, camera.height)))
    lines = quick_silhouette(mesh, renderer, small)
    return lines / np.array([small.camera.width, small.camera.height])
