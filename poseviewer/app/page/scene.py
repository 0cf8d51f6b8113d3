"""The middle of the page: the photo, and over it the model, the pins, the rings and the region.

Everything is drawn by the server, in photo coordinates, and lies on planes that the fixed camera
sees at the same place: model and photo coincide under any camera model, as exactly as the loss sees
them, at any zoom.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import viser

from poseviewer.app.page.marks_scene import MarksScene
from poseviewer.app.state.dragging import pins_in_photo, rings_in_photo
from poseviewer.app.state.marking import MARKING
from poseviewer.app.state.session import Overlay, Session
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.rectangle import Rectangle
from poseviewer.render.overlay.looks import HALO_COLOUR, LINE_COLOUR
from poseviewer.vehicle.chart import VehicleChart

DEPTH, SIDE = 20.0, 10.0
"""World units: how far away the photo lies, and how long its longer side is."""
LARGEST_SIDE, LARGEST_SHOWN = 8192, 24_000_000
"""px of a photo's side, and of a photo, beyond which a smaller one is shown."""
PICTURE, HALO, OUTLINE, HANDLES = 0.998, 0.997, 0.996, 0.995
"""Depths of what lies over the photo, in shares of the photo's."""
PIN_COLOURS = ((255, 176, 59), (120, 230, 110), (255, 110, 200))
PIN_LABELS: tuple[tuple[str, Literal["bottom-left", "top-left"]], ...] = (
    ("rear wheel", "bottom-left"),
    ("front wheel", "bottom-left"),
    ("axle", "top-left"),
)
"""And where they lie: the axle's tip may be close to the rear wheel."""
RING_COLOURS = ((255, 95, 87), (110, 220, 90), (88, 150, 255))
REGION_COLOUR = (255, 226, 120)
BOX_COLOUR = (150, 255, 160)
_NO_LINES = np.zeros((1, 2, 3), np.float32)


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
        self._shown: dict[str, Any] = {}
        self._size = (1.0, 1.0)
        self._halo = self._lines("/model/halo", HALO_COLOUR, 4.6)
        self._outline = self._lines("/model/outline", LINE_COLOUR, 2.0)
        self._links = self._lines("/links", (230, 230, 230), 1.2)
        self._region = self._lines("/region", REGION_COLOUR, 1.6)
        self._box = self._lines("/box", BOX_COLOUR, 1.6)
        self._rings = self._lines("/rings", (255, 255, 255), 2.4)
        self._marks = MarksScene(server, self.place)
        self._pins = [self._pin(i) for i in range(3)]
        self._labels = [
            scene.add_label(f"/labels/{i}", text, visible=False, anchor=anchor)
            for i, (text, anchor) in enumerate(PIN_LABELS)
        ]

    def show(self, session: Session) -> None:
        """Bring the page to the session; what has not changed is not sent."""
        drawn = self._shown.get("model")
        with self._server.atomic():
            self._show_photo(session)
            overlay = session.overlay
            registration = session.document.registration
            if overlay is not None and overlay.request.registration.photo is registration.photo:
                self._show_model(overlay, session)
            self._show_pins(session)
            self._show_rings(session)
            self._show_rectangle("region", self._region, session.document.settings.region)
            self._show_rectangle("box", self._box, session.document.marks.box)
            self._marks.show(session)
        if self._shown.get("model") is not drawn:
            # viser gathers messages for a while before it sends them; a drag must not wait.
            self._server.flush()

    def place(self, points: FloatArray, depth: float) -> FloatArray:
        """World points (..., 3) over photo points (..., 2), ``depth`` times as deep as it."""
        unit = SIDE / max(self._size)
        xy = (np.asarray(points, dtype=float) - np.array(self._size) / 2.0) * unit * depth
        return np.concatenate([xy, np.full((*xy.shape[:-1], 1), DEPTH * depth)], axis=-1)

    def _show_photo(self, session: Session) -> None:
        photo = session.document.registration.photo
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
        unit = SIDE / max(self._size)
        if self._photo is not None:
            self._photo.remove()
        self._photo = self._server.scene.add_image(
            "/photo",
            pixels,
            photo.width * unit,
            photo.height * unit,
            format="jpeg",
            jpeg_quality=95,
            cast_shadow=False,
            receive_shadow=False,
            position=(0.0, 0.0, DEPTH),
        )
        if self._picture is not None:
            self._picture.visible = False

    def _show_model(self, overlay: Overlay, session: Session) -> None:
        look = session.look
        hidden = look.hidden or look.name == "none"
        key = (overlay, hidden, look.wipe)
        if self._shown.get("model") == key:
            return
        self._shown["model"] = key
        edge = look.wipe * self._size[0]
        lines = overlay.outline
        lines = lines[(lines[:, :, 0] <= edge).all(axis=1)]
        drawn = not hidden and len(lines) > 0
        for node, depth in ((self._halo, HALO), (self._outline, OUTLINE)):
            if drawn:
                node.points = self.place(lines, depth).astype(np.float32)
            _set(node, "visible", drawn)
        self._show_picture(overlay, hidden, edge)

    def _show_picture(self, overlay: Overlay, hidden: bool, edge: float) -> None:
        left, _, width, _ = overlay.place
        share = 0.0 if width <= 0.0 else min(1.0, (edge - left) / width)
        if overlay.picture is None or hidden or share <= 0.0:
            if self._picture is not None:
                _set(self._picture, "visible", False)
            return
        pixels = overlay.picture
        columns = max(1, round(pixels.shape[1] * share))
        _, top, _, height = overlay.place
        width *= columns / pixels.shape[1]
        unit = SIDE / max(self._size) * PICTURE
        middle = self.place(np.array([left + width / 2.0, top + height / 2.0]), PICTURE)
        pixels = pixels[:, :columns]
        if self._picture is not None and self._shown.get("channels") != pixels.shape[2]:
            self._picture.remove()
            self._picture = None
        if self._picture is None:
            self._shown["channels"] = pixels.shape[2]
            self._picture = self._server.scene.add_image(
                "/model/picture",
                pixels,
                width * unit,
                height * unit,
                format="png" if pixels.shape[2] == 4 else "jpeg",
                jpeg_quality=92,
                cast_shadow=False,
                receive_shadow=False,
                position=tuple(middle),
            )
            return
        self._picture.image = pixels
        self._picture.render_width, self._picture.render_height = width * unit, height * unit
        self._picture.position = tuple(middle)
        _set(self._picture, "visible", True)

    def _show_pins(self, session: Session) -> None:
        document = session.document
        pins = pins_in_photo(document)
        # Of the pose at hand alone, and where presses are for them.
        if session.look.hidden or session.look.before or session.tool in MARKING:
            pins = pins[:0]
        key = pins.tobytes()
        if self._shown.get("pins") == key:
            return
        self._shown["pins"] = key
        vehicle = isinstance(document.chart, VehicleChart) and not document.pins
        for index, (node, label) in enumerate(zip(self._pins, self._labels, strict=True)):
            there = index < len(pins) and bool(np.isfinite(pins[index]).all())
            if there:
                node.position = tuple(self.place(pins[index], HANDLES))
                label.position = tuple(self.place(pins[index], HANDLES))
            _set(node, "visible", there)
            _set(label, "visible", there and vehicle)
        linked = vehicle and len(pins) == 3
        if linked:
            links = np.array([[pins[0], pins[1]], [pins[0], pins[2]]])
            self._links.points = self.place(links, OUTLINE).astype(np.float32)
        _set(self._links, "visible", linked)

    def _show_rings(self, session: Session) -> None:
        shown = session.look.rings and not session.look.hidden
        key = (shown, session.document.pose if shown else None)
        if self._shown.get("rings") == key:
            return
        self._shown["rings"] = key
        if shown:
            rings = rings_in_photo(session.document)
            ends = np.stack([rings[:, :-1], rings[:, 1:]], axis=2)
            near = ends[..., 2].mean(axis=2) <= 0.0
            colours = np.repeat(np.array(RING_COLOURS, float)[:, None], near.shape[1], axis=1)
            colours = np.where(near[..., None], colours, 0.35 * colours)
            places = self.place(ends[..., :2].reshape(-1, 2, 2), HANDLES)
            self._rings.points = places.astype(np.float32)
            shades = np.repeat(colours.reshape(-1, 1, 3), 2, axis=1)
            # Colours of single points are taken to be linear, those of whole lines are not.
            self._rings.colors = np.rint(255.0 * (shades / 255.0) ** 2.2).astype(np.uint8)
        _set(self._rings, "visible", shown)

    def _show_rectangle(self, name: str, lines: Any, rectangle: Rectangle | None) -> None:
        if self._shown.get(name) == (rectangle, self._size):
            return
        self._shown[name] = (rectangle, self._size)
        if rectangle is not None:
            left, top, width, height = rectangle
            right, bottom = left + width, top + height
            corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
            sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            lines.points = self.place(sides, OUTLINE).astype(np.float32)
        _set(lines, "visible", rectangle is not None)

    def _lines(
        self, name: str, colour: tuple[int, int, int], thickness: float
    ) -> viser.LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            name, _NO_LINES, colour, thickness=thickness, thickness_units="screen", visible=False
        )

    def _pin(self, index: int) -> viser.LineSegmentsHandle:
        """A ring with a cross-hair that leaves its middle free; its unit is a px of the screen."""
        angles = np.linspace(0.0, 2.0 * np.pi, 33)
        circle = 11.0 * np.column_stack([np.cos(angles), np.sin(angles)])
        ring = np.stack([circle[:-1], circle[1:]], axis=1)
        hair = np.array([[[-16, 0], [-4, 0]], [[4, 0], [16, 0]]], float)
        strokes = np.concatenate([ring, hair, hair[..., ::-1]])
        points = np.concatenate([strokes, np.zeros((*strokes.shape[:2], 1))], axis=2)
        return self._server.scene.add_line_segments(
            f"/handles/pin{index}",
            points.astype(np.float32),
            PIN_COLOURS[index],
            thickness=2.2,
            thickness_units="screen",
            visible=False,
        )


def _set(node: Any, name: str, value: bool) -> None:
    """Assign where it changes something: every assignment is a message."""
    if getattr(node, name) is not value:
        setattr(node, name, value)
