"""The marks of a quick start, as they lie over the photo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from poseviewer.app.state.marking import MARKING, marks_in_photo
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray

DEPTH, LINES = 0.994, 0.9945
"""Depths, in shares of the photo's: nearer than all else that is drawn."""
PHOTO_COLOUR, MODEL_COLOUR, RIM_COLOUR = (255, 226, 70), (255, 120, 220), (255, 226, 70)
ARM_PX = 8.0
"""Of a mark's cross, px of the screen."""
_NONE = np.zeros((1, 2, 3), np.float32)


class MarksScene:
    """Crosses where the photo was clicked, diamonds where the pose shows the model's points, lines
    between the two, and the wheels' ellipses.
    """

    def __init__(
        self, server: viser.ViserServer, place: Callable[[FloatArray, float], FloatArray]
    ) -> None:
        """``place``: world points over photo points, as ``PhotoScene.place``."""
        self._scene = server.scene
        self._place = place
        self._crosses: list[Any] = []
        self._diamonds: list[Any] = []
        self._labels: list[Any] = []
        self._lines = self._segments("/marks/lines", MODEL_COLOUR)
        self._rims = self._segments("/marks/rims", RIM_COLOUR)
        self._shown: tuple[bytes, ...] = ()

    def show(self, session: Session) -> None:
        """Bring the marks to the session; none where no marks are being set."""
        tool, document = session.tool, session.document
        on = tool in MARKING and not session.look.hidden
        photo = marks_in_photo(document.marks, tool) if on else np.zeros((0, 2))
        model = np.zeros((0, 2))
        if on and tool == "pairs":
            points = np.array([pair.point for pair in document.marks.pairs]).reshape(-1, 3)
            model = document.pose.project(points)
        rims = _ellipse_lines(session) if on and tool == "wheels" else np.zeros((0, 2, 2))
        size = document.registration.photo.width, document.registration.photo.height
        key = (photo.tobytes(), model.tobytes(), rims.tobytes(), repr((tool, size)).encode())
        if key == self._shown:
            return
        self._shown = key
        self._put(self._crosses, photo, "/handles/mark", PHOTO_COLOUR, _cross())
        self._put(self._diamonds, model, "/handles/meant", MODEL_COLOUR, _diamond())
        self._number(photo if tool == "pairs" else photo[:0])
        self._draw(self._rims, rims)
        self._draw(
            self._lines, np.stack([photo, model[: len(photo)]], axis=1) if len(model) else []
        )

    def _put(
        self, nodes: list[Any], places: FloatArray, name: str, colour: Any, shape: Any
    ) -> None:
        """One node at each place; those that are not needed are hidden."""
        while len(nodes) < len(places):
            nodes.append(self._segments(f"{name}{len(nodes)}", colour, shape))
        for index, node in enumerate(nodes):
            there = index < len(places) and bool(np.isfinite(places[index]).all())
            if there:
                node.position = tuple(self._place(places[index], DEPTH))
            node.visible = there

    def _number(self, places: FloatArray) -> None:
        while len(self._labels) < len(places):
            number = len(self._labels) + 1
            self._labels.append(
                self._scene.add_label(f"/labels/mark{number}", str(number), anchor="bottom-left")
            )
        for index, label in enumerate(self._labels):
            label.visible = index < len(places)
            if index < len(places):
                label.position = tuple(self._place(places[index], DEPTH))

    def _draw(self, node: Any, lines: Any) -> None:
        lines = np.asarray(lines, dtype=float).reshape(-1, 2, 2)
        lines = lines[np.isfinite(lines).all(axis=(1, 2))]
        if len(lines):
            node.points = self._place(lines, LINES).astype(np.float32)
        node.visible = bool(len(lines))

    def _segments(self, name: str, colour: Any, points: Any = _NONE) -> Any:
        return self._scene.add_line_segments(
            name,
            np.asarray(points, np.float32),
            colour,
            thickness=2.0,
            thickness_units="screen",
            visible=False,
        )


def _ellipse_lines(session: Session) -> FloatArray:
    """(k, 2, 2): the outlines of the wheels that have their points."""
    try:
        outlines = [ellipse.outline() for ellipse in session.document.marks.ellipses]
    except QuickStartError:
        outlines = []
    lines = [np.stack([o, np.roll(o, -1, axis=0)], axis=1) for o in outlines]
    return np.concatenate(lines) if lines else np.zeros((0, 2, 2))


def _cross() -> FloatArray:
    """(4, 2, 3): arms that leave the middle free; the unit is a px of the screen."""
    inner, outer = 2.0, ARM_PX
    ways = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    return np.stack([inner * ways, outer * ways], axis=1)


def _diamond() -> FloatArray:
    """(4, 2, 3)."""
    corners = 5.0 * np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
