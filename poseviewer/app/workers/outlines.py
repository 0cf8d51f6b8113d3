"""Worker for outlines: of other objects in the large view, and of all in the small ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from poseviewer.app.state.document import is_shown
from poseviewer.app.state.edits import Edit, set_fields
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
from poseviewer.scene.types import MANY_VIEWS, PlacedModel

MAX_SAMPLES = 400_000
"""Pixels of the depth images that tell which object occludes which."""
SMALL_PX = 320
"""Longer side of the rendering from which a small view's outline is taken."""
MAX_CACHED_OUTLINES = 512
"""Number of outlines: 30 objects in as many views as a strip shows."""

ModelsById = Mapping[int, tuple[Mesh, Pose]]


@dataclass(frozen=True, slots=True)
class OutlineRequest:
    """Request for outlines; equal if models and poses are."""

    large: ModelsById
    """Objects but the active one in the large view, by their ids."""
    front: tuple[tuple[Mesh, Pose], ...]
    """Active object while it is at rest, as an occluder."""
    small: tuple[ModelsById, ...]
    """Objects in each of several views, by their ids."""

    @classmethod
    def of(cls, session: Session) -> OutlineRequest:
        """The request of a session."""
        document, scene = session.document, session.document.scene

        def model_at(index: int, view: int) -> tuple[Mesh, Pose]:
            return scene.objects[index].mesh, scene.pose(index, view)

        ids = [int(item.id) for item in scene.objects]
        large = {ids[index]: model_at(index, document.view_index) for index in document.others}
        is_at_rest = large and not session.is_moving and is_shown(document.object)
        shown = [index for index, item in enumerate(scene.objects) if is_shown(item)]
        views = range(len(scene.views)) if 1 < len(scene.views) <= MANY_VIEWS else ()
        return cls(
            large,
            (model_at(document.active, document.view_index),) if is_at_rest else (),
            tuple({ids[i]: model_at(i, view) for i in shown} for view in views),
        )


def outlining() -> Worker[OutlineRequest, Edit]:
    """Draw outlines; a drawing under way is finished before the next one."""
    renderer = lru_cache(maxsize=MAX_OBJECTS)(lambda mesh: renderer_of(mesh).clone())

    @lru_cache(maxsize=MAX_CACHED_OUTLINES)
    def outline(mesh: Mesh, pose: Pose) -> FloatArray:
        return quick_silhouette(mesh, renderer(mesh), pose)

    def share(mesh: Mesh, pose: Pose) -> FloatArray:
        if not PlacedModel(mesh, pose).is_seen:
            return np.zeros((0, 2, 2))
        pose = pose.rescale(min(1.0, SMALL_PX / max(pose.camera.width, pose.camera.height)))
        return outline(mesh, pose) / np.array([pose.camera.width, pose.camera.height])

    def make(request: OutlineRequest) -> Iterator[Edit]:
        views = [request.large, *request.small]
        meshes = {mesh for models in views for mesh, _ in models.values()}
        if renderer.cache_info().currsize > len(meshes) + len(request.front):
            renderer.cache_clear()  # some are of models that were closed
            outline.cache_clear()
        lines = {object_id: outline(*model) for object_id, model in request.large.items()}
        models = [*request.large.values(), *request.front]
        if lines and len(models) > 1:
            camera = models[0][1].camera
            samples = min(1.0, (MAX_SAMPLES / (camera.width * camera.height)) ** 0.5)
            depths = [renderer(mesh).depth(pose.rescale(samples)) for mesh, pose in models]
            visible = visibility_of_depths(depths)
            for index, object_id in enumerate(request.large):
                pixels = visible.mask(index)
                if not np.array_equal(pixels, visible.silhouettes[index]):
                    lines[object_id] = select_visible_lines(lines[object_id], pixels, samples)
        small = tuple({key: share(*model) for key, model in view.items()} for view in request.small)
        yield set_fields("results", outlines=Outlines(lines, small))

    return Worker(
        "outlines",
        lambda session: None if session.preparation else OutlineRequest.of(session),
        make,
        serves=lambda begun, request, busy: busy or begun == request,
    )
