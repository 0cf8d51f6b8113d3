"""Edits by the pointer, in photo px; and ``update``, which makes any edit."""

from dataclasses import replace
from typing import Literal

import numpy as np

from poseviewer.app.state.dragging import (
    draw_rectangle,
    nearest_object,
    nearest_point,
    pins_in_photo,
    take_hold,
    translate,
)
from poseviewer.app.state.edits import Edit, Px, Zoom, drag_edit, edit
from poseviewer.app.state.hiding import HIDING, leave_out
from poseviewer.app.state.marking import (
    MARKING,
    hold_mark,
    mark_at,
    remove_mark,
    solve_pose,
    with_mark,
)
from poseviewer.app.state.pose_edits import move_to
from poseviewer.app.state.proposal_edits import propose_starts
from poseviewer.app.state.session import Session, is_in_sight
from poseviewer.errors import PoseViewerError, QuickStartError, SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.placing import fit_into_rectangle, surface_point
from poseviewer.scene.measuring import measure_point
from poseviewer.vehicle.chart import VehicleChart

Tool = Literal[
    "pose", "region", "box", "pairs", "wheels", "brush", "polygon", "scribble", "part", "measure"
]
MAX_PINS = 3
MAX_INPUT = 1e9
"""Largest number (px, steps, parameters) that is taken; larger ones would overflow."""


@edit
def press(
    session: Session, x: Px, y: Px, zoom: Zoom = 1.0, shift: bool = False, ctrl: bool = False
) -> Session:
    """Press the main button: take hold of what is there, or do what the tool does. A model without
    a pose goes there and is held.

    Args:
        session: before the edit.
        x: px of the photo.
        y: likewise.
        zoom: screen px per photo px.
        shift: turn the model.
        ctrl: roll and scale it.
    """
    session = session.stop_proposing().stop_propagating()
    document = session.document
    point = np.array([x, y])
    tool = session.tool
    if tool == "part":
        return leave_out(x, y)(session)
    if tool == "measure":
        return _measure(session, point)
    if tool in MARKING:
        mark = mark_at(session, point, zoom)
        if mark is None:
            return session.with_document(with_mark(document, tool, point))
        drag = hold_mark(session, mark, point)
    elif tool in ("region", "box"):
        drag = draw_rectangle(tool, point)
    else:
        kind = "roll" if ctrl else "turn" if shift else "move"
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


def _measure(session: Session, pixel: FloatArray) -> Session:
    """Measure the surface at a pixel, and its distance from the point before."""
    document, before = session.document, session.measurement_pixels
    if measure_point(document.scene, pixel, document.view_index) is None:
        raise QuickStartError("There is no model there to measure; press a point of one.")
    pixels = (*before, pixel) if len(before) == 1 else (pixel,)
    return replace(session, measured=tuple((document.photo, p) for p in pixels))


@edit
def toggle_measuring(session: Session) -> Session:
    """Take the measuring tool, with no points yet, or leave it."""
    return replace(session, tool="pose" if session.tool == "measure" else "measure", measured=())


@drag_edit
def drag_to(session: Session, x: Px, y: Px) -> Session:
    """Move what is held to the pointer, and end a search. The pose is checked on ``release``."""
    drag = session.drag
    if drag is None:
        return session
    document = drag.follow(session.document, np.array([x, y]))
    if drag.before is None:
        drag = replace(drag, before=session.document)
        session = replace(session.without_search(session.compared_scene), drag=drag)
    return replace(session, document=document)


@drag_edit
def release(session: Session) -> Session:
    """End the drag, as one undo step. A box that was drawn takes the model, and starts are proposed
    in it.
    """
    drag = session.drag
    document = session.document
    tool = session.tool
    if drag is None:
        return session
    session = replace(session, drag=None, tool=tool if tool in MARKING else "pose")
    before = drag.before
    if before is None:
        return session
    session = replace(session, document=before)
    if tool == "box" and document.marks.box is not None:
        pose = fit_into_rectangle(document.pose, document.mesh, document.marks.box)
        return propose_starts()(session.with_document(move_to(document, pose)))
    if tool in MARKING:
        document = solve_pose(document, tool)
    return session.with_document(document) if is_in_sight(document) else session


@drag_edit
def cancel_drag(session: Session) -> Session:
    """Take the drag back, leave the tool, and stop proposing starts and propagating poses."""
    session, drag = session.stop_proposing().stop_propagating(), session.drag
    document = session.document if drag is None or drag.before is None else drag.before
    return replace(session, drag=None, tool="pose", document=document)


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


def update(session: Session, request: Edit) -> Session:
    """The session after an edit; the same object if nothing changes.

    Raises:
        SettingsError: the edit cannot be made; a sentence for the user.
    """
    for value in (*request.arguments, *request.named.values()):
        if isinstance(value, int | float) and not abs(value) <= MAX_INPUT:
            wanted = f"wanted one within {MAX_INPUT:g} of zero; nothing was changed."
            raise SettingsError(f"A number is {value}: {wanted}")
    try:
        keeps_drag = request.keeps_drag or session.drag is None
        return request(session if keeps_drag else release()(session))
    except (PoseViewerError, OutsideChartError, ArithmeticError) as error:
        text = str(error)
        end = "" if text.endswith((".", "!", "?")) else "."
        raise SettingsError(f"{text[:1].upper()}{text[1:]}{end}") from error
