"""The model over the photo, in one of the looks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.image import GREY_WEIGHTS
from poseviewer.geometry.mesh import Mesh
from poseviewer.render.attributes import AttributeImage, Renderer
from poseviewer.render.overlay.edges import find_lines
from poseviewer.render.overlay.residual import paint_residual
from poseviewer.render.overlay.window import model_window

Picture = NDArray[np.uint8]
"""(height, width, 3): RGB."""
Relight = Callable[[AttributeImage], FloatArray]
"""Function from attributes (h, w) to colours (h, w, 1 or 3) in [0, 1], in the photo's light."""

LINE_COLOUR = (0, 232, 255)
"""RGB of lines, in [0, 255]: a bright cyan, which few things in photos have."""
HALO_COLOUR = (10, 12, 16)
"""RGB of the halo beside lines, in [0, 255]: dark, so that lines show on bright photos, too."""
REFERENCE_SIDE = 1000.0
"""Longer side, in px, of a photo with lines of the widths below; others are in proportion."""
OUTLINE_WIDTH = 1.9
"""Width of the silhouette's line, in px at ``REFERENCE_SIDE``."""
EDGE_WIDTH = 1.0
"""Width of a feature edge's line, in px at ``REFERENCE_SIDE``."""
HALO_WIDTH = 0.9
"""Width of the halo on either side of a line, in px at ``REFERENCE_SIDE``."""
HALO_OPACITY = 0.55
"""Opacity of the halo: the photo must show through."""
EDGE_STRENGTH = 0.6
"""Opacity of feature edges, over that of the silhouette, which they must not outshine."""
SOLID_OPACITY = 1.0
"""Default opacity of the style ``solid``: only an opaque model shows its shape as it is."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelInPhoto:
    """A photo with a model at a pose."""

    photo: Picture
    """(H, W, 3), RGB."""
    mesh: Mesh
    renderer: Renderer
    pose: Pose
    """Pose of the model; its camera has the photo's size."""
    relight: Relight | None = None
    """Relighting of the model, for looks that need the light."""
    opacity: float = SOLID_OPACITY
    """Opacity of the style ``solid``, in [0, 1]."""


def draw_style(name: str, view: ModelInPhoto) -> Picture:
    """Draw the photo (H, W, 3) with the model in a look, one of ``LOOKS``."""
    window = None if name == "none" else model_window(view.mesh, view.pose)
    if window is None:
        return view.photo.copy()
    if name == "outline":  # the silhouette, with feature edges in fainter and thinner lines
        return _draw_lines(view, OUTLINE_WIDTH, EDGE_STRENGTH)
    if name == "edges":
        return _draw_lines(view, EDGE_WIDTH, edge_strength=1.0)
    image = view.renderer.render(window.pose(view.pose))
    part, opacity = window.of_photo(view.pose.camera.width, view.pose.camera.height), 1.0
    match name:
        case "relit":  # the model in the recovered light, in place of the photo
            colours = _relight(view, image)
        case "residual":  # photo minus relit model, blue to red about white
            relit = _relight(view, image)
            grey = relit @ GREY_WEIGHTS if relit.shape[2] == 3 else relit[..., 0]
            residual = view.photo[part] @ GREY_WEIGHTS - 255.0 * grey
            return paint_residual(view.photo, part, residual, image.mask)
        case "normals":  # red to the right, green upwards, blue towards the camera
            colours = 0.5 + 0.5 * image.normals * np.array([1.0, -1.0, -1.0], np.float32)
            opacity = 0.9
        case "solid":
            # The model's colours, lit from the camera; black paint must show its shape, too.
            facing = np.clip(-image.normals[..., 2:], 0.0, 1.0)
            colours = (0.3 + 0.7 * image.reflectance) * (0.25 + 0.75 * facing)
            opacity = view.opacity
        case _:
            raise KeyError(name)
    picture = view.photo.copy()
    picture[part] = _blend_colour(picture[part], colours, opacity * image.mask)
    return picture


def line_scale(width: int, height: int) -> float:
    """Return the factor, 1 or more, by which lines are wider in a photo of this size."""
    return max(1.0, max(width, height) / REFERENCE_SIDE)


def _draw_lines(view: ModelInPhoto, outline_width: float, edge_strength: float) -> Picture:
    """Draw the silhouette, ``outline_width`` px wide, and feature edges of ``edge_strength``."""
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
        picture[part] = _blend_colour(picture[part], np.array(colour) / 255.0, opacity * strokes)
    return picture


def _blend_colour(picture: Picture, colour: ArrayLike, opacity: NDArray) -> Picture:
    """Blend a picture (h, w, 3) with a colour in [0, 1], by opacity (h, w) in [0, 1]."""
    share = np.asarray(opacity, np.float32)[..., None]
    mixed = picture * (1.0 - share) + np.asarray(colour, np.float32) * (255.0 * share)
    return np.clip(np.rint(mixed), 0.0, 255.0).astype(np.uint8)


def _relight(view: ModelInPhoto, image: AttributeImage) -> FloatArray:
    if view.relight is None:
        raise ValueError("the styles relit and residual need the recovered lighting")
    return np.clip(view.relight(image), 0.0, 1.0)
