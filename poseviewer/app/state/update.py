"""``update(session, command)``: how a command changes the session. Pure; bad input is refused with
a sentence in ``complaint``, and nothing else changes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from poseviewer.app.state import commands as c
from poseviewer.app.state import identify_commands as ic
from poseviewer.app.state import identifying, proposing, searching, worker_results
from poseviewer.app.state.cameras import (
    with_field_of_view,
    with_other_projection,
    with_typed_camera,
)
from poseviewer.app.state.checks import require_in_sight, require_sane, sentence
from poseviewer.app.state.document import Document, History
from poseviewer.app.state.gestures import (
    PIN_REACH,
    RegionDrag,
    picked_numbers,
    pins_in_photo,
    take_hold,
)
from poseviewer.app.state.marking import MARKING, MarkCommand, MarkDrag, mark_step, solved
from poseviewer.app.state.motions import moved, rolled, scaled_about, turned
from poseviewer.app.state.searching import revert, settled
from poseviewer.app.state.session import NO_ERROR, Session
from poseviewer.errors import QuickStartError, SettingsError, SingularChartError
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.starts.placing import look_from, surface_point
from poseviewer.vehicle.chart import VehicleChart

MOST_PINS = 3
NUDGE_MOVE_PX = 1.0
NUDGE_TURN = math.radians(1.0)
NUDGE_SCALE = 1.01


def update(session: Session, command: c.Command) -> Session:
    """The session after a command; the same object where nothing changes."""
    if not isinstance(command, _NEWS) and session.error_message:
        session = replace(session, error_message=NO_ERROR)
    try:
        require_sane(command)
        if session.drag is not None and not isinstance(command, _DURING_A_DRAG):
            # Whatever else is done ends the drag, or its steps would come in the wrong order.
            return _HANDLERS[type(command)](_release(session, c.Release()), command)
        return _HANDLERS[type(command)](session, command)
    except (*_NO_POSE, SettingsError, QuickStartError, ArithmeticError) as error:
        return replace(session, error_message=sentence(str(error)))


def _with_document(session: Session, document: Document) -> Session:
    """One undoable step to another document; a search that runs is stopped."""
    require_in_sight(document)
    before = session.document
    stopped = settled(session)
    return replace(
        stopped,
        document=document,
        history=stopped.history.with_step(before),
        anchor=document.pose,
        search=None,
    )


def _with_pose(session: Session, pose: Pose) -> Session:
    return _with_document(session, replace(session.document, pose=pose))


def _press(session: Session, command: c.Press) -> Session:
    point = np.array([command.x, command.y])
    if session.tool in MARKING:
        return _mark(session, command)
    if session.tool in _RECTANGLES:
        drag = _RECTANGLES[session.tool](point)
    else:
        way = "roll" if command.ctrl else "turn" if command.shift else "move"
        drag = take_hold(session.document, point, command.zoom, way, session.look.rings)
    if drag is None:
        return session
    return replace(session, drag=drag, before_drag=None)


def _drag(session: Session, command: c.DragTo) -> Session:
    if session.drag is None:
        return session
    first = session.before_drag is None
    before = session.document if first else session.before_drag
    document = session.drag.apply(session.document, np.array([command.x, command.y]))
    require_in_sight(document)
    if first:
        session = settled(session)
        session = replace(session, search=None, anchor=session.anchor or session.document.pose)
    return replace(session, document=document, before_drag=before)


def _release(session: Session, command: c.Release) -> Session:
    del command
    if session.drag is None:
        return session
    before = session.before_drag
    tool = session.tool if session.tool in MARKING else "pose"
    session = replace(session, drag=None, before_drag=None, tool=tool)
    if before is None:
        return session
    if tool in MARKING:
        session = replace(session, document=solved(session.document, tool))
    history = session.history.with_step(before)
    return replace(session, history=history, anchor=session.document.pose)


def _cancel_drag(session: Session, command: c.CancelDrag) -> Session:
    del command
    document = session.before_drag or session.document
    return replace(session, drag=None, before_drag=None, tool="pose", document=document)


def _double_press(session: Session, command: c.DoublePress) -> Session:
    document, point = session.document, np.array([command.x, command.y])
    if session.tool in MARKING:
        return _mark(session, command)
    if isinstance(document.chart, VehicleChart):
        return replace(session, error_message="A vehicle has its pins already: wheels and axle.")
    if document.pins:
        away = np.linalg.norm(pins_in_photo(document) - point, axis=1) * command.zoom
        if np.min(away) <= PIN_REACH:
            gone = int(np.argmin(away))
            kept = tuple(p for i, p in enumerate(document.pins) if i != gone)
            return _with_document(session, replace(document, pins=kept))
    if len(document.pins) == MOST_PINS:
        return replace(
            session, error_message="Three pins fix a pose; double-click one to take it away first."
        )
    found = surface_point(document.registration.mesh, document.pose, point)
    if found is None:
        return replace(session, error_message="There is no model there to pin; double-click on it.")
    return _with_document(session, replace(document, pins=(*document.pins, found)))


def _nudge(session: Session, command: c.Nudge) -> Session:
    pose, centre = session.document.pose, session.document.registration.mesh.centre
    match command.kind:
        case "move":
            pose = moved(pose, centre, NUDGE_MOVE_PX * np.array([command.x, command.y]))
        case "turn":
            # To the right: about the downward axis, so that the near side follows.
            pose = turned(pose, centre, NUDGE_TURN * np.array([command.y, -command.x, 0.0]))
        case "roll":
            pose = rolled(pose, centre, NUDGE_TURN * command.x)
        case "scale":
            pose = scaled_about(pose, centre, NUDGE_SCALE ** min(max(command.x, -300.0), 300.0))
    return _with_pose(session, pose)


def _set_number(session: Session, command: c.SetNumber) -> Session:
    chart, parameters = session.document.chart, np.array(session.document.parameters)
    if command.name not in chart.names or not math.isfinite(command.value):
        raise SettingsError(f"{command.name} = {command.value} is no number of the chart")
    index = chart.names.index(command.name)
    if float(parameters[index]) == command.value:
        return session
    parameters[index] = command.value
    changed = _with_pose(session, chart.to_pose(parameters))
    if session.typed == (command.name, session.document) and not session.history.future:
        # One step back leads to before the whole of what was typed, not to its first digit.
        changed = replace(changed, history=session.history)
    return replace(changed, typed=(command.name, changed.document))


def _set_pose(session: Session, command: c.SetPose) -> Session:
    if command.as_start:
        return _with_document(session, session.document.started_from(command.pose))
    return _with_pose(session, command.pose)


def _reset(session: Session, command: c.ResetToStart) -> Session:
    del command
    return _with_pose(session, session.document.registration.start)


def _make_start(session: Session, command: c.MakeStart) -> Session:
    del command
    return _with_document(session, session.document.started_from(session.document.pose))


def _look_from(session: Session, command: c.LookFrom) -> Session:
    document = session.document
    mesh, keypoints = document.registration.mesh, document.registration.keypoints
    return _with_pose(session, look_from(command.side, mesh, keypoints, document.pose.camera))


def _undo(session: Session, command: c.Undo) -> Session:
    del command
    if session.searching and session.search is not None:
        return revert(session, c.RevertSearch())
    return _at(session, *session.history.undo(session.document))


def _at(session: Session, history: History, document: Document) -> Session:
    """At another document of the history; maps and picture of another photo or model go."""
    old, new = session.document.registration, document.registration
    if old.photo is not new.photo or old.mesh is not new.mesh:
        session = replace(session, landscape=None, overlay=None)
    return replace(session, history=history, document=document, search=None, anchor=document.pose)


def _redo(session: Session, command: c.Redo) -> Session:
    del command
    session = settled(session)
    return _at(session, *session.history.redo(session.document))


def _alter_settings(session: Session, command: c.AlterSettings) -> Session:
    now = session.document.settings
    wanted = command.alter(now)
    if wanted == now:
        return session
    return _with_document(session, replace(session.document, settings=wanted))


def _set_projection(session: Session, command: c.SetProjection) -> Session:
    pose = with_other_projection(session.document, command.projection)
    return session if pose is session.document.pose else _with_pose(session, pose)


def _set_camera(session: Session, command: c.SetCamera) -> Session:
    return _with_pose(session, with_typed_camera(session.document, command))


def _set_field_of_view(session: Session, command: c.SetFieldOfView) -> Session:
    return _with_pose(session, with_field_of_view(session.document, command.degrees))


def _open(session: Session, command: c.Open) -> Session:
    return replace(
        _with_document(session, command.document),
        landscape=None,
        overlay=None,
        drag=None,
        tool="pose",
        saved=None if command.unsaved else command.document.pose,
    )


def _set_tool(session: Session, command: c.SetTool) -> Session:
    return replace(session, tool=command.tool)


def _mark(session: Session, command: MarkCommand) -> Session:
    done = mark_step(session.document, session.tool, command)
    if isinstance(done, MarkDrag):
        return replace(session, drag=done, before_drag=None)
    return session if done is session.document else _with_document(session, done)


def _change_view(session: Session, command: c.ChangeView) -> Session:
    names = ("opacity", "wipe", "hidden", "rings", "before")
    given = {"name": command.look, **{name: getattr(command, name) for name in names}}
    changes = {name: value for name, value in given.items() if value is not None}
    return replace(session, look=replace(session.look, **changes))


def _change_landscape(session: Session, command: c.ChangeLandscape) -> Session:
    names = ("half_width", "shared_scale", "surface", "large")
    given = {name: getattr(command, name) for name in names}
    changes = {name: value for name, value in given.items() if value is not None}
    if command.close_large:
        changes["large"] = None
    return replace(session, maps=replace(session.maps, **changes))


def _pick(session: Session, command: c.PickInLandscape) -> Session:
    latest = session.landscape
    if latest is None:
        return session
    pairs = {(piece.first, piece.second): piece for piece in latest.slices}
    piece = pairs.get((command.first, command.second))
    if piece is None:
        return session
    parameters = picked_numbers(piece, latest.parameters, command.u, command.v)
    return _with_pose(session, latest.case.problem.chart.to_pose(parameters))


_RECTANGLES = {"region": RegionDrag, "box": proposing.BoxDrag}
_NO_POSE = (OutsideChartError, SingularChartError)
_NEWS = (
    c.SearchAdvanced,
    c.LandscapeAdvanced,
    c.OverlayDrawn,
    c.LossComputed,
    ic.IdentificationAdvanced,
)
_DURING_A_DRAG = (
    *_NEWS,
    c.DragTo,
    c.Release,
    c.CancelDrag,
    c.SearchFailed,
    ic.IdentificationFailed,
    c.ChangeView,
    c.ChangeLandscape,
    c.Saved,
)

_HANDLERS = {
    c.Press: _press,
    c.DragTo: _drag,
    c.Release: _release,
    c.CancelDrag: _cancel_drag,
    c.DoublePress: _double_press,
    c.Nudge: _nudge,
    c.SetNumber: _set_number,
    c.SetPose: _set_pose,
    c.ResetToStart: _reset,
    c.MakeStart: _make_start,
    c.LookFrom: _look_from,
    c.Undo: _undo,
    c.Redo: _redo,
    c.AlterSettings: _alter_settings,
    c.SetProjection: _set_projection,
    c.SetCamera: _set_camera,
    c.SetFieldOfView: _set_field_of_view,
    c.Open: _open,
    c.SetTool: _set_tool,
    **proposing.HANDLERS,
    **identifying.HANDLERS,
    c.RemoveMark: _mark,
    c.ClearMarks: _mark,
    c.LayWheels: _mark,
    c.ChangeView: _change_view,
    c.ChangeLandscape: _change_landscape,
    c.PickInLandscape: _pick,
    **searching.HANDLERS,
    c.LandscapeAdvanced: worker_results.landscape_advanced,
    c.OverlayDrawn: worker_results.painted,
    c.LossComputed: worker_results.weighed,
    c.Saved: worker_results.saved,
}
