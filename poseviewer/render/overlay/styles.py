"""The model over the photo, in one of several looks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.overlay.edges import find_lines
from poseviewer.render.overlay.residual import paint_residual
from poseviewer.render.overlay.window import model_window
from poseviewer.render.types import AttributeImage, Renderer

Picture = NDArray[np.uint8]
Relight = Callable[[AttributeImage], FloatArray]

LINE_COLOUR = (0, 232, 255)
"""RGB: a bright cyan, which few things in photos have, on a dark halo."""
HALO_COLOUR = (10, 12, 16)
REFERENCE_SIDE = 1000.0
"""px: longer side of a photo with lines of the widths below; others are in proportion."""
OUTLINE_WIDTH = 1.9
EDGE_WIDTH = 1.0
"""Widths of lines, in px of such a photo."""
HALO_WIDTH = 0.9
"""Width of the halo on either side of a line, in px of such a photo."""
HALO_OPACITY = 0.55
EDGE_STRENGTH = 0.6
"""Opacity of the feature edges beside the silhouette."""
SOLID_OPACITY = 0.8
"""Opacity of the look ``solid``, unless another is asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelInPhoto:
    """A photo, and the model where a pose puts it."""

    photo: Picture
    """(H, W, 3), RGB."""
    mesh: Mesh
    renderer: Renderer
    pose: Pose
    """Its camera has the photo's size."""
    relight: Relight | None = None
    """From attributes in a part of the photo to the relit model (h, w, 1 or 3) in [0, 1], pixel by
    pixel. The looks ``relit`` and ``residual`` need it."""
    opacity: float = SOLID_OPACITY
    """Opacity of the look ``solid``, in [0, 1]."""


def draw_style(name: str, view: ModelInPhoto) -> Picture:
    """Draw the photo (H, W, 3) with the model in a render style, one of ``RENDER_STYLES``."""
    window = None if name == "none" else model_window(view.mesh, view.pose)
    if window is None:
        return view.photo.copy()
    if name == "outline":  # the silhouette, with the feature edges in fainter and thinner lines
        return _draw_lines(view, OUTLINE_WIDTH, EDGE_STRENGTH)
    if name == "edges":
        return _draw_lines(view, EDGE_WIDTH, edge_strength=1.0)
    image = view.renderer.render(window.pose(view.pose))
    part, opacity = window.of_photo(view.pose.camera.width, view.pose.camera.height), 1.0
    match name:
        case "relit":  # as the recovered lighting shows it, in place of what the photo shows there
            colours = _relit(view, image)
        case "residual":  # photo minus relit model, blue to red about white
            relit = _relit(view, image)
            grey = relit @ GREY_WEIGHTS if relit.shape[2] == 3 else relit[..., 0]
            residual = view.photo[part] @ GREY_WEIGHTS - 255.0 * grey
            return paint_residual(view.photo, part, residual, image.mask)
        case "normals":  # red to the right, green upwards, blue towards the camera
            colours = 0.5 + 0.5 * image.normals * np.array([1.0, -1.0, -1.0], np.float32)
            opacity = 0.9
        case "solid":
            # The model's own colours, lit from the camera; black paint must show its shape, too.
            facing = np.clip(-image.normals[..., 2:], 0.0, 1.0)
            colours = (0.3 + 0.7 * image.reflectance) * (0.25 + 0.75 * facing)
            opacity = view.opacity
        case _:
            raise KeyError(name)
    picture = view.photo.copy()
    picture[part] = _mixed(picture[part], colours, opacity * image.mask)
    return picture


def line_scale(width: int, height: int) -> float:
    """Factor by which lines are widened in a photo of this size; never below 1."""
    return max(1.0, max(width, height) / REFERENCE_SIDE)


def _draw_lines(view: ModelInPhoto, outline_width: float, edge_strength: float) -> Picture:
    """Draw the silhouette, ``outline_width`` px wide, and edges of a share of its strength."""
    height, width = view.photo.shape[:2]
    scale = line_scale(width, height)
    lines = find_lines(view.mesh, view.renderer, view.pose, scale)
    picture = view.photo.copy()
    if lines is None:
        return picture
    part = lines.window.of_photo(width, height)
    for colour, opacity, wider in (
        (HALO_COLOUR, HALO_OPACITY, 2.0 * HALO_WIDTH),
        (LINE_COLOUR, 1.0, 0.0),
    ):
        silhouette = lines.outline((outline_width + wider) * scale)
        edges = edge_strength * lines.edges((EDGE_WIDTH + wider) * scale)
        strokes = lines.window.resample(np.maximum(silhouette, edges), width, height)
        picture[part] = _mixed(picture[part], np.array(colour) / 255.0, opacity * strokes)
    return picture


def _mixed(picture: Picture, colour: ArrayLike, opacity: NDArray) -> Picture:
    """``picture`` (h, w, 3) with a colour in [0, 1] over it, of opacity (h, w) in [0, 1]."""
    share = np.asarray(opacity, np.float32)[..., None]
    mixed = picture * (1.0 - share) + np.asarray(colour, np.float32) * (255.0 * share)
    return np.clip(np.rint(mixed), 0.0, 255.0).astype(np.uint8)


def _relit(view: ModelInPhoto, image: AttributeImage) -> FloatArray:
    if view.relight is None:
        raise ValueError("the looks `relit` and `residual` need the recovered lighting")
    return np.clip(view.relight(image), 0.0, 1.0)
