"""Edits by a press of the pointer, in photo px; its drag is in ``edits``."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from poseviewer.app.state.document import MARKING
from poseviewer.app.state.dragging import (
    draw_rectangle,
    move_to,
    nearest_object,
    nearest_point,
    pins_in_photo,
    take_hold,
    translate,
)
from poseviewer.app.state.edits import Px, Zoom, edit
from poseviewer.app.state.hiding import HIDING, leave_out
from poseviewer.app.state.marking import (
    hold_mark,
    mark_at,
    remove_mark,
    with_mark,
)
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.placing import surface_point
from poseviewer.scene.measuring import measure_point
from poseviewer.vehicle.chart import VehicleChart

Tool = Literal[
    "pose", "region", "box", "pairs", "wheels", "brush", "polygon", "scribble", "part", "measure"
]
MAX_PINS = 3


@edit
def press(
    session: Session, x: Px, y: Px, zoom: Zoom = 1.0, shift: bool = False, ctrl: bool = False
) -> Session:
    """Press the main button: take hold of what is there, else of the active model, or do what the
    tool does. A model without a pose goes there and is held.

    Args:
        session: before the edit.
        x: px of the photo.
        y: likewise.
        zoom: screen px per photo px.
        shift: turn the model.
        ctrl: roll and scale it.
    """
    session = session.stop_proposing().stop_propagating()
    kind = "roll" if ctrl else "turn" if shift else "move"
    return PRESSES.get(session.tool, _hold)(session, np.array([x, y]), zoom, kind)


def _hold(session: Session, point: FloatArray, zoom: float, kind: str) -> Session:
    """Take hold of a pin, or of the nearest model there, which becomes active, or of the active
    one wherever the press is.
    """
    document = session.document
    if not document.object.is_placed:
        centre = document.mesh.centre
        pose = translate(document.pose, centre, point - document.pose.project(centre))
        session = session.with_document(move_to(document, pose))
        return replace(session, drag=take_hold(session.document, point, zoom, kind))
    drag = take_hold(document, point, zoom, kind)
    if drag is None or drag.holds_model:
        session = session.with_active(nearest_object(document, point))
        if session.document is not document:
            drag = take_hold(session.document, point, zoom, kind)
    return session if drag is None else replace(session, drag=drag)


def _draw(session: Session, point: FloatArray, _zoom: float, _kind: str) -> Session:
    return replace(session, drag=draw_rectangle(session.tool, point))


def _mark(session: Session, point: FloatArray, zoom: float, _kind: str) -> Session:
    """Take hold of a mark, or set a further one."""
    mark = mark_at(session, point, zoom)
    if mark is None:
        return session.with_document(with_mark(session.document, session.tool, point))
    return replace(session, drag=hold_mark(session, mark, point))


def _leave_out(session: Session, point: FloatArray, _zoom: float, _kind: str) -> Session:
    return leave_out(*point)(session)


def _measure(session: Session, pixel: FloatArray, _zoom: float, _kind: str) -> Session:
    """Measure the surface at a pixel, and its distance from the point before."""
    document, before = session.document, session.measurement_pixels
    if measure_point(document.scene, pixel, document.view_index) is None:
        raise QuickStartError("There is no model there to measure; press a point of one.")
    pixels = (*before, pixel) if len(before) == 1 else (pixel,)
    return replace(session, measured=tuple((document.photo, p) for p in pixels))


PRESSES: Mapping[str, Callable[[Session, FloatArray, float, str], Session]] = {
    "region": _draw,
    "box": _draw,
    "pairs": _mark,
    "wheels": _mark,
    "part": _leave_out,
    "measure": _measure,
}
"""Edits by a press with each tool, but for those that hold the model: given the point (2,), the
screen px per photo px, and the motion of the model.
"""


@edit
def toggle_measuring(session: Session) -> Session:
    """Take the measuring tool, with no points yet, or leave it."""
    return replace(session, tool="pose" if session.tool == "measure" else "measure", measured=())


@edit
def double_press(session: Session, x: Px, y: Px, zoom: Zoom = 1.0) -> Session:
    """Double-click: pin the surface there, or remove the pin or the mark that is there.

    Args:
        session: before the edit.
        x: px of the photo.
        y: likewise.
        zoom: screen px per photo px.
    """
    document = session.document
    point = np.array([x, y])
    tool = session.tool
    if tool in (*HIDING, "measure"):
        return session
    if tool in MARKING:
        mark = mark_at(session, point, zoom)
        return session if mark is None else remove_mark(mark)(session)
    if isinstance(document.chart, VehicleChart):
        raise QuickStartError("A vehicle has its pins already: wheels and axle.")
    pins = document.state.pins
    pin = nearest_point(pins_in_photo(document), point, zoom)
    if pin is not None:
        return session.with_document(document.with_state(pins=(*pins[:pin], *pins[pin + 1 :])))
    if len(pins) == MAX_PINS:
        raise QuickStartError("Three pins fix a pose; double-click one to take it away first.")
    surface = surface_point(document.mesh, document.pose, point)
    if surface is None:
        raise QuickStartError("There is no model there to pin; double-click on it.")
    return session.with_document(document.with_state(pins=(*pins, surface)))


@edit
def set_tool(session: Session, tool: Tool) -> Session:
    """Choose what a press does."""
    return replace(session, tool=tool)
