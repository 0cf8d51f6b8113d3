"""The model drawn over the photo, and its loss there: at once while it moves, finely at rest."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from poseviewer.app.state.commands import loss_computed, overlay_drawn
from poseviewer.app.state.document import Document, reference_view
from poseviewer.app.state.edits import Edit
from poseviewer.app.state.session import Losses, Overlay, OverlayRequest, Session
from poseviewer.app.workers.jobs import renderer_of
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError, SettingsError
from poseviewer.fit.compared import shown_attributes
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.loss import worst_registration_loss
from poseviewer.fit.problem import ComparedView, loss_of, make_problem
from poseviewer.fit.scene import PlacedModel, Scene
from poseviewer.fit.unexplained import LossScale, Unexplained, mean_over
from poseviewer.fit.visibility import DepthImage, depth_image
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.moments import model_attributes
from poseviewer.render.overlay.contour import Sketch, quick_silhouette, silhouette
from poseviewer.render.overlay.edges import find_lines
from poseviewer.render.overlay.looks import ModelInPhoto, Relight, draw_look, edge_layer, line_scale
from poseviewer.render.types import AttributeImage, PhotoAttributes

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.software_renderer import SoftwareRenderer

LARGEST_PICTURE = 2_000_000
"""Pixels of a drawn picture; of larger photos it is drawn smaller."""
SEARCH_DRAW_S = 0.1
"""A search is drawn no oftener: the processor is for the search."""
SETTLED_S = 0.15
"""After so long without motion the fine drawing is begun."""


NO_LINES = np.zeros((0, 2, 2))


class OverlayDrawer:
    """Draws one model after another, for one thread; keeps what takes time to make."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        # A renderer keeps what helps with the next picture of the same size: one for each size.
        self._quick, self._fine, self._loss = renderer, renderer.clone(), renderer.clone()
        self._losses = Losses()
        self._anchored: OverlayRequest | None = None
        self._views: tuple[ComparedView, ...] = ()
        self._shown_photo: object = None
        self._photo = np.zeros((0, 0, 3), np.uint8)
        self._others: tuple[tuple[tuple[Mesh, Pose], ...], float] = ((), 1.0)
        self._nearest = np.zeros((0, 0), np.float32)

    def draw(self, request: OverlayRequest) -> Iterator[Overlay]:
        """A quick drawing, the same with the loss, and, unless the model is moving, a fine one."""
        own, outline = request.document, NO_LINES
        lines = request.look in ("outline", "edges")
        if lines:
            outline = quick_silhouette(own.mesh, self._quick, own.pose)
            if request.moving:
                yield Overlay(request, outline, self._losses, loss_is_current=False)
        self._find_losses(request)
        if lines or request.look == "none":
            yield Overlay(request, outline, self._losses)
            if lines and not request.moving:
                yield self._fine_lines(request)
        else:
            yield self._picture(request)

    def _find_losses(self, request: OverlayRequest) -> None:
        own, anchor = request.document, request.anchor
        if self._anchored is None or not request.compares_same(self._anchored):
            self._anchored, self._views = request, ()
            # Which numbers are searched for is another matter.
            plain = replace(own.settings, lock=(), free_focal=False, chart="auto")
            anchor = anchor.with_object(own.active, settings=plain)
            view = reference_view(anchor, own.active, own.at)
            try:
                self._views = make_problem(anchor, own.active, view)[0].views
            except PoseViewerError as error:
                self._losses = Losses(note=str(error))
                return
            self._losses = Losses(start=mean_over(tuple(self._read_all(own, anchor).values())).loss)
        if self._views:
            found = self._read_all(own, own.scene)
            mean = mean_over(tuple(found.values()))
            self._losses = replace(self._losses, mean=mean, of_views=found)

    def _read_all(self, own: Document, scene: Scene) -> dict[int, Unexplained]:
        """The unexplained share of each view where the active object is in a scene."""
        return {
            view.index: self._read(view.photo, own, scene.pose(own.active, view.index))
            for view in self._views
        }

    def _read(self, photo: PhotoAttributes, own: Document, pose: Pose) -> Unexplained:
        if not pose.camera_from_model.apply(own.mesh.centre)[2] > 0.0:
            return Unexplained(LossScale.of(photo), worst_registration_loss(photo))
        moments = self._loss.moments(pose, photo)
        return LossScale.of(photo).read(loss_of(own.settings.method, moments, photo), moments)

    def _fine_lines(self, request: OverlayRequest) -> Overlay:
        pose = request.document.pose
        scale = line_scale(pose.camera.width, pose.camera.height)
        lines = find_lines(request.document.mesh, self._fine, pose, scale)
        if lines is None:
            return Overlay(request, NO_LINES, self._losses)
        left, top, width, height = (
            float(getattr(lines.window, side)) for side in ("left", "top", "width", "height")
        )
        outline = silhouette(lines.covered, lines.window)
        place = left, top, width, height
        return Overlay(request, outline, self._losses, edge_layer(lines, scale), place)

    def _picture(self, request: OverlayRequest) -> Overlay:
        own, photo = request.document, request.document.photo
        factor = min(1.0, (LARGEST_PICTURE / (photo.width * photo.height)) ** 0.5)
        pose = own.pose.scaled(factor)
        size = (pose.camera.height, pose.camera.width)
        if self._shown_photo is not photo or self._photo.shape[:2] != size:
            self._shown_photo, self._photo = photo, photo.as_rgb8(size[1], size[0])
        relight: Relight | None = None
        if request.look in ("relit", "residual"):
            compared = next((view.photo for view in self._views if view.index == own.at), None)
            if compared is None:
                return Overlay(request, NO_LINES, self._losses)
            attributes = shown_attributes(compared)
            lighting = recover_lighting(self._loss.moments(own.pose, attributes))

            def relit(image: AttributeImage) -> FloatArray:
                return lighting.apply(model_attributes(image, attributes))

            relight = relit
        view = ModelInPhoto(self._photo, own.mesh, self._fine, pose, relight, request.opacity)
        place = (0.0, 0.0, float(photo.width), float(photo.height))
        picture = draw_look(request.look, view)
        others = tuple((own.scene.objects[i].mesh, own.scene.pose(i, own.at)) for i in own.others)
        if others:
            behind = self._depth_of(others, factor) < depth_image(PlacedModel(own.mesh, pose))
            picture = np.where(behind[..., None], self._photo, picture)
        return Overlay(request, NO_LINES, self._losses, picture, place)

    def _depth_of(self, others: tuple[tuple[Mesh, Pose], ...], factor: float) -> DepthImage:
        """Depth of the nearest object in a photo drawn ``factor`` as large; kept while the others
        stay.
        """
        if self._others != (others, factor):
            placed = [PlacedModel(mesh, pose.scaled(factor)) for mesh, pose in others]
            self._others = others, factor
            self._nearest = np.minimum.reduce([depth_image(one) for one in placed])
        return self._nearest


class SketchDrawer:
    """Sketches the outline alone, as long as a model has no renderer."""

    def __init__(self) -> None:
        self._of: Mesh | None = None
        self._sketch: Sketch | None = None

    def draw(self, request: OverlayRequest) -> Iterator[Overlay]:
        """One drawing, without a loss."""
        mesh = request.document.mesh
        if self._sketch is None or self._of is not mesh:
            self._of, self._sketch = mesh, Sketch(mesh)
        outline = self._sketch.silhouette(request.document.pose)
        yield Overlay(request, outline, Losses())


class OverlayWorkers:
    """Three threads that draw what the session shows: the quick drawing, its loss, the fine one."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._quick: Worker[Overlay] = Worker("overlay", notify)
        self._loss: Worker[Overlay] = Worker("loss", notify)
        self._fine: Worker[Overlay] = Worker("fine overlay", notify)
        self._sketcher = SketchDrawer()
        self._drawers: list[OverlayDrawer] = []
        self._drawers_of: tuple[Mesh, bool] | None = None
        self._drawn: OverlayRequest | None = None
        self._loss_asked = True
        self._moved_at = 0.0

    def _use(self, mesh: Mesh, ready: bool) -> None:
        """Draw another model, each worker with buffers of its own; sketch it until it is ready."""
        if self._drawers_of != (mesh, ready):
            self._drawers_of = mesh, ready
            copies = (renderer_of(mesh).clone() for _ in range(3)) if ready else ()
            self._drawers = [OverlayDrawer(copy) for copy in copies]
            self._drawn, self._loss_asked = None, True

    @property
    def busy(self) -> bool:
        """Whether the quick drawing is under way."""
        return self._quick.busy

    def is_unfinished(self, moving: bool) -> bool:
        """Whether the fine drawing of what is shown is still to be begun."""
        return self._moved_at > 0.0 and not moving and not self._quick.busy

    def follow(self, session: Session) -> None:
        """Begin what is to be drawn by now."""
        look = session.look
        self._use(session.document.mesh, session.preparation is None)
        request = OverlayRequest(session.document, session.compared, look.name, look.opacity)
        # A search finds the losses of its poses itself.
        may_find_loss = self._drawers and not (
            self._loss_asked or self._loss.busy or session.searching
        )
        if self._drawn is None or not _same_picture(request, self._drawn):
            if may_find_loss and self._drawn is not None:
                self._find_loss(self._drawn)
            # One at a time: a drawing that is displaced before it is shown helps nobody.
            if self._quick.busy:
                return
            searches = session.searching and bool(self._drawers)
            if searches and time.monotonic() - self._moved_at < SEARCH_DRAW_S:
                return
            self._drawn, self._moved_at, self._loss_asked = request, time.monotonic(), False
            draw = self._drawers[0].draw if self._drawers else self._sketcher.draw
            self._fine.stop()
            self._quick.start(lambda: islice(draw(replace(request, moving=True)), 1))
            return
        if may_find_loss:
            self._find_loss(request)
        if self.is_unfinished(session.moving) and time.monotonic() - self._moved_at > SETTLED_S:
            self._moved_at = 0.0
            if self._drawers:
                fine = self._drawers[2].draw
                self._fine.start(lambda: _last(fine(request)))

    def take(self) -> Iterator[Edit]:
        """Give what is new since the last call; raises where the model could not be drawn."""
        for worker in (self._quick, self._fine, self._loss):
            update = worker.take()
            if update is None:
                continue
            if update.error is not None:
                if worker is not self._loss:
                    text = f"The model could not be drawn: {update.error}"
                    raise SettingsError(text) from update.error
            elif update.item is not None:
                yield (loss_computed if worker is self._loss else overlay_drawn)(update.item)

    def close(self) -> None:
        """End the threads."""
        for worker in (self._quick, self._loss, self._fine):
            worker.close()

    def _find_loss(self, request: OverlayRequest) -> None:
        """Compute the loss of what is drawn in its own thread: it takes longer."""
        self._loss_asked = True
        draw = self._drawers[1].draw
        self._loss.start(lambda: _last(draw(replace(request, moving=True))))


def _same_picture(one: OverlayRequest, other: OverlayRequest) -> bool:
    looks = (one.look, one.opacity) == (other.look, other.opacity)
    return looks and one.has_loss_of(other)


def _last(overlays: Iterator[Overlay]) -> Iterator[Overlay]:
    """Only the last one: the quick ones are on the page already."""
    yield from deque(overlays, maxlen=1)
