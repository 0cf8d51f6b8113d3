"""The model drawn over the photo, and its loss there: at once while it moves, finely at rest."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.commands import LossComputed, OverlayDrawn
from poseviewer.app.state.photo_set import PhotoSet
from poseviewer.app.state.session import Overlay, OverlayRequest, Session
from poseviewer.app.workers.jobs import compared_of
from poseviewer.app.workers.worker import Worker
from poseviewer.errors import PoseViewerError
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.loss import worst_registration_loss
from poseviewer.fit.problem import loss_of, make_photo_attributes, shown_attributes
from poseviewer.fit.registration import PlacedModel
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
from poseviewer.starts.view_set import require_several

if TYPE_CHECKING:  # numba takes a quarter of a second
    from poseviewer.render.software.renderer import SoftwareRenderer

LARGEST_PICTURE = 2_000_000
"""Pixels of a drawn picture; of larger photos it is drawn smaller."""
SEARCH_DRAW_S = 0.1
"""A search is drawn no oftener: the processor is for the search."""
SETTLED_S = 0.15
"""After so long without motion the fine drawing is begun."""


class OverlayDrawer:
    """Draws one model after another, for one thread; keeps what takes time to make."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        # A renderer keeps what helps with the next picture of the same size: one for each size.
        self._quick, self._fine, self._loss = renderer, renderer.clone(), renderer.clone()
        self._last_loss: Unexplained | None = None
        self._start_loss: float | None = None
        self._anchored: OverlayRequest | None = None
        self._attributes: PhotoAttributes | None = None
        self._compared: dict[int, PhotoAttributes] = {}
        self._of_photos: dict[int, Unexplained] = {}
        self._note = ""
        self._shown_photo: object = None
        self._photo = np.zeros((0, 0, 3), np.uint8)
        self._others: tuple[tuple[PlacedModel, ...], float] = ((), 1.0)
        self._nearest = np.zeros((0, 0), np.float32)

    def draw(self, request: OverlayRequest) -> Iterator[Overlay]:
        """A quick drawing, the same with the loss, and, unless the model is moving, a fine one."""
        lines = request.look in ("outline", "edges")
        quick = self._overlay(request)
        if lines:
            mesh, pose = request.registration.mesh, request.pose
            quick = replace(quick, outline=quick_silhouette(mesh, self._quick, pose))
            if request.moving:
                yield replace(quick, loss_is_current=False)
        self._last_loss = self._find_loss(request)
        if lines or request.look == "none":
            yield self._overlay(request, quick.outline)
            if lines and not request.moving:
                yield self._fine_lines(request)
        else:
            yield self._picture(request)

    def _overlay(
        self,
        request: OverlayRequest,
        outline: FloatArray | None = None,
        picture: NDArray[np.uint8] | None = None,
        place: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> Overlay:
        outline = np.zeros((0, 2, 2)) if outline is None else outline
        known = self._last_loss
        return Overlay(
            request,
            outline,
            picture,
            place,
            known,
            self._note,
            start_loss=self._start_loss,
            of_photos=self._of_photos,
        )

    def _find_loss(self, request: OverlayRequest) -> Unexplained | None:
        if self._anchored is None or not request.compares_same(self._anchored):
            self._anchored, self._attributes, self._note = request, None, ""
            self._start_loss, self._compared = None, {}
            about = replace(request.registration, start=request.anchor)
            views = None if request.document is None else request.document.views
            try:
                if views is None:
                    self._attributes = make_photo_attributes(about, request.settings)
                else:
                    self._compared = self._compare_set(request, views)
                    self._attributes = self._compared.get(views.at)
            except PoseViewerError as error:
                self._note = str(error)
            else:
                self._start_loss = self._read_all(request, request.anchor).loss
        if self._start_loss is None:
            return None
        return self._read_all(request, request.pose)

    def _compare_set(self, request: OverlayRequest, views: PhotoSet) -> dict[int, PhotoAttributes]:
        """The photos of a set that are compared, about the anchor."""
        assert request.document is not None  # whose set it is
        anchors = views.views.posed(views.at, request.anchor, views.scale)
        found = compared_of(request.document, anchors)
        require_several(views.views, [views.names[index] for index in found])
        settings = replace(request.settings, region=None)
        made = {i: make_photo_attributes(one, settings) for i, one in found.items()}
        if len({LossScale.of(photo) for photo in made.values()}) > 1:  # one is grey: then all are
            settings = replace(settings, grey=True)
            made = {i: make_photo_attributes(one, settings) for i, one in found.items()}
        return made

    def _read_all(self, request: OverlayRequest, pose: Pose) -> Unexplained:
        """The loss at a pose; of a set, the mean over its photos."""
        if request.document is None or request.document.views is None:
            assert self._attributes is not None  # who reads has made it
            return self._read(self._attributes, request, pose)
        views = request.document.views
        poses = views.views.posed(views.at, pose, views.scale)
        self._of_photos = {
            index: self._read(photo, request, poses[index])
            for index, photo in self._compared.items()
        }
        return mean_over(tuple(self._of_photos.values()))

    def _read(self, photo: PhotoAttributes, request: OverlayRequest, pose: Pose) -> Unexplained:
        if not pose.camera_from_model.apply(request.registration.mesh.centre)[2] > 0.0:
            return Unexplained(LossScale.of(photo), worst_registration_loss(photo))
        moments = self._loss.moments(pose, photo)
        return LossScale.of(photo).read(loss_of(request.settings.method, moments, photo), moments)

    def _fine_lines(self, request: OverlayRequest) -> Overlay:
        camera = request.pose.camera
        scale = line_scale(camera.width, camera.height)
        lines = find_lines(request.registration.mesh, self._fine, request.pose, scale)
        if lines is None:
            return self._overlay(request)
        left, top, width, height = (
            float(getattr(lines.window, side)) for side in ("left", "top", "width", "height")
        )
        outline = silhouette(lines.covered, lines.window)
        return self._overlay(request, outline, edge_layer(lines, scale), (left, top, width, height))

    def _picture(self, request: OverlayRequest) -> Overlay:
        photo = request.registration.photo
        factor = min(1.0, (LARGEST_PICTURE / (photo.width * photo.height)) ** 0.5)
        pose = request.pose.scaled(factor)
        size = (pose.camera.height, pose.camera.width)
        if self._shown_photo is not photo or self._photo.shape[:2] != size:
            self._shown_photo, self._photo = photo, photo.as_rgb8(size[1], size[0])
        relight: Relight | None = None
        if request.look in ("relit", "residual"):
            if self._attributes is None:
                return self._overlay(request)
            attributes = shown_attributes(self._attributes)
            lighting = recover_lighting(self._loss.moments(request.pose, attributes))

            def relit(image: AttributeImage) -> FloatArray:
                return lighting.apply(model_attributes(image, attributes))

            relight = relit
        mesh = request.registration.mesh
        view = ModelInPhoto(self._photo, mesh, self._fine, pose, relight, request.opacity)
        place = (0.0, 0.0, float(photo.width), float(photo.height))
        picture = draw_look(request.look, view)
        others = request.registration.others
        if others:
            behind = self._depth_of(others, factor) < depth_image(PlacedModel(mesh, pose))
            picture = np.where(behind[..., None], self._photo, picture)
        return self._overlay(request, None, picture, place)

    def _depth_of(self, others: tuple[PlacedModel, ...], factor: float) -> DepthImage:
        """Depth of the nearest object in a photo drawn ``factor`` as large; kept while the others
        stay.
        """
        if self._others != (others, factor):
            placed = [PlacedModel(one.mesh, one.pose.scaled(factor)) for one in others]
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
        mesh = request.registration.mesh
        if self._sketch is None or self._of is not mesh:
            self._of, self._sketch = mesh, Sketch(mesh)
        outline = self._sketch.silhouette(request.pose)
        yield Overlay(request, outline, None, (0.0, 0.0, 0.0, 0.0), None)


class OverlayWorkers:
    """Three threads that draw what the session shows: the quick drawing, its loss, the fine one."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._quick: Worker[Overlay] = Worker("overlay", notify)
        self._loss: Worker[Overlay] = Worker("loss", notify)
        self._fine: Worker[Overlay] = Worker("fine overlay", notify)
        self._sketcher = SketchDrawer()
        self._drawers: list[OverlayDrawer] = []
        self._drawn: OverlayRequest | None = None
        self._loss_asked = True
        self._moved_at = 0.0

    def use(self, renderer: SoftwareRenderer | None) -> None:
        """Draw another model; every worker with buffers of its own. None: sketch it meanwhile."""
        copies = () if renderer is None else (renderer.clone() for _ in range(3))
        self._drawers = [OverlayDrawer(copy) for copy in copies]
        self._drawn, self._loss_asked = None, True

    @property
    def busy(self) -> bool:
        """Whether the quick drawing is under way."""
        return self._quick.busy

    def is_unfinished(self, moving: bool) -> bool:
        """Whether the fine drawing of what is shown is still to be begun."""
        return self._moved_at > 0.0 and not moving and not self._quick.busy

    def start(self, session: Session, moving: bool) -> None:
        """Begin what is to be drawn by now."""
        document, look = session.document, session.look
        request = OverlayRequest(
            document.registration,
            document.settings,
            document.pose,
            session.anchor or document.pose,
            look.name,
            look.opacity,
            document=None if document.views is None else document,
        )
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
        if self.is_unfinished(moving) and time.monotonic() - self._moved_at > SETTLED_S:
            self._moved_at = 0.0
            if self._drawers:
                fine = self._drawers[2].draw
                self._fine.start(lambda: _last(fine(request)))

    def take(
        self, session: Session, show_error: Callable[[str], None]
    ) -> Iterator[OverlayDrawn | LossComputed]:
        """Give what is new since the last call, of the photo and the model at hand."""
        for worker in (self._quick, self._fine, self._loss):
            update = worker.take()
            if update is None:
                continue
            if update.error is not None:
                if worker is not self._loss:
                    show_error(f"The model could not be drawn: {update.error}")
            elif update.item is not None and _shows_same(update.item.request, session):
                yield (LossComputed if worker is self._loss else OverlayDrawn)(update.item)

    def close(self) -> None:
        """End the threads."""
        for worker in (self._quick, self._loss, self._fine):
            worker.close()

    def _find_loss(self, request: OverlayRequest) -> None:
        """Compute the loss of what is drawn in its own thread: it takes longer."""
        self._loss_asked = True
        draw = self._drawers[1].draw
        self._loss.start(lambda: _last(draw(replace(request, moving=True))))


def _shows_same(request: OverlayRequest, session: Session) -> bool:
    own, its = request.registration, session.document.registration
    return own.photo is its.photo and own.mesh is its.mesh


def _same_picture(one: OverlayRequest, other: OverlayRequest) -> bool:
    looks = (one.look, one.opacity) == (other.look, other.opacity)
    return looks and one.has_loss_of(other)


def _last(overlays: Iterator[Overlay]) -> Iterator[Overlay]:
    """Only the last one: the quick ones are on the page already."""
    yield from deque(overlays, maxlen=1)
