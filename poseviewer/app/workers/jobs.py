"""What runs beside the session: drawing, search and maps, as generators of news."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from poseviewer.api import Case, make_case
from poseviewer.app.state.session import LandscapeUpdate, Overlay, OverlayRequest, SearchUpdate
from poseviewer.errors import PoseViewerError
from poseviewer.fit.landscape import Slice, strides
from poseviewer.fit.lighting import recover_lighting
from poseviewer.fit.loss import registration_loss
from poseviewer.fit.problem import FitProgress, make_photo_attributes, shown_attributes
from poseviewer.fit.registration import Registration
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.render.moments import model_attributes
from poseviewer.render.overlay.contour import quick_silhouette, silhouette
from poseviewer.render.overlay.edges import find_lines
from poseviewer.render.overlay.looks import Relight, View, draw_look, edge_layer, line_scale
from poseviewer.render.pool import RendererPool, processors
from poseviewer.render.software.renderer import SoftwareRenderer
from poseviewer.render.types import AttributeImage, PhotoAttributes, Renderer

LARGEST_PICTURE = 2_000_000
"""Pixels of a drawn picture; of larger photos it is drawn smaller."""


class OverlayDrawer:
    """Draws one model after another, for one thread; keeps what takes time to make."""

    def __init__(self, renderer: SoftwareRenderer) -> None:
        # A renderer keeps what helps with the next picture of the same size: one for each size.
        self._renderer, self._close, self._weigher = renderer, renderer.clone(), renderer.clone()
        self._last_loss: float | None = None
        self._anchored: tuple[object, ...] = ()
        self._attributes: PhotoAttributes | None = None
        self._note = ""
        self._shown: tuple[object, float] = (None, 0.0)
        self._photo = np.zeros((0, 0, 3), np.uint8)

    def paint(self, request: OverlayRequest) -> Iterator[Overlay]:
        """A quick drawing, the same with the loss, and, unless the model is moving, a fine one."""
        quick = self._painting(request, self._last_loss)
        if request.look in ("outline", "edges"):
            mesh, pose = request.registration.mesh, request.pose
            quick = replace(quick, outline=quick_silhouette(mesh, self._renderer, pose))
            if request.moving:
                yield replace(quick, loss_is_current=False)
        loss = self._last_loss = self._loss(request)
        quick = replace(quick, loss=loss, note=self._note)
        if request.look in ("outline", "edges", "none"):
            yield quick
            if request.look != "none" and not request.moving:
                yield self._fine_lines(request, loss)
        else:
            yield self._picture(request, loss)

    def _painting(
        self,
        request: OverlayRequest,
        loss: float | None,
        outline: FloatArray | None = None,
        picture: NDArray[np.uint8] | None = None,
        place: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> Overlay:
        lines = np.zeros((0, 2, 2)) if outline is None else outline
        return Overlay(request, lines, picture, place, loss, self._note)

    def _loss(self, request: OverlayRequest) -> float | None:
        key = (request.registration.photo, request.registration.mesh, request.settings)
        key = (*key, request.anchor)
        if not _same(key, self._anchored):
            self._anchored, self._attributes, self._note = key, None, ""
            try:
                self._attributes = make_photo_attributes(
                    request.registration.photo,
                    request.registration.mesh,
                    request.anchor,
                    request.settings,
                )
            except PoseViewerError as error:
                self._note = str(error)
        if self._attributes is None:
            return None
        return registration_loss(self._weigher.moments(request.pose, self._attributes))

    def _fine_lines(self, request: OverlayRequest, loss: float | None) -> Overlay:
        camera = request.pose.camera
        scale = line_scale(camera.width, camera.height)
        lines = find_lines(request.registration.mesh, self._close, request.pose, scale)
        if lines is None:
            return self._painting(request, loss)
        window = lines.window
        place = (
            float(window.left),
            float(window.top),
            float(window.width),
            float(window.height),
        )
        outline = silhouette(lines.covered, window)
        return self._painting(request, loss, outline, edge_layer(lines, scale), place)

    def _picture(self, request: OverlayRequest, loss: float | None) -> Overlay:
        photo = request.registration.photo
        factor = min(1.0, (LARGEST_PICTURE / (photo.width * photo.height)) ** 0.5)
        pose = request.pose.scaled(factor)
        size = (pose.camera.height, pose.camera.width)
        if self._shown[0] is not photo or self._photo.shape[:2] != size:
            self._shown, self._photo = (photo, factor), photo.as_rgb8(size[1], size[0])
        relight: Relight | None = None
        if request.look in ("relit", "residual"):
            if self._attributes is None:
                return self._painting(request, loss)
            attributes = shown_attributes(self._attributes)
            lighting = recover_lighting(self._weigher.moments(request.pose, attributes))

            def relit(image: AttributeImage) -> FloatArray:
                return lighting.apply(model_attributes(image, attributes))

            relight = relit

        mesh = request.registration.mesh
        view = View(self._photo, mesh, self._close, pose, relight, request.opacity)
        place = (0.0, 0.0, float(photo.width), float(photo.height))
        return self._painting(request, loss, None, draw_look(request.look, view), place)


def search(
    registration: Registration, pose: Pose, settings: FitSettings, renderer: Renderer
) -> Iterator[SearchUpdate]:
    """News of a search from ``pose``, after every evaluation; on all processors where the search
    knows several poses at a time.

    Raises:
        PoseViewerError: the settings do not go with the photo, the model or the pose.
    """
    case = case_at(registration, pose, settings, renderer)
    improvements: tuple[FitProgress, ...] = ()
    for progress in case.search(threads=processors()):
        if not improvements or progress.loss < improvements[-1].loss:
            improvements = (*improvements, progress)
        yield SearchUpdate(case, progress, improvements)


def maps(
    case: Case,
    centre: Pose,
    pool: RendererPool,
    half_width: float,
    size: int,
    shown: tuple[Slice, ...] = (),
) -> Iterator[LandscapeUpdate]:
    """News of the maps about ``centre``, coarse to fine, whenever a row of one is known.

    Maps that are ``shown`` already, from a coarser picture, stay until the first grid of the new
    one is known.

    Raises:
        PoseViewerError: there are fewer than two free numbers.
    """
    parameters = case.problem.chart.from_pose(centre)
    newest: dict[tuple[int, int], Slice] = {}
    seen = {(piece.first, piece.second): piece for piece in shown}
    first = strides(size)[0]
    known = 0
    count = len(case.problem.free_indices)
    total = count * (count - 1) // 2 * size * size
    for piece in case.slices(centre, half_width=half_width, size=size, pool=pool):
        pair = piece.first, piece.second
        known += _known(piece) - (_known(newest[pair]) if pair in newest else 0)
        newest[pair] = piece
        if pair not in seen or bool(np.isfinite(piece.losses[::first, ::first]).all()):
            seen[pair] = piece
        yield LandscapeUpdate(
            centre, case, parameters, half_width, tuple(seen.values()), known / total
        )


def case_at(
    registration: Registration, pose: Pose, settings: FitSettings, renderer: Renderer
) -> Case:
    """What is open, started from ``pose``.

    Raises:
        PoseViewerError: the settings do not go with the photo, the model or the pose.
    """
    started = replace(registration, start=pose)
    return make_case(started, settings, renderer=renderer)


def _known(piece: Slice) -> int:
    return int(np.isfinite(piece.losses).sum())


def _same(one: tuple[object, ...], other: tuple[object, ...]) -> bool:
    """Whether two tuples hold the very same objects, or equal settings."""
    if len(one) != len(other):
        return False
    return all(
        a is b or (isinstance(a, FitSettings) and a == b) for a, b in zip(one, other, strict=True)
    )
