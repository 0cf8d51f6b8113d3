"""Edits of the session: each function gives an edit, a function from a session to the next one.

Bad input raises. Points are photo px, pixel centres at i + 0.5.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from poseviewer.app.state.camera_change import camera_from_numbers, with_camera
from poseviewer.app.state.document import (
    UNLOCK,
    Document,
    History,
    compared,
    label_of,
    scale_at,
    stands,
)
from poseviewer.app.state.dragging import (
    draw_rectangle,
    moved,
    nearest_object,
    nearest_place,
    pins_in_photo,
    rolled,
    scaled_about,
    take_hold,
    turned,
)
from poseviewer.app.state.edits import Edit, Px, Zoom, drag_edit, edit
from poseviewer.app.state.hiding import HIDING, leave_out
from poseviewer.app.state.marking import (
    MARKING,
    hold_mark,
    mark_at,
    remove_mark,
    solved,
    with_mark,
)
from poseviewer.app.state.session import (
    Preparation,
    ProposedStarts,
    Search,
    SearchRequest,
    SearchUpdate,
    Session,
    is_in_sight,
)
from poseviewer.errors import PoseViewerError, QuickStartError, SettingsError
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.charts import OutsideChartError
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.transform import RigidTransform
from poseviewer.scene.settings import LOSSES, FitSettings, LossName
from poseviewer.starts.automatic import PoseHypothesis
from poseviewer.starts.loading import scale_of_sight
from poseviewer.starts.placing import fit_into_rectangle, look_from, surface_point
from poseviewer.vehicle.chart import VehicleChart

Projection = Literal["perspective", "parallel"]
Tool = Literal["pose", "region", "box", "pairs", "wheels", "brush", "polygon", "scribble", "part"]
NudgeKind = Literal["move", "turn", "roll", "scale"]
MOST_PINS = 3
NUDGE_MOVE_PX = 1.0
NUDGE_TURN = math.radians(1.0)
NUDGE_SCALE = 1.01

LARGEST_INPUT = 1e9
"""Largest number (px, steps, parameters) that is no mistake; larger ones would overflow."""


def update(session: Session, asked: Edit) -> Session:
    """The session after an edit; the same object where nothing changes.

    Raises ``PoseViewerError``: the edit cannot be made; a sentence for the user.
    """
    for value in (*asked.arguments, *asked.named.values()):
        if isinstance(value, int | float) and not abs(value) <= LARGEST_INPUT:
            wanted = f"wanted one within {LARGEST_INPUT:g} of zero; nothing was changed."
            raise SettingsError(f"A number is {value}: {wanted}")
    try:
        return asked(session if asked.keeps_drag or session.drag is None else release()(session))
    except (PoseViewerError, OutsideChartError, ArithmeticError) as error:
        text = str(error)
        end = "" if text.endswith((".", "!", "?")) else "."
        raise SettingsError(f"{text[:1].upper()}{text[1:]}{end}") from error


# --- the pointer --------------------------------------------------------------------------------


@edit
def press(
    session: Session, x: Px, y: Px, zoom: Zoom = 1.0, shift: bool = False, ctrl: bool = False
) -> Session:
    """Take hold of what is at a point of the photo, of any object; with a marking tool, set a mark
    where there is none; put a model that is nowhere yet there. ``zoom``: screen px per photo px.
    """
    session = stop_proposing()(session)
    document, point, tool = session.document, np.array([x, y]), session.tool
    if tool == "part":
        return leave_out(x, y)(session)
    if tool in MARKING:
        mark = mark_at(document, tool, point, zoom)
        if mark is None:
            return session.with_document(with_mark(document, tool, point))
        drag = hold_mark(document, tool, mark, point)
    elif tool in ("region", "box"):
        drag = draw_rectangle(tool, point)
    else:
        kind = "roll" if ctrl else "turn" if shift else "move"
        drag = take_hold(document, point, zoom, kind)
        is_placed = document.object.is_placed
        if is_placed and (drag is None or drag.model_from is not None):
            session = session.with_active(nearest_object(document, point))
            if session.document is not document:
                drag = take_hold(session.document, point, zoom, kind)
        if drag is None and not is_placed:
            return _placed(session, point)
    return session if drag is None else replace(session, drag=drag)


def _placed(session: Session, point: FloatArray) -> Session:
    """Session with the model's middle at a point (2,) of the photo."""
    document, centre = session.document, session.document.mesh.centre
    pose = moved(document.pose, centre, point - document.pose.project(centre))
    return session.with_document(put(document, pose))


def put(document: Document, pose: Pose) -> Document:
    """Document at a new pose; among views of unknown scale, at the scale by which they see it."""
    scale = None
    if document.scene.free_scale:
        with suppress(SettingsError):
            views, name = document.scene.views, document.scene.name
            scale = 1.0 / scale_of_sight(views, document.at, document.mesh, pose, name)
    return document.at_pose(pose, scale=scale)


@drag_edit
def drag_to(session: Session, x: Px, y: Px) -> Session:
    """Bring what is held to the pointer; a search ends. ``release`` checks the pose."""
    held = session.drag
    if held is None:
        return session
    document = held.follow(session.document, np.array([x, y]))
    if held.before is None:
        held = replace(held, before=session.document)
        session = replace(session, search=None, anchor=session.compared, drag=held)
    return replace(session, document=document)


@drag_edit
def release(session: Session) -> Session:
    """End the drag, one undoable step. A model that is nowhere yet goes where it was pressed, any
    into the box that was drawn, where starts are looked for.
    """
    held, document, tool = session.drag, session.document, session.tool
    if held is None:
        return session
    session = replace(session, drag=None, tool=tool if tool in MARKING else "pose")
    before = held.before
    if before is None:
        if held.model_from is None or document.object.is_placed:
            return session
        return _placed(session, held.model_from)
    if tool == "box" and document.marks.box is not None:
        pose = fit_into_rectangle(document.pose, document.mesh, document.marks.box)
        session = replace(session, document=before).with_document(put(document, pose))
        return propose_starts()(session)
    if tool in MARKING:
        document = solved(document, tool)
    session = replace(session, document=before)
    return session.with_document(document) if is_in_sight(document) else session


@drag_edit
def cancel_drag(session: Session) -> Session:
    """Forget the drag: the pose goes back to where it was; proposals are no longer looked for."""
    session = stop_proposing()(session)
    held = session.drag
    document = session.document if held is None or held.before is None else held.before
    return replace(session, drag=None, tool="pose", document=document)


@edit
def double_press(session: Session, x: Px, y: Px, zoom: Zoom = 1.0) -> Session:
    """Pin the surface point seen there, or take the pin (with a marking tool: the mark) away."""
    document, point, tool = session.document, np.array([x, y]), session.tool
    if tool in HIDING:
        return session
    if tool in MARKING:
        mark = mark_at(document, tool, point, zoom)
        return session if mark is None else remove_mark(mark)(session)
    if isinstance(document.chart, VehicleChart):
        raise QuickStartError("A vehicle has its pins already: wheels and axle.")
    pins = document.state.pins
    pin = nearest_place(pins_in_photo(document), point, zoom)
    if pin is not None:
        kept = (*pins[:pin], *pins[pin + 1 :])
        return session.with_document(document.with_state(pins=kept))
    if len(pins) == MOST_PINS:
        raise QuickStartError("Three pins fix a pose; double-click one to take it away first.")
    place = surface_point(document.mesh, document.pose, point)
    if place is None:
        raise QuickStartError("There is no model there to pin; double-click on it.")
    return session.with_document(document.with_state(pins=(*pins, place)))


@edit
def set_tool(session: Session, tool: Tool) -> Session:
    """Choose what a press does: move the model, draw a rectangle, set a mark, or hide."""
    return replace(session, tool=tool)


@edit
def toggle_hiding(session: Session) -> Session:
    """Take the brush that hides, or put the tools that hide away."""
    return replace(session, tool="pose" if session.tool in HIDING else "brush")


# --- the pose -----------------------------------------------------------------------------------


@edit
def nudge(session: Session, kind: NudgeKind, x: float = 0.0, y: float = 0.0) -> Session:
    """Move the pose by small steps: ``x`` to the right, about the vertical, clockwise, or larger;
    ``y`` downwards, or about the horizontal.
    """
    pose, centre = session.document.pose, session.document.mesh.centre
    match kind:
        case "move":
            pose = moved(pose, centre, NUDGE_MOVE_PX * np.array([x, y]))
        case "turn":
            # To the right: about the downward axis, so that the near side follows.
            pose = turned(pose, centre, NUDGE_TURN * np.array([y, -x, 0.0]))
        case "roll":
            pose = rolled(pose, centre, NUDGE_TURN * x)
        case "scale":
            pose = scaled_about(pose, centre, NUDGE_SCALE**x)
    return session.with_pose(pose)


@edit
def set_number(session: Session, name: str, value: float) -> Session:
    """Set one parameter of the chart, by its name; what is typed in a row is one undoable step."""
    chart, parameters = session.document.chart, np.array(session.document.parameters)
    if name not in chart.names or not math.isfinite(value):
        raise SettingsError(f"{name} = {value} is no parameter of the chart")
    index = chart.names.index(name)
    if float(parameters[index]) == value:
        return session
    parameters[index] = value
    pose, scale = chart.to_pose(parameters), scale_at(chart, parameters)
    return session.with_document(session.document.at_pose(pose, scale=scale), name)


@edit
def reset_to_start(session: Session) -> Session:
    """Go back to the start pose."""
    return session.with_document(session.document.reset)


@edit
def make_start(session: Session) -> Session:
    """Make the pose at hand the start pose."""
    return session.with_document(session.document.started)


@edit
def view_from(session: Session, side: str) -> Session:
    """Turn the model so that one of its sides is seen: where it is and as large, if it is placed,
    else in the middle of the photo.
    """
    document, own, pose = session.document, session.document.model, session.document.pose
    seen = look_from(side, own.mesh, own.keypoints, pose.camera)
    if document.object.is_placed:
        rotation, centre = seen.camera_from_model.rotation, own.mesh.centre
        place = pose.camera_from_model.apply(centre) - rotation @ centre
        seen = replace(pose, camera_from_model=RigidTransform(rotation, place))
    return session.with_pose(seen)


@edit
def undo(session: Session) -> Session:
    """Go one step back: of a search, to before it."""
    return session.at(*session.history.undo(session.document))


@edit
def redo(session: Session) -> Session:
    """Go one step on again."""
    return session.at(*session.history.redo(session.document))


@edit
def open_document(
    session: Session, document: Document, unsaved: bool = False, is_first: bool = False
) -> Session:
    """Open another photo, model or both. ``unsaved``: its pose stands in no file, and a model
    without one is not looked for; ``is_first``: undo does not lead back before it.
    """
    opened = session.with_document(document)
    opened = opened if unsaved else opened.opened
    history = History() if is_first else opened.history
    saved = None if unsaved else document
    return replace(opened, history=history, drag=None, tool="pose", saved=saved)


# --- settings and camera ------------------------------------------------------------------------


@edit
def alter_settings(session: Session, alter: Callable[[FitSettings], FitSettings]) -> Session:
    """Alter settings as they are by then: what was changed just before stays changed."""
    settings = alter(session.document.settings)
    if settings == session.document.settings:
        return session
    return session.with_document(session.document.with_object(settings=settings))


@edit
def clear_region(session: Session) -> Session:
    """Compare the active object with all of the photo."""
    return session.with_document(session.document.with_own(region=None))


@edit
def set_loss(session: Session, loss: LossName) -> Session:
    """Search by another loss; what each compares is kept until it is chosen again."""
    before = session.document.settings
    if loss == before.loss:
        return session
    settings = session.settings_by(loss)
    changed = session.with_document(session.document.with_object(settings=settings))
    return replace(changed, other_settings=before)


@edit
def set_projection(session: Session, projection: Projection) -> Session:
    """Set perspective or parallel; the model stays where it is and as large."""
    own, camera = session.document, session.document.pose.camera
    if isinstance(camera, Parallel) is (projection == "parallel"):
        return session
    if projection == "parallel":
        other = Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
    else:
        start = own.start.camera
        start = start if isinstance(start, Perspective) else own.photo.default_camera()
        other = replace(start, cx=camera.cx, cy=camera.cy)
    return _seen_by(session, other)


@edit
def set_camera(session: Session, fx: float, fy: float, cx: float, cy: float) -> Session:
    """Set intrinsics in px, as OpenCV has them (pixel centres at integers)."""
    return _seen_by(session, camera_from_numbers(fx, fy, cx, cy, session.document.pose.camera))


def _seen_by(session: Session, camera: Camera) -> Session:
    """Session with the active object seen by another camera."""
    if len(session.document.scene.views) > 1:
        raise SettingsError(
            "the cameras of several photos are known: open this photo alone to change its camera"
        )
    own = session.document
    return session.with_pose(with_camera(own.pose, camera, own.mesh.centre))


@edit
def set_field_of_view(session: Session, degrees: float) -> Session:
    """Set equal focal lengths from the view of the photo's longer side; the centre stays."""
    now = camera_as_integer_centres(session.document.pose.camera)
    camera = Perspective.from_field_of_view(degrees, now.width, now.height)
    return set_camera(camera.fx, camera.fy, now.cx, now.cy)(session)


# --- proposals ----------------------------------------------------------------------------------


@edit
def propose_starts(session: Session) -> Session:
    """Look for start poses, in the rectangle about the object; or stop looking."""
    if session.proposing:
        return stop_proposing()(session)
    tool = "pose" if session.tool == "box" else session.tool
    return replace(session, proposals=ProposedStarts(session.document), tool=tool)


@edit
def toggle_box(session: Session) -> Session:
    """Draw a rectangle about the object, to look for start poses there; or stop looking."""
    is_asked_for = session.proposing and not session.looking
    return (stop_proposing() if is_asked_for else set_tool("box"))(session)


@edit
def stop_proposing(session: Session) -> Session:
    """Look for start poses no more."""
    asked = session.proposals
    return replace(session, proposals=asked.stopped) if asked and session.proposing else session


@drag_edit
def starts_proposed(
    session: Session,
    document: Document,
    starts: tuple[PoseHypothesis, ...],
    outlines: tuple[FloatArray, ...],
) -> Session:
    """List the starts that were asked for at ``document``; take the likeliest, unless the model
    was nowhere: then its fit follows.
    """
    asked = session.proposals
    if asked is None or asked.document is not document or asked.starts:
        return session
    asked = replace(asked, starts=starts, outlines=outlines, is_over=not starts)
    session = replace(session, proposals=asked)
    return take_start(0)(session) if document.object.is_placed else session


@drag_edit
def start_fitted(
    session: Session, document: Document, asked: SearchRequest, latest: SearchUpdate, index: int
) -> Session:
    """Put a model that was looked for at ``document`` where a search from a proposal has ended,
    if that is found.
    """
    proposals, result = session.proposals, latest.results[document.active]
    if proposals is None or proposals.document is not document or proposals.is_over:
        return session
    verdict, at = result and result.verdict, document.active
    is_same = compared(session.document.scene, at) == compared(document.scene, at)
    if not (is_same and verdict and verdict.label == "found"):
        return stop_proposing()(session)
    session = take_start(index)(session)
    session = replace(session, document=found_at(session.document, latest))
    return replace(session, search=Search(asked, False, latest), anchor=asked.start.scene)


@edit
def step_proposals(session: Session, by: int = 1) -> Session:
    """Take another proposal: ``by`` places on, round and round."""
    asked = session.proposals
    if asked is None or not asked.starts:
        return session
    at = max(asked.index, min(-by, 0))  # while none is taken: the first, or the last
    return take_start((at + by) % len(asked.starts))(session)


@edit
def take_start(session: Session, index: int) -> Session:
    """Make a proposal the pose and the start pose."""
    asked = session.proposals
    if asked is None or not 0 <= index < len(asked.starts):
        return session
    document = put(session.document, asked.starts[index].pose).started
    # One step back leads to before all proposals.
    session = session.with_document(document, asked.document)
    return replace(session, proposals=replace(asked, index=index, is_over=True))


# --- searches and maps --------------------------------------------------------------------------


@edit
def start_search(session: Session) -> Session:
    """Search for the active object from the pose at hand."""
    document = session.document
    return _searching(session, document, (document.settings,), (document.active,))


@edit
def find_focal_length(session: Session) -> Session:
    """Search for the active object's pose and the focal length together."""
    return start_search()(alter_settings(lambda now: replace(now, free_focal=True))(session))


@edit
def search_all(session: Session) -> Session:
    """Search for all objects that are not locked, in turn, until none improves."""
    document = session.document
    objects = enumerate(document.scene.objects)
    free = {i: one for i, one in objects if stands(one) and not one.locked}
    if not free:
        raise SettingsError("all objects are locked, hidden or not placed: nothing to search")
    if len(free) > 1 and any(one.settings.free_focal for one in free.values()):
        raise SettingsError(
            "the focal length is one for all objects: find it with one of them alone, then "
            "search all without it"
        )
    return _searching(session, document, (document.settings,), tuple(free))


@edit
def compare_losses(session: Session) -> Session:
    """Search from the start pose by both losses, by the one that is chosen last."""
    document = session.document
    losses = sorted(LOSSES, key=lambda loss: loss == document.settings.loss)
    settings = tuple(map(session.settings_by, losses))
    return _searching(session, document.reset, settings, (document.active,))


def _searching(
    session: Session, start: Document, methods: tuple[FitSettings, ...], indices: tuple[int, ...]
) -> Session:
    """Session with a new search, unless one is running."""
    if session.searching:
        return session
    if session.preparation is not None and session.preparation.trouble:
        raise SettingsError(session.preparation.trouble)
    session, document = stop_proposing()(session), session.document
    if document.object.locked and indices == (document.active,):
        raise SettingsError(f"{label_of(document.object)} is locked: {UNLOCK} to search")
    return replace(
        session,
        search=Search(SearchRequest(start, methods, indices)),
        history=session.history.with_step(document),
        anchor=start.scene,
        drag=None,
    )


@edit
def take_end(session: Session, index: int) -> Session:
    """Go where a loss of the last comparison ended, as if it alone had been searched by."""
    if not 0 <= index < len(session.ends):
        return session
    end, before = session.ends[index], session.document
    document = found_at(before, end).with_object(settings=end.settings)
    taken = session.with_document(document)
    if end.settings.loss != before.settings.loss:
        taken = replace(taken, other_settings=before.settings)
    asked = SearchRequest(before.reset, (end.settings,), (before.active,))
    return replace(taken, search=Search(asked, False, end), anchor=asked.start.scene)


@edit
def stop_search(session: Session) -> Session:
    """Stop the search, keep its best pose; one that has not begun is as if never asked for."""
    if session.search is None or not session.search.running:
        return session
    if session.preparation is not None:
        return revert_search()(session)
    return replace(session, search=replace(session.search, running=False))


@edit
def toggle_search(session: Session) -> Session:
    """Start a search, or stop the one that runs."""
    return (stop_search() if session.searching else start_search())(session)


@edit
def accept_search(session: Session) -> Session:
    """Keep what the search found, and put the search away."""
    return replace(session, search=None, proposals=None, anchor=session.document.scene)


@edit
def revert_search(session: Session) -> Session:
    """Go back to the pose before the search; one that runs is stopped."""
    return session if session.search is None else undo()(session)


@drag_edit
def search_advanced(session: Session, asked: SearchRequest, latest: SearchUpdate) -> Session:
    """Show how far the search is that was asked for."""
    search = session.search
    if search is None or search.asked is not asked or not search.running:
        return session
    search = replace(search, latest=latest, running=not latest.is_over)
    document = found_at(session.document, latest)
    return replace(session, document=document, search=search, ends=latest.ends or session.ends)


def found_at(document: Document, update: SearchUpdate) -> Document:
    """Document where a search is, or has ended."""
    for index, progress in update.placings.items():
        document = document.at_numbers(progress.problem, progress.parameters, index)
        document = document.with_object(index, result=update.results.get(index))
    is_seen = is_in_sight(document)
    return document if is_seen else document.with_view(update.problem.views[0].index)


@drag_edit
def search_failed(session: Session, asked: SearchRequest) -> Session:
    """Go back to before a search that could not be run."""
    is_asked = session.search is not None and session.search.asked is asked
    return revert_search()(session) if is_asked else session


@drag_edit
def preparation_advanced(session: Session, preparation: Preparation | None) -> Session:
    """Show what is still made ready (None: nothing more), or why it cannot be."""
    if preparation is not None and preparation.trouble:
        session = revert_search()(session) if session.searching else session
        session = replace(session, proposals=None)
    return replace(session, preparation=preparation)


@drag_edit
def show(session: Session, document: Document, **results: Any) -> Session:
    """Show a worker's results (fields), unless another photo or model is at hand by now."""
    return replace(session, **results) if document.shown == session.document.shown else session


@edit
def pick_in_landscape(session: Session, first: int, second: int, u: float, v: float) -> Session:
    """Go to a point (u, v) of a map, in [0, 1] from its lower left corner."""
    for maps in session.landscapes:
        for piece in maps.slices:
            if (piece.first, piece.second) == (first, second):
                parameters = picked_parameters(piece, maps.parameters, u, v)
                picked = session.document.at_numbers(maps.case.problem, parameters)
                return session.with_document(picked)
    return session


def picked_parameters(piece: Slice, centre: FloatArray, u: float, v: float) -> FloatArray:
    """(d,): the parameters at shares ``u``, ``v`` of a map's side, cut to [0, 1], from its left and
    lower border; ``centre`` (d,): the map's.
    """
    parameters = np.array(centre, dtype=float)
    parameters[piece.first] = np.interp(u, [0.0, 1.0], piece.first_values[[0, -1]])
    parameters[piece.second] = np.interp(v, [0.0, 1.0], piece.second_values[[0, -1]])
    return parameters


# --- how it is looked at ------------------------------------------------------------------------


@drag_edit
def change(session: Session, **fields: Any) -> Session:
    """Change fields of the session that are no part of its document."""
    return replace(session, **fields)


@drag_edit
def refuse(_: Session, sentence: str) -> Session:
    """Tell a sentence; nothing changes."""
    raise SettingsError(sentence)


@drag_edit
def toggle_model(session: Session) -> Session:
    """Show the photo alone, or the model again."""
    return replace(session, photo_alone=not session.photo_alone)


@drag_edit
def enlarge_map(session: Session, first: int, second: int) -> Session:
    """Make the map of a pair of parameters large, or small again."""
    pair = None if session.large_map == (first, second) else (first, second)
    return replace(session, large_map=pair)
