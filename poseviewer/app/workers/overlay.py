"""Workers that draw the active object, quickly while it moves and finely at rest, and its loss."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from poseviewer.app.state.document import Document, in_view_alone, reference_view
from poseviewer.app.state.dragging import rotate
from poseviewer.app.state.edits import Edit, show_results
from poseviewer.app.state.marking import pose_beside_wheels
from poseviewer.app.state.results import NO_LINES, LossReading, Overlay
from poseviewer.app.state.session import Session
from poseviewer.app.workers.jobs import for_one_thread
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError
from poseviewer.fit.compared_pixels import ViewResidual
from poseviewer.fit.lighting import render_relit
from poseviewer.fit.problem import make_problem
from poseviewer.fit.visibility import DepthImage, depth_image
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.placing import fit_into_rectangle
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.losses.loss import Unexplained, mean_over
from poseviewer.render.overlay import LOOKS
from poseviewer.render.overlay.contour import Sketch, quick_silhouette, silhouette
from poseviewer.render.overlay.edges import find_lines
from poseviewer.render.overlay.styles import ModelInPhoto, Relight, draw_style, line_scale
from poseviewer.scene.types import PlacedModel

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

MAX_PICTURE_PIXELS = 2_000_000
"""Pixels of a drawn picture; larger photos are drawn smaller."""
SEARCH_DRAW_S = 0.1
"""Period of drawings during a search, which needs the processors."""
SETTLED_S = 0.15
"""Time at rest before the fine drawing begins."""
ALONE_PX = 760
"""Longer side of the picture of the model alone."""
ALONE_MARGIN = 0.08
"""Share of that picture's sides left free."""
ALONE_GROUND = (22, 24, 29)
"""RGB behind the model alone."""
ModelPicture = tuple[Document, tuple[float, float, float], bool]
"""Document, rotation vector of its model, and whether wheels are to be seen from the side."""
_cached_pixels = lru_cache(maxsize=1)(Photo.as_rgb8)
_cached_sketch = lru_cache(maxsize=1)(Sketch)


class LossReader:
    """Evaluates the loss of poses in one thread, and caches the views."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        self.renderer = renderer
        self._about: tuple[object, ...] = ()
        self._views: tuple[ViewResidual, ...] = ()
        self._note = ""
        self._start = 0.0

    def views(self, request: Session) -> tuple[ViewResidual, ...]:
        """The views as they are compared about ``read_scene``; empty if they cannot be."""
        document = request.document
        about = document.object.start, document.object.start_cameras, *request.pixels
        if about != self._about:
            self._about = about
            self._views = ()
            self._note = ""
            # The loss does not depend on the free parameters.
            free = {"free_focal": False, "free_principal_point": False}
            plain = replace(document.settings, lock=(), chart="auto", **free)
            anchor = request.read_scene.with_object(document.active, settings=plain)
            anchor = in_view_alone(anchor, document.active, document.view_index)
            view = reference_view(anchor, document.active, document.view_index)
            try:
                self._views = make_problem(anchor, document.active, view)[0].views
                self._start = self._read_all(document.at_start)[0].loss
            except PoseViewerError as error:
                self._note = str(error)
        return self._views

    def read(self, request: Session) -> LossReading:
        """Evaluate the losses, or say why there are none."""
        document, views = request.document, self.views(request)
        if not views:
            return LossReading(request.at_pose, note=self._note)
        mean, by_view = self._read_all(document)
        return LossReading(request.at_pose, mean, "", self._start, by_view)

    def _read_all(self, document: Document) -> tuple[Unexplained, dict[int, Unexplained]]:
        """Unexplained shares at the active object's pose: mean, and by view."""
        scene, active = document.scene, document.active
        by_view = {
            view.view_index: self._read(view, scene.model_at(active, view.view_index))
            for view in self._views
        }
        return mean_over(tuple(by_view.values())), by_view

    def _read(self, view: ViewResidual, model: PlacedModel) -> Unexplained:
        scale = view.scale
        if not model.depth > 0.0:
            return Unexplained(scale, scale.worst)
        moments = self.renderer.moments(model.pose, view.photo)
        return scale.read(view.loss.of_moments(moments), moments)


def _overlay(request: Session, outline: FloatArray = NO_LINES, **drawing: Any) -> Overlay:
    return Overlay(request.document, request.drawn, outline, **drawing)


class OverlayDrawer:
    """Draws overlays in one thread, with cached renderers."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        # A renderer caches for pictures of one size.
        self._quick, self._fine = renderer, renderer.clone()
        self._reader = LossReader(renderer.clone())

    def draw(self, request: Session) -> Overlay:
        """Draw the quick outline, or a picture."""
        document, style = request.document, request.display.style
        if style == "outline":
            return _overlay(
                request, quick_silhouette(document.drawn_mesh, self._quick, document.pose)
            )
        return _overlay(request) if style == "none" else self._picture(request)

    def _picture(self, request: Session) -> Overlay:
        document, display = request.document, request.display
        scene, view_index = document.scene, document.view_index
        photo = document.photo
        factor = min(1.0, (MAX_PICTURE_PIXELS / (photo.width * photo.height)) ** 0.5)
        pose = document.pose.rescale(factor)
        pixels = _cached_pixels(photo, pose.camera.width, pose.camera.height)
        relight: Relight | None = None
        if LOOKS[display.style].needs_light:
            views = self._reader.views(request)
            compared = next((view.photo for view in views if view.view_index == view_index), None)
            if compared is None:
                return _overlay(request)
            relight = partial(render_relit, compared, self._reader.renderer, document.pose)
        view = ModelInPhoto(pixels, document.drawn_mesh, self._fine, pose, relight, display.opacity)
        picture = draw_style(display.style, view)
        others = tuple((scene.objects[i].mesh, scene.pose(i, view_index)) for i in document.others)
        if others:
            occluded = _depth_of(others, factor) < depth_image(PlacedModel(document.mesh, pose))
            picture = np.where(occluded[..., None], pixels, picture)
        return _overlay(request, picture=picture)


@lru_cache(maxsize=1)
def _depth_of(others: tuple[tuple[Mesh, Pose], ...], factor: float) -> DepthImage:
    """Depth of the nearest object in a photo rescaled by ``factor``."""
    models = (PlacedModel(mesh, pose.rescale(factor)) for mesh, pose in others)
    return np.minimum.reduce([*map(depth_image, models)])


def draw_fine_lines(request: Session, renderer: SoftwareRenderer) -> Overlay:
    """Draw the outline and the edges inside it at full resolution."""
    mesh, pose = request.document.drawn_mesh, request.document.pose
    scale = line_scale(pose.camera.width, pose.camera.height)
    lines = find_lines(mesh, renderer, pose, scale)
    if lines is None:
        return _overlay(request)
    return _overlay(request, silhouette(lines.covered, lines.window), edges=lines.edge_segments())


def drawing() -> Worker[Session, Edit]:
    """Draw the model; a drawing under way is finished before the next one."""
    drawer = for_one_thread(OverlayDrawer)

    def make(request: Session) -> Iterator[Edit]:
        mesh, pose = request.document.drawn_mesh, request.document.pose
        if request.preparation is not None:
            overlay = _overlay(request, quick_silhouette(mesh, _cached_sketch(mesh), pose))
        else:
            overlay = drawer(mesh).draw(request)
        yield show_results(request.document, overlay=overlay)

    return Worker(
        "overlay",
        lambda session: session.request,
        make,
        serves=lambda begun, request, busy: busy or begun.drawn == request.drawn,
        period_s=lambda session: SEARCH_DRAW_S if session.is_searching else 0.0,
    )


def refining() -> Worker[Session, Edit]:
    """Draw the lines finely once the model is at rest."""
    renderer = for_one_thread(lambda renderer: renderer)

    def request_of(session: Session) -> Session | None:
        overlay = session.results.overlay
        if overlay is None or session.is_moving or overlay.drawn != session.drawn:
            return None
        is_wanted = session.preparation is None and session.display.style == "outline"
        return session.request if is_wanted else None

    def make(request: Session) -> Iterator[Edit]:
        job.require_current(request, SETTLED_S)
        overlay = draw_fine_lines(request, renderer(request.document.drawn_mesh))
        yield show_results(request.document, overlay=overlay)

    job = Worker(
        "fine overlay",
        request_of,
        make,
        serves=lambda begun, request, _: begun.drawn == request.drawn,
    )
    return job


def picturing() -> Worker[ModelPicture, Edit]:
    """Draw the model alone, for marking its points and until it is placed."""
    renderer = for_one_thread(lambda renderer: renderer)

    def request_of(session: Session) -> ModelPicture | None:
        is_wanted = session.shows_model or not session.document.object.is_placed
        if not is_wanted or session.preparation is not None or session.is_moving:
            return None
        return session.document, session.display.model_turn, session.tool == "wheels"

    def make(request: ModelPicture) -> Iterator[Edit]:
        document, turn, is_for_wheels = request
        photo, mesh = document.photo, document.drawn_mesh
        whole = Rectangle(0.0, 0.0, photo.width, photo.height)
        factor = min(1.0, ALONE_PX / max(photo.width, photo.height))
        beside = pose_beside_wheels(mesh, document.pose.camera) if is_for_wheels else None
        pose = rotate(beside or document.pose, mesh.centre, turn)
        pose = fit_into_rectangle(pose, mesh, whole.expand(-ALONE_MARGIN)).rescale(factor)
        ground = np.full((pose.camera.height, pose.camera.width, 3), ALONE_GROUND, np.uint8)
        view = ModelInPhoto(ground, mesh, renderer(mesh), pose, opacity=1.0)
        yield show_results(document, alone=(pose, draw_style("solid", view)))

    return Worker(
        "model alone",
        request_of,
        make,
        serves=lambda begun, request, busy: busy or begun == request,
    )


def reading() -> Worker[Session, Edit]:
    """Evaluate the loss of the current pose, except during a search, which reports its own."""
    reader = for_one_thread(LossReader)

    def make(request: Session) -> Iterator[Edit]:
        losses = reader(request.document.compared_mesh).read(request)
        yield show_results(request.document, losses=losses)

    return Worker(
        "loss",
        lambda now: None if now.preparation or now.is_searching else now.request,
        make,
        serves=lambda begun, request, busy: busy or begun.at_pose == request.at_pose,
    )
