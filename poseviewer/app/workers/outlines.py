"""Outlines of the objects that are not active, and of all objects in each of several views."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from poseviewer.app.state.display_edits import set_fields
from poseviewer.app.state.document import is_shown
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.objects import MAX_OBJECTS
from poseviewer.app.state.results import Outlines
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.fit.visibility import visibility_of_depths
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.contour import quick_silhouette, select_visible_lines
from poseviewer.scene.types import PlacedModel

MAX_SAMPLES = 400_000
"""Most samples of the picture that tells which object hides which."""
DRAWN_PX = 320
"""Pixels of the longer side of the picture that a small photo's outline is found on."""

LINES_KEPT = 512
"""Outlines that are kept: those of 30 objects in as many photos as a strip shows."""

Numbered = Mapping[int, tuple[Mesh, Pose]]


@dataclass(frozen=True, slots=True)
class OutlineRequest:
    """Request for outlines; equal where models and poses are."""

    large: Numbered
    """Objects in the large view that are not active, by their numbers."""
    front: tuple[tuple[Mesh, Pose], ...]
    """Active object where it is at rest: it hides what is behind it."""
    small: tuple[Numbered, ...]
    """Objects in each of several views, by their numbers."""

    @classmethod
    def of(cls, session: Session) -> OutlineRequest:
        """The outlines that are to be drawn by now."""
        own, scene = session.document, session.document.scene

        def placed_model(index: int, view: int) -> tuple[Mesh, Pose]:
            return scene.objects[index].mesh, scene.pose(index, view)

        numbers = [int(one.id) for one in scene.objects]
        large = {numbers[index]: placed_model(index, own.view_index) for index in own.others}
        is_at_rest = large and not session.is_moving and is_shown(own.object)
        shown = [index for index, one in enumerate(scene.objects) if is_shown(one)]
        views = range(len(scene.views)) if len(scene.views) > 1 else ()
        return cls(
            large,
            (placed_model(own.active, own.view_index),) if is_at_rest else (),
            tuple({numbers[i]: placed_model(i, view) for i in shown} for view in views),
        )


def outlining(notify: Callable[[], None]) -> Worker[OutlineRequest, Edit]:
    """Draw outlines beside that of the active object, one drawing at a time."""
    renderer = lru_cache(maxsize=MAX_OBJECTS)(lambda mesh: renderer_of(mesh).clone())

    @lru_cache(maxsize=LINES_KEPT)
    def outline(mesh: Mesh, pose: Pose) -> FloatArray:
        return quick_silhouette(mesh, renderer(mesh), pose)

    def share(mesh: Mesh, pose: Pose) -> FloatArray:
        if not PlacedModel(mesh, pose).is_seen:
            return np.zeros((0, 2, 2))
        pose = pose.rescale(min(1.0, DRAWN_PX / max(pose.camera.width, pose.camera.height)))
        return outline(mesh, pose) / np.array([pose.camera.width, pose.camera.height])

    def make(request: OutlineRequest) -> Iterator[Edit]:
        drawn = [request.large, *request.small]
        meshes = {mesh for placed in drawn for mesh, _ in placed.values()}
        if renderer.cache_info().currsize > len(meshes) + len(request.front):
            renderer.cache_clear()  # some are of models that are closed: they fill the memory
            outline.cache_clear()
        lines = {number: outline(*placed) for number, placed in request.large.items()}
        models = [*request.large.values(), *request.front]
        if lines and len(models) > 1:
            camera = models[0][1].camera
            samples = min(1.0, (MAX_SAMPLES / (camera.width * camera.height)) ** 0.5)
            depths = [renderer(mesh).depth(pose.rescale(samples)) for mesh, pose in models]
            visible = visibility_of_depths(depths)
            for index, number in enumerate(request.large):
                visible_pixels = visible.mask(index)
                if not np.array_equal(visible_pixels, visible.silhouettes[index]):
                    lines[number] = select_visible_lines(lines[number], visible_pixels, samples)
        views = ({number: share(*one) for number, one in view.items()} for view in request.small)
        yield set_fields("results", outlines=Outlines(lines, tuple(views)))

    return Worker(
        "outlines",
        lambda session: None if session.preparation else OutlineRequest.of(session),
        make,
        notify,
        serves=lambda begun, asked, busy: busy or begun == asked,
    )
