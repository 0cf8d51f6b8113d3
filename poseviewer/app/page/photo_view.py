"""The middle of the page: the photo, and over it tints and the model.

Everything is drawn by the server, in photo coordinates, and lies on planes that the fixed camera
sees at the same place: model and photo coincide under any camera model, as exactly as the loss sees
them, at any zoom.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import viser
from numpy.typing import NDArray

from poseviewer.app.page.above_steps import object_colour
from poseviewer.app.page.controls import memoize, set_properties
from poseviewer.app.state.document import is_shown
from poseviewer.app.state.hiding import HIDING, masks_of, occlusion_pixels
from poseviewer.app.state.session import Session
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import size_at_scale
from poseviewer.geometry.image import Photo
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.overlay.styles import HALO_COLOUR
from poseviewer.render.structure import bounding_slices

Colour = tuple[int, int, int]
Picture = tuple[NDArray[np.uint8], Rectangle]
"""Pixels (h, w, 3 or 4), and where they lie in the photo."""
DEPTH = 20.0
"""Distance of the photo, world units."""
SIDE = 10.0
"""Length of the photo's longer side, world units."""
MAX_SIDE_PX = 8192
"""Longest side of a shown photo, px; larger photos are shown smaller."""
MAX_SHOWN_PX = 24_000_000
"""Most pixels of a shown photo; larger photos are shown smaller."""
PICTURE = 0.998
TINT = 0.9978
OTHERS_HALO = 0.9973
OTHERS = 0.9971
EDGES = 0.9975
HALO = 0.997
OUTLINE = 0.996
"""Depths of the layers over the photo, from ``PICTURE`` on, as fractions of ``DEPTH``."""
HIDDEN_COLOUR = 255, 64, 64
"""RGB of the tint over painted pixels."""
FOUND_COLOUR = 170, 90, 255
"""RGB of the tint over pixels that a search took for an occluder."""
HIDDEN_OPACITY = 0.25
"""Opacity of these tints."""
HIDDEN_OPACITY_WHILE_PAINTED = 0.5
"""Opacity of the tint over painted pixels while a hiding tool is active."""
MAX_TINT_PIXELS = 1_000_000
"""Pixels of the tint; it is drawn smaller where it has more."""
OUTLINE_NAME = "/model/outline"


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """Lines or a picture over the photo."""

    name: str
    depth: float
    content: NDArray[Any]
    """(n, 2, 2): line segments, px of the photo; or a picture's pixels (h, w, 3 or 4)."""
    rectangle: Rectangle | None = None
    """Part of the photo that a picture covers; None for lines."""
    colour: Colour = HALO_COLOUR
    thickness: float = 2.0
    """Width of lines, px of the screen."""


class PhotoScene:
    """The scene's nodes, shared by all pages."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        scene = server.scene
        scene.set_up_direction("-y")
        scene.world_axes.visible = False
        # The model is lit by the server; lights here would only cost frames.
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map(hdri=None)
        scene.set_background_image(np.full((2, 2, 3), (22, 24, 29), np.uint8))
        camera = server.initial_camera
        camera.position = (0.0, 0.0, 0.0)
        camera.look_at = (0.0, 0.0, 1.0)
        camera.up = (0, -1, 0)
        camera.near, camera.far = 1.0, 100.0
        self._nodes: dict[str, Any] = {}
        self._shown: dict[str, Any] = {}
        """Content of each node, for the photo that is shown."""
        self._photo: Photo | None = None
        self._pixels = memoize(lambda s: (s.document.photo,), _photo_pixels)
        self._painted = memoize(
            lambda s: (*masks_of(s), s.document.settings.in_front, s.tool in HIDING), _mask_tint
        )
        self._found = memoize(
            lambda s: (
                not s.is_searching and s.search,
                s.document.object.result,
                s.document.view_index,
                s.document.occluders,
            ),
            lambda s: _tint(occlusion_pixels(s), FOUND_COLOUR, HIDDEN_OPACITY),
        )

    def show(self, session: Session) -> None:
        """Bring the page to the session; what has not changed is not sent."""
        photo = session.document.photo
        if photo is not self._photo:
            self._photo = photo
            self._shown.clear()
        outline = self._shown.get(OUTLINE_NAME)
        drawings = {drawing.name: drawing for drawing in self._drawings(session)}
        with self._server.atomic():
            for name in self._nodes.keys() - drawings.keys():
                set_properties(self._nodes[name], visible=False)
            for name, drawing in drawings.items():
                if name not in self._nodes:
                    self._nodes[name] = self._make_node(drawing)
                shown, content = self._shown.get(name), drawing.content
                if shown is not content:
                    self._shown[name] = content
                    if shown is None or drawing.rectangle or not np.array_equal(shown, content):
                        _draw(self._nodes[name], drawing, photo)
                if drawing.rectangle is None:
                    self._nodes[name].colors = np.array(drawing.colour, np.uint8)
                set_properties(self._nodes[name], visible=len(content) > 0)
        if self._shown.get(OUTLINE_NAME) is not outline:
            # viser gathers messages for a while before it sends them; a drag must not wait.
            self._server.flush()

    def _make_node(self, drawing: Drawing) -> Any:
        """A hidden node for a drawing."""
        scene, name = self._server.scene, drawing.name
        shown: dict[str, Any] = {"visible": False}
        if drawing.rectangle is not None:
            shown |= {"jpeg_quality": 95, "cast_shadow": False, "receive_shadow": False}
            return scene.add_image(name, np.zeros((1, 1, 3), np.uint8), 1.0, 1.0, **shown)
        shown |= {"thickness": drawing.thickness, "thickness_units": "screen"}
        points = np.zeros((1, 2, 3), np.float32)
        return scene.add_line_segments(name, points, drawing.colour, **shown)

    def _drawings(self, session: Session) -> Iterator[Drawing]:
        """Everything that is to be seen."""
        yield Drawing("/photo", 1.0, *self._pixels(session))
        if session.display.photo_alone:
            return
        if any(masks_of(session)):
            yield Drawing("/hidden/painted", TINT, *self._painted(session))
        yield Drawing("/hidden/found", TINT, *self._found(session))
        yield from _other_objects(session)
        if is_shown(session.document.object):
            yield from _model(session)


def _draw(node: Any, drawing: Drawing, photo: Photo) -> None:
    """Bring a node to its drawing over the photo."""
    part, depth = drawing.rectangle, drawing.depth
    if part is not None:
        corners = np.array([[part.left, part.top], [part.right, part.bottom]])
        (left, top, _), (right, bottom, _) = corners = over_photo(corners, photo, depth)
        node.image, node.position = drawing.content, tuple(corners.mean(axis=0))
        node.render_width, node.render_height = right - left, bottom - top
    elif len(drawing.content):
        node.points = over_photo(drawing.content, photo, depth).astype(np.float32)


def over_photo(points: FloatArray, photo: Photo, depth: float) -> FloatArray:
    """World points (..., 3) over photo points (..., 2), ``depth`` times as deep as it."""
    unit = SIDE / max(photo.width, photo.height)
    xy = (points - np.array([photo.width, photo.height]) / 2.0) * unit * depth
    return np.concatenate([xy, np.full((*xy.shape[:-1], 1), DEPTH * depth)], axis=-1)


def _photo_pixels(session: Session) -> Picture:
    """The photo, smaller where it is larger than browsers show."""
    photo = session.document.photo
    sides = photo.width, photo.height
    share = (MAX_SHOWN_PX / (photo.width * photo.height)) ** 0.5
    factor = min(1.0, MAX_SIDE_PX / max(sides), share)
    return photo.as_rgb8(*size_at_scale(*sides, factor)), Rectangle(0.0, 0.0, *sides)


def _mask_tint(session: Session) -> Picture:
    """A tint over what is painted, stronger while it is."""
    mask, painting = session.document.painted, session.tool in HIDING
    opacity = HIDDEN_OPACITY_WHILE_PAINTED if painting else HIDDEN_OPACITY
    return _tint(None if mask is None else 1.0 - mask.weights, HIDDEN_COLOUR, opacity)


def _tint(hidden: NDArray[Any] | None, colour: Colour, opacity: float) -> Picture:
    """A colour over what of the photo (height, width) is hidden; a clear pixel for nothing."""
    if hidden is None or not hidden.any():
        return np.zeros((1, 1, 4), np.uint8), Rectangle(0.0, 0.0, 1.0, 1.0)
    rows, columns = bounding_slices(hidden)
    hidden = hidden[rows, columns].astype(np.float32)
    height, width = hidden.shape
    share = min(1.0, (MAX_TINT_PIXELS / (width * height)) ** 0.5)
    size = size_at_scale(width, height, share)
    shown = cv2.resize(hidden, size, interpolation=cv2.INTER_AREA)
    pixels = np.empty((*shown.shape, 4), np.uint8)
    pixels[..., :3] = colour
    pixels[..., 3] = np.rint(255.0 * opacity * shown)
    return pixels, Rectangle(columns.start, rows.start, width, height)


def _model(session: Session) -> Iterator[Drawing]:
    """The active object as drawn: its outline, and a picture."""
    overlay = session.results.overlay
    if overlay is None or session.display.style == "none":
        return
    if not overlay.document.object.is_placed:
        return  # it was drawn where the model was put first
    red, green, blue = colour = object_colour(overlay.document.object_id)
    faint = red * 7 // 12, green * 7 // 12, blue * 7 // 12  # than the outline
    colour = colour if session.document.has_pose else faint
    yield Drawing("/model/halo", HALO, overlay.outline, None, HALO_COLOUR, 4.6)
    yield Drawing("/model/edges", EDGES, overlay.edges, None, faint, 1.0)
    yield Drawing(OUTLINE_NAME, OUTLINE, overlay.outline, None, colour)
    if overlay.picture is not None:
        photo = session.document.photo
        part = Rectangle(0.0, 0.0, photo.width, photo.height)
        yield Drawing("/model/picture", PICTURE, overlay.picture, part)


def _other_objects(session: Session) -> Iterator[Drawing]:
    """The objects that are not active: outlines in colours of their own."""
    outlines = {} if session.results.outlines is None else session.results.outlines.large
    for index in session.document.others:
        number = int(session.document.scene.objects[index].id)
        if number in outlines:
            name, lines = f"/others/{number}", outlines[number]
            yield Drawing(f"{name}/halo", OTHERS_HALO, lines, None, HALO_COLOUR, 4.0)
            yield Drawing(f"{name}/outline", OTHERS, lines, None, object_colour(number), 1.6)
