"""The middle of the page: the photo, and over it the model, the pins and the region.

Everything is drawn by the server, in photo coordinates, and lies on planes that the fixed camera
sees at the same place: model and photo coincide under any camera model, as exactly as the loss sees
them, at any zoom.
"""

from __future__ import annotations

from typing import Any, Literal

import cv2
import numpy as np
import viser
from numpy.typing import NDArray

from poseviewer.app.page.above_steps import object_colour
from poseviewer.app.page.controls import set_properties
from poseviewer.app.state.dragging import pins_in_photo
from poseviewer.app.state.hiding import HIDING, found_hidden
from poseviewer.app.state.marking import MARKING, marks_in_photo
from poseviewer.app.state.session import Overlay, Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.overlay.looks import HALO_COLOUR, LINE_COLOUR
from poseviewer.render.structure import bounding_slices
from poseviewer.vehicle.chart import VehicleChart

DEPTH, SIDE = 20.0, 10.0
"""World units: how far away the photo lies, and how long its longer side is."""
LARGEST_SIDE, LARGEST_SHOWN = 8192, 24_000_000
"""px of a photo's side, and of a photo, beyond which a smaller one is shown."""
PICTURE, TINT, OTHERS_HALO, OTHERS = 0.998, 0.9978, 0.9973, 0.9971
HALO, OUTLINE, HANDLES = 0.997, 0.996, 0.995
"""Depths of what lies over the photo, in shares of the photo's."""
MARKS, MARK_LINES = 0.994, 0.9945
"""Depths of a quick start's marks: nearer than all else that is drawn."""
PIN_COLOURS = ((255, 176, 59), (120, 230, 110), (255, 110, 200))
PIN_LABELS: tuple[tuple[str, Literal["bottom-left", "top-left"]], ...] = (
    ("rear wheel", "bottom-left"),
    ("front wheel", "bottom-left"),
    ("axle", "top-left"),
)
"""Text of each pin's label and where it lies: the axle's tip may be close to the rear wheel."""
LINK_COLOUR = (230, 230, 230)
REGION_COLOUR = (255, 226, 120)
BOX_COLOUR = (150, 255, 160)
MARK_COLOUR, MODEL_MARK_COLOUR = (255, 226, 70), (255, 120, 220)
"""RGB of a mark on the photo, and of the model's point that belongs to it."""
HIDDEN_COLOUR, FOUND_COLOUR = (255, 64, 64), (170, 90, 255)
"""RGB of the tint over what was painted, and over what a search took for an occluder."""
HIDDEN_OPACITY, HIDDEN_OPACITY_WHILE_PAINTED = 0.25, 0.5
"""Opacities of these tints."""
LARGEST_TINT = 1_000_000
"""Pixels of the tint; it is drawn smaller where it has more."""
_NO_LINES = np.zeros((1, 2, 3))


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
        camera.position, camera.look_at, camera.up = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0, -1, 0)
        camera.near, camera.far = 1.0, 100.0
        self._photo: viser.ImageHandle | None = None
        self._picture: viser.ImageHandle | None = None
        self._tints: dict[str, viser.ImageHandle] = {}
        self._shown: dict[str, Any] = {}
        self._size = (1.0, 1.0)
        self._halo = self._lines("/model/halo", HALO_COLOUR, 4.6)
        self._outline = self._lines("/model/outline", LINE_COLOUR, 2.0)
        self._links = self._lines("/links", LINK_COLOUR, 1.2)
        self._region = self._lines("/region", REGION_COLOUR, 1.6)
        self._box = self._lines("/box", BOX_COLOUR, 1.6)
        self._pair_lines = self._lines("/marks/lines", MODEL_MARK_COLOUR)
        self._rims = self._lines("/marks/rims", MARK_COLOUR)
        self._others: dict[int, tuple[Any, Any]] = {}
        # Nodes below /handles/ keep their size on the screen, in px: by the client's script.
        self._crosses: list[Any] = []
        self._diamonds: list[Any] = []
        self._numbers: list[Any] = []
        self._pins = [
            self._lines(f"/handles/pin{i}", colour, 2.2, _pin())
            for i, colour in enumerate(PIN_COLOURS)
        ]
        self._labels = [
            scene.add_label(f"/labels/{i}", text, visible=False, anchor=anchor)
            for i, (text, anchor) in enumerate(PIN_LABELS)
        ]

    def show(self, session: Session) -> None:
        """Bring the page to the session; what has not changed is not sent."""
        drawn = self._shown.get("model")
        with self._server.atomic():
            self._show_photo(session)
            self._show_hidden(session)
            overlay = session.overlay
            photo = session.document.photo
            if overlay is not None and overlay.request.document.photo is photo:
                self._show_model(overlay, session)
            self._show_others(session)
            self._show_pins(session)
            self._show_rectangle("region", self._region, session.document.own.region)
            self._show_rectangle("box", self._box, session.shown_box)
            self._show_marks(session)
        if self._shown.get("model") is not drawn:
            # viser gathers messages for a while before it sends them; a drag must not wait.
            self._server.flush()

    def place(self, points: FloatArray, depth: float) -> FloatArray:
        """World points (..., 3) over photo points (..., 2), ``depth`` times as deep as it."""
        unit = SIDE / max(self._size)
        xy = (np.asarray(points, dtype=float) - np.array(self._size) / 2.0) * unit * depth
        return np.concatenate([xy, np.full((*xy.shape[:-1], 1), DEPTH * depth)], axis=-1)

    def _is_new(self, name: str, key: Any) -> bool:
        """Whether what is shown under a name is to be drawn anew."""
        if name in self._shown and self._shown[name] == key:
            return False
        self._shown[name] = key
        return True

    def _show_photo(self, session: Session) -> None:
        photo = session.document.photo
        if self._shown.get("photo") is photo:
            return
        self._shown["photo"] = photo
        self._size = (float(photo.width), float(photo.height))
        factor = min(
            1.0,
            LARGEST_SIDE / max(self._size),
            (LARGEST_SHOWN / (photo.width * photo.height)) ** 0.5,
        )
        width, height = (max(1, round(side * factor)) for side in self._size)
        pixels = photo.as_rgb8(width, height)
        centre = photo.width / 2.0, photo.height / 2.0
        self._photo = self._image(self._photo, "/photo", pixels, centre, self._size, 1.0)
        if self._picture is not None:
            self._picture.visible = False

    def _show_hidden(self, session: Session) -> None:
        """Tints over what does not count: painted, stronger while it is; found by the search."""
        mask, painting = session.document.own.mask, session.tool in HIDING
        opacity = HIDDEN_OPACITY_WHILE_PAINTED if painting else HIDDEN_OPACITY
        if session.photo_alone:
            mask = None
        if self._is_new("hidden", (mask, painting, self._size)):
            hidden = None if mask is None else 1.0 - mask.weights
            self._tint("/hidden/painted", hidden, HIDDEN_COLOUR, opacity)
        ended = None if session.searching else session.search
        end = session.document.object.result
        if self._is_new("found", (ended, end, session.photo_alone, self._size)):
            found = None if session.photo_alone else found_hidden(session)
            shown = None if found is None else found.astype(np.float32)
            self._tint("/hidden/found", shown, FOUND_COLOUR, HIDDEN_OPACITY)

    def _tint(
        self,
        name: str,
        hidden: NDArray[np.float32] | None,
        colour: tuple[int, int, int],
        opacity: float,
    ) -> None:
        """A colour over what of the photo (height, width) is hidden; None: nowhere."""
        node = self._tints.get(name)
        if hidden is None or not hidden.any():
            if node is not None:
                set_properties(node, visible=False)
            return
        rows, columns = bounding_slices(hidden)
        hidden = hidden[rows, columns]
        height, width = hidden.shape
        share = min(1.0, (LARGEST_TINT / (width * height)) ** 0.5)
        size = max(1, round(width * share)), max(1, round(height * share))
        shown = cv2.resize(hidden, size, interpolation=cv2.INTER_AREA)
        pixels = np.empty((*shown.shape, 4), np.uint8)
        pixels[..., :3] = colour
        pixels[..., 3] = np.rint(255.0 * opacity * shown)
        centre = columns.start + width / 2.0, rows.start + height / 2.0
        self._tints[name] = self._image(node, name, pixels, centre, (width, height), TINT)

    def _image(
        self,
        node: viser.ImageHandle | None,
        name: str,
        pixels: NDArray[np.uint8],
        centre: tuple[float, float],
        size: tuple[float, float],
        depth: float,
    ) -> viser.ImageHandle:
        """The node, made where there is none, with a picture over the photo: ``centre`` and
        ``size`` in its px.
        """
        unit, middle = SIDE / max(self._size) * depth, tuple(self.place(np.array(centre), depth))
        width, height = (side * unit for side in size)
        if node is None:
            return self._server.scene.add_image(
                name,
                pixels,
                width,
                height,
                format="png" if pixels.shape[2] == 4 else "jpeg",
                jpeg_quality=95,
                cast_shadow=False,
                receive_shadow=False,
                position=middle,
            )
        node.image, node.position = pixels, middle
        node.render_width, node.render_height = width, height
        set_properties(node, visible=True)
        return node

    def _show_model(self, overlay: Overlay, session: Session) -> None:
        hidden = _is_hidden(session) or session.look == "none"
        if self._is_new("model", (overlay, hidden)):
            lines = overlay.outline[: 0 if hidden else None]
            self._draw(self._halo, lines, HALO)
            self._draw(self._outline, lines, OUTLINE)
            self._show_picture(overlay, hidden)

    def _show_others(self, session: Session) -> None:
        """The objects that are not picked: outlines in colours of their own."""
        drawn = session.outlines
        objects = session.document.scene.objects
        shown = {int(objects[index].id) for index in session.document.others}
        if session.photo_alone or drawn is None:
            shown = set[int]()
        if not self._is_new("others", (drawn, shown, self._size)):
            return
        for number in shown - self._others.keys():
            self._others[number] = (
                self._lines(f"/others/{number}/halo", HALO_COLOUR, 4.0),
                self._lines(f"/others/{number}/outline", object_colour(number), 1.6),
            )
        for number, (halo, outline) in self._others.items():
            lines = np.zeros((0, 2, 2))
            if drawn is not None and number in shown:
                lines = drawn.lines.get(number, lines)
            self._draw(halo, lines, OTHERS_HALO)
            self._draw(outline, lines, OTHERS)

    def _show_picture(self, overlay: Overlay, hidden: bool) -> None:
        left, top, width, height = overlay.place
        pixels = overlay.picture
        if pixels is None or hidden or width <= 0.0:
            if self._picture is not None:
                set_properties(self._picture, visible=False)
            return
        if self._picture is not None and self._shown.get("channels") != pixels.shape[2]:
            self._picture.remove()
            self._picture = None
        self._shown["channels"] = pixels.shape[2]
        centre = left + width / 2.0, top + height / 2.0
        place = centre, (width, height), PICTURE
        self._picture = self._image(self._picture, "/model/picture", pixels, *place)

    def _show_pins(self, session: Session) -> None:
        document = session.document
        pins = pins_in_photo(document)
        # Of the pose at hand alone, and where presses are for them.
        if _is_hidden(session) or session.tool in (*MARKING, *HIDING):
            pins = pins[:0]
        if not self._is_new("pins", pins.tobytes()):
            return
        vehicle = isinstance(document.chart, VehicleChart) and not document.state.pins
        self._put(self._pins, pins, HANDLES)
        self._put(self._labels, pins if vehicle else pins[:0], HANDLES)
        linked = vehicle and len(pins) == 3
        self._draw(self._links, pins[[[0, 1], [0, 2]]] if linked else pins[:0], OUTLINE)

    def _show_rectangle(self, name: str, node: Any, shown: Rectangle | None) -> None:
        if not self._is_new(name, (shown, self._size)):
            return
        corners = np.zeros((0, 2))
        if shown is not None:
            (left, top, *_), right, bottom = shown, shown.right, shown.bottom
            corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        self._draw(node, _closed(corners), OUTLINE)

    def _show_marks(self, session: Session) -> None:
        """A quick start's marks: crosses where the photo was clicked, diamonds where the pose shows
        the model's points, lines between the two, and the wheels' ellipses.
        """
        tool, document = session.tool, session.document
        on = tool in MARKING and not session.photo_alone
        pairs, wheels = on and tool == "pairs", on and tool == "wheels"
        photo, model = np.zeros((2, 0, 2))
        if on:
            photo = marks_in_photo(document.marks, tool)
        if pairs:
            points = np.array([pair.point for pair in document.marks.pairs]).reshape(-1, 3)
            model = document.pose.project(points)
        rims = _rims(session) if wheels else np.zeros((0, 2, 2))
        key = (photo.tobytes(), model.tobytes(), rims.tobytes(), tool, self._size)
        if not self._is_new("marks", key):
            return
        for nodes, places, name, colour, shape in (
            (self._crosses, photo, "mark", MARK_COLOUR, _cross()),
            (self._diamonds, model, "meant", MODEL_MARK_COLOUR, _diamond()),
        ):
            while len(nodes) < len(places):
                nodes.append(self._lines(f"/handles/{name}{len(nodes)}", colour, points=shape))
            self._put(nodes, places, MARKS)
        while len(self._numbers) < len(photo) and pairs:
            number = str(len(self._numbers) + 1)
            label = self._server.scene.add_label(
                f"/labels/mark{number}", number, anchor="bottom-left"
            )
            self._numbers.append(label)
        self._put(self._numbers, photo if pairs else photo[:0], MARKS)
        self._draw(self._rims, rims, MARK_LINES)
        done = np.stack([photo, model[: len(photo)]], axis=1) if pairs else np.zeros((0, 2, 2))
        self._draw(self._pair_lines, done, MARK_LINES)

    def _put(self, nodes: list[Any], places: FloatArray, depth: float) -> None:
        """A node at each place (n, 2); nodes left over, or whose place is nowhere, are hidden."""
        for index, node in enumerate(nodes):
            there = index < len(places) and bool(np.isfinite(places[index]).all())
            if there:
                node.position = tuple(self.place(places[index], depth))
            set_properties(node, visible=there)

    def _draw(self, node: Any, lines: FloatArray, depth: float) -> None:
        """Segments (n, 2, 2), but for those with an end nowhere; none hide the node."""
        lines = np.asarray(lines, dtype=float).reshape(-1, 2, 2)
        lines = lines[np.isfinite(lines).all(axis=(1, 2))]
        if len(lines):
            node.points = self.place(lines, depth).astype(np.float32)
        set_properties(node, visible=len(lines) > 0)

    def _lines(
        self,
        name: str,
        colour: tuple[int, int, int],
        thickness: float = 2.0,
        points: FloatArray = _NO_LINES,
    ) -> viser.LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            name,
            points.astype(np.float32),
            colour,
            thickness=thickness,
            thickness_units="screen",
            visible=False,
        )


def _is_hidden(session: Session) -> bool:
    """Whether the picked object is not to be seen."""
    return session.photo_alone or session.document.object.hidden


def _rims(session: Session) -> FloatArray:
    """(k, 2, 2): the outlines of the wheels that have their points."""
    try:
        outlines = [_closed(ellipse.outline()) for ellipse in session.document.marks.ellipses]
    except QuickStartError:
        outlines = []
    return np.concatenate([np.zeros((0, 2, 2)), *outlines])


def _closed(corners: FloatArray) -> FloatArray:
    """(n, 2, d): the sides of a polygon (n, d)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _cross(inner: float = 2.0, outer: float = 8.0) -> FloatArray:
    """(4, 2, 3): arms that leave the middle free; the unit is a px of the screen."""
    ways = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    return np.stack([inner * ways, outer * ways], axis=1)


def _diamond() -> FloatArray:
    """(4, 2, 3)."""
    return _closed(5.0 * np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]]))


def _pin() -> FloatArray:
    """(n, 2, 3): a ring with a cross-hair that leaves its middle free."""
    angles = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    ring = 11.0 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(32)])
    return np.concatenate([_closed(ring), _cross(4.0, 16.0)])
