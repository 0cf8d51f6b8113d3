"""What a user, or a worker, asks of the session, and how each command changes it.

A command is a function from a session to the next one, or to the same object where nothing changes;
bad input raises, and ``update`` makes the error message. Points are photo px, pixel centres at
i + 0.5.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Literal

import numpy as np

from poseviewer.app.state.camera_change import (
    camera_from_numbers,
    require_field_of_view,
    with_camera,
    with_projection,
)
from poseviewer.app.state.document import Document, History, label_of, stands
from poseviewer.app.state.dragging import (
    PIN_REACH,
    ModelDrag,
    RectangleDrag,
    moved,
    nearest_object,
    pins_in_photo,
    rolled,
    scaled_about,
    take_hold,
    turned,
)
from poseviewer.app.state.marking import (
    MARKING,
    mark_at,
    solved,
    with_mark,
    without_last,
    without_mark,
    without_marks,
)
from poseviewer.app.state.requests import Request
from poseviewer.app.state.session import (
    LandscapeUpdate,
    Overlay,
    Preparation,
    ProposedStarts,
    Search,
    SearchUpdate,
    Session,
    Whose,
    is_in_sight,
    require_in_sight,
)
from poseviewer.errors import QuickStartError, SettingsError
from poseviewer.fit.settings import METHODS, FitSettings, Method
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mesh import Mesh
from poseviewer.starts.loading import scale_of_sight
from poseviewer.starts.placing import framed, look_from, surface_point
from poseviewer.vehicle.chart import VehicleChart
from poseviewer.vehicle.wheel_pose import FEWEST_RIM_POINTS, Ellipse

Projection = Literal["perspective", "parallel"]
Tool = Literal["pose", "region", "box", "pairs", "wheels", "brush", "polygon", "scribble", "part"]
MOST_PINS = 3
NUDGE_MOVE_PX = 1.0
NUDGE_TURN = math.radians(1.0)
NUDGE_SCALE = 1.01
UNLOCK = "unlock it in the list of objects"
LARGEST_NUDGE = 300.0
"""Steps of scale: more would overflow."""


class Command(Request, eq=False):
    """A change of the session."""

    ends_drag = True
    """Whether a drag under way is ended first, or its steps would come in the wrong order."""
    keeps_error = False
    """Whether the error message stays: it is about what the user did."""
    goes_back = False
    """Whether it leads to where everything was at another time, what is locked as well."""

    def __call__(self, session: Session) -> Session:
        """The session after it."""
        raise NotImplementedError


class DragCommand(Command, eq=False):
    """One that leaves a drag under way as it is."""

    ends_drag = False


class WorkerUpdate(DragCommand, eq=False):
    """What a worker has found out."""

    keeps_error = True


# --- the pointer --------------------------------------------------------------------------------


class Press(Command):
    """The main button went down at a point of the photo: take hold of what is there, and pick it
    where it is another object; with a marking tool, set a mark where there is none; where the model
    is nowhere yet, put it there.
    """

    x: float
    y: float
    zoom: float = 1.0
    """Screen px per photo px: what is near is told on the screen."""
    shift: bool = False
    ctrl: bool = False

    def __call__(self, session: Session) -> Session:
        document, point, tool = session.document, np.array([self.x, self.y]), session.tool
        if tool in MARKING:
            drag = mark_at(document, tool, point, self.zoom)
            if drag is None:
                return session.with_document(with_mark(document, tool, point))
        elif tool in ("region", "box"):
            drag = RectangleDrag(tool, point)
        else:
            kind = "roll" if self.ctrl else "turn" if self.shift else "move"
            drag = take_hold(document, point, self.zoom, kind)
            is_placed = document.object.is_placed
            if is_placed and (drag is None or isinstance(drag, ModelDrag)):
                session = session.with_active(nearest_object(document, point))
                if session.document is not document:
                    drag = take_hold(session.document, point, self.zoom, kind)
            if drag is None and not is_placed:
                return _placed(session, point)
        return session if drag is None else replace(session, drag=drag, before_drag=None)


def _placed(session: Session, point: FloatArray) -> Session:
    """With the model's middle at a point (2,) of the photo."""
    document, centre = session.document, session.document.mesh.centre
    pose = moved(document.pose, centre, point - document.pose.project(centre))
    return session.with_document(put(document, pose))


def put(document: Document, pose: Pose) -> Document:
    """At a pose that nothing was known of before: among views of unknown scale, that by which the
    other ones look there.
    """
    scale = None
    if document.scene.free_scale:
        with suppress(SettingsError):
            views, name = document.scene.views, document.scene.name
            scale = 1.0 / scale_of_sight(views, document.at, document.mesh, pose, name)
    return document.at_pose(pose, scale=scale)


class DragTo(DragCommand):
    """The pointer moved, the button down: what is held follows, a search ends."""

    x: float
    y: float

    def __call__(self, session: Session) -> Session:
        if session.drag is None:
            return session
        document = session.drag.apply(session.document, np.array([self.x, self.y]))
        require_in_sight(document)
        if session.before_drag is None:
            anchor, before = session.compared, session.document
            session = replace(session, search=None, anchor=anchor, before_drag=before)
        return replace(session, document=document)


class Release(DragCommand):
    """The button went up: the drag as a whole is one undoable step. A model that is nowhere yet
    goes where it was pressed, and into the box that was drawn at once; starts are looked for there.
    """

    def __call__(self, session: Session) -> Session:
        if session.drag is None:
            return session
        before, document = session.before_drag, session.document
        tool = session.tool if session.tool in MARKING else "pose"
        drawn = session.tool
        held = session.drag
        session = replace(session, drag=None, before_drag=None, tool=tool)
        if before is None:
            if isinstance(held, ModelDrag) and not document.object.is_placed:
                return _placed(session, held.start)
            return session
        if drawn == "box" and document.marks.box is not None:
            pose = framed(document.pose, document.mesh, document.marks.box)
            session = replace(session, document=before).with_document(put(document, pose))
            return ProposeStarts()(session)
        if tool in MARKING:
            document = solved(document, tool)
        history = session.history.with_step(before)
        return replace(session, document=document, history=history, anchor=document.scene)


class CancelDrag(DragCommand):
    """The drag is to be forgotten: the pose goes back to where it was; proposals are no longer
    looked for.
    """

    def __call__(self, session: Session) -> Session:
        session = StopProposing()(session)
        document = session.before_drag or session.document
        return replace(session, drag=None, before_drag=None, tool="pose", document=document)


class DoublePress(Command):
    """Pin the surface point seen there, or take the pin (with a marking tool: the mark) away."""

    x: float
    y: float
    zoom: float = 1.0

    def __call__(self, session: Session) -> Session:
        document, point, tool = session.document, np.array([self.x, self.y]), session.tool
        if tool in MARKING:
            found = mark_at(document, tool, point, self.zoom)
            if found is None:
                return session
            return session.with_document(without_mark(document, tool, found.mark))
        if isinstance(document.chart, VehicleChart):
            raise QuickStartError("A vehicle has its pins already: wheels and axle.")
        pins = document.state.pins
        if pins:
            away = np.linalg.norm(pins_in_photo(document) - point, axis=1) * self.zoom
            nearest = int(np.argmin(away))
            if away[nearest] <= PIN_REACH:
                kept = (*pins[:nearest], *pins[nearest + 1 :])
                return session.with_document(document.with_state(pins=kept))
        if len(pins) == MOST_PINS:
            raise QuickStartError("Three pins fix a pose; double-click one to take it away first.")
        place = surface_point(document.mesh, document.pose, point)
        if place is None:
            raise QuickStartError("There is no model there to pin; double-click on it.")
        return session.with_document(document.with_state(pins=(*pins, place)))


class SetTool(Command):
    """What a press does: the pose, the rectangle of the region or about the object, a point pair,
    a wheel's rim, or one of ``hiding``.
    """

    tool: Tool

    def __call__(self, session: Session) -> Session:
        return replace(session, tool=self.tool)


# --- the pose -----------------------------------------------------------------------------------


class Nudge(Command):
    """A small step of the pose, as from a key."""

    kind: Literal["move", "turn", "roll", "scale"]
    x: float = 0.0
    """Steps: to the right, about the vertical, clockwise, or larger."""
    y: float = 0.0
    """Steps: downwards, or about the horizontal."""

    def __call__(self, session: Session) -> Session:
        pose, centre = session.document.pose, session.document.mesh.centre
        match self.kind:
            case "move":
                pose = moved(pose, centre, NUDGE_MOVE_PX * np.array([self.x, self.y]))
            case "turn":
                # To the right: about the downward axis, so that the near side follows.
                pose = turned(pose, centre, NUDGE_TURN * np.array([self.y, -self.x, 0.0]))
            case "roll":
                pose = rolled(pose, centre, NUDGE_TURN * self.x)
            case "scale":
                steps = min(max(self.x, -LARGEST_NUDGE), LARGEST_NUDGE)
                pose = scaled_about(pose, centre, NUDGE_SCALE**steps)
        return session.with_pose(pose)


class SetNumber(Command):
    """One parameter of the chart, by its name; what is typed in a row is one undoable step."""

    name: str
    value: float

    def __call__(self, session: Session) -> Session:
        chart, parameters = session.document.chart, np.array(session.document.parameters)
        if self.name not in chart.names or not math.isfinite(self.value):
            raise SettingsError(f"{self.name} = {self.value} is no parameter of the chart")
        index = chart.names.index(self.name)
        if float(parameters[index]) == self.value:
            return session
        parameters[index] = self.value
        # One step back leads to before the whole of what was typed, not to its first digit.
        typed_on = session.typed == (self.name, session.document) and not session.history.future
        document = session.document.at_numbers(chart, parameters)
        changed = session.with_document(document, same_step=typed_on)
        return replace(changed, typed=(self.name, document))


class ResetToStart(Command):
    """Back to the start pose."""

    def __call__(self, session: Session) -> Session:
        return session.with_document(session.document.reset)


class MakeStart(Command):
    """The pose at hand becomes the start pose."""

    def __call__(self, session: Session) -> Session:
        return session.with_document(session.document.started)


class LookFrom(Command):
    """The model as a whole in the middle of the photo, seen from one of its sides."""

    side: str

    def __call__(self, session: Session) -> Session:
        own, camera = session.document.model, session.document.pose.camera
        return session.with_pose(look_from(self.side, own.mesh, own.keypoints, camera))


class Undo(Command):
    """One step back: of a search, to before it."""

    goes_back = True

    def __call__(self, session: Session) -> Session:
        return session.at(*session.history.undo(session.document))


class Redo(Command):
    """One step on again."""

    goes_back = True

    def __call__(self, session: Session) -> Session:
        return session.at(*session.history.redo(session.document))


class Open(Command, eq=False):
    """Another photo, model or both, read and ready."""

    document: Document
    unsaved: bool = False
    """Whether its pose stands in no file."""
    is_first: bool = False
    """Whether undo does not lead back before it."""

    def __call__(self, session: Session) -> Session:
        opened = session.with_document(self.document)
        return replace(
            opened,
            history=History() if self.is_first else opened.history,
            drag=None,
            tool="pose",
            saved=None if self.unsaved else self.document,
        )


class Saved(DragCommand, eq=False):
    """``document``'s poses, and what is compared there, stand in files."""

    document: Document

    def __call__(self, session: Session) -> Session:
        return replace(session, saved=self.document)


# --- settings and camera ------------------------------------------------------------------------


class AlterSettings(Command, eq=False):
    """Some of the settings, as they are by then: what was changed just before stays changed."""

    alter: Callable[[FitSettings], FitSettings]

    def __call__(self, session: Session) -> Session:
        settings = self.alter(session.document.settings)
        if settings == session.document.settings:
            return session
        return session.with_document(session.document.with_object(settings=settings))


class ClearRegion(Command):
    """The active object is compared with all of the photo."""

    def __call__(self, session: Session) -> Session:
        return session.with_document(session.document.with_own(region=None))


class SetMethod(Command):
    """Search by another method; what each compares is kept until it is chosen again."""

    method: Method

    def __call__(self, session: Session) -> Session:
        before = session.document.settings
        if self.method == before.method:
            return session
        settings = session.settings_by(self.method)
        changed = session.with_document(session.document.with_object(settings=settings))
        return replace(changed, aside=before)


class SetProjection(Command):
    """Perspective or parallel; the model stays where it is and as large."""

    projection: Projection

    def __call__(self, session: Session) -> Session:
        own, pose = session.document, session.document.pose
        start = own.start.camera
        fallback = start if isinstance(start, Perspective) else own.photo.default_camera()
        fallback = replace(fallback, cx=pose.camera.cx, cy=pose.camera.cy)
        seen = with_projection(pose, self.projection, fallback, own.mesh.centre)
        return session if seen is pose else session.with_pose(seen)


class SetCamera(Command):
    """Intrinsics in px, as OpenCV has them (pixel centres at integers)."""

    fx: float
    fy: float
    cx: float
    cy: float

    def __call__(self, session: Session) -> Session:
        pose, centre = session.document.pose, session.document.mesh.centre
        camera = camera_from_numbers(self.fx, self.fy, self.cx, self.cy, pose.camera)
        return session.with_pose(with_camera(pose, camera, centre))


class SetFieldOfView(Command):
    """Equal focal lengths from the view of the photo's longer side; the centre stays."""

    degrees: float

    def __call__(self, session: Session) -> Session:
        require_field_of_view(self.degrees)
        now = camera_as_integer_centres(session.document.pose.camera)
        camera = Perspective.from_field_of_view(self.degrees, now.width, now.height)
        return SetCamera(camera.fx, camera.fy, now.cx, now.cy)(session)


# --- quick starts: marks and proposals ----------------------------------------------------------


class RemoveMark(Command):
    """Take the last mark of the tool at hand away: half a point pair, or a point of a rim."""

    def __call__(self, session: Session) -> Session:
        document = without_last(session.document, session.tool)
        return session if document is session.document else session.with_document(document)


class ClearMarks(Command):
    """Take all marks of the tool at hand away."""

    def __call__(self, session: Session) -> Session:
        document = without_marks(session.document, session.tool)
        return session if document is session.document else session.with_document(document)


class LayWheels(Command, eq=False):
    """Ellipses that were found: marks on both rims, and the pose that they give."""

    photo: Photo
    mesh: Mesh
    """The model that they were found for."""
    rear: Ellipse
    front: Ellipse
    pose: Pose

    def __call__(self, session: Session) -> Session:
        document = session.document
        if document.photo is not self.photo or document.mesh is not self.mesh:
            raise QuickStartError(
                "The wheels were found in another photo or for another model; look for them again."
            )
        rims = (*self.rear.outline(FEWEST_RIM_POINTS), *self.front.outline(FEWEST_RIM_POINTS))
        marked = document.with_marks(rims=rims, note="")
        return session.with_document(marked.at_pose(self.pose))


class ProposeStarts(Command):
    """Look for start poses, in the rectangle about the object."""

    def __call__(self, session: Session) -> Session:
        if session.proposals is not None and session.proposals.running:
            return session
        number = session.proposals_asked + 1
        tool = "pose" if session.tool == "box" else session.tool
        asked = ProposedStarts(number, session.document)
        return replace(session, proposals_asked=number, proposals=asked, tool=tool)


class StopProposing(Command):
    """Look for start poses no more."""

    def __call__(self, session: Session) -> Session:
        asked = session.proposals
        return session if asked is None or not asked.running else replace(session, proposals=None)


class StartsProposed(Command, eq=False):
    """What came of the ``number``-th asking: poses, the likeliest first."""

    number: int
    poses: tuple[Pose, ...]

    def __call__(self, session: Session) -> Session:
        asked = session.proposals
        if asked is None or asked.number != self.number or not asked.running:
            return session
        if not asked.document.shows_same(session.document):  # another photo or model by now
            return replace(session, proposals=None)
        return _with_proposal(session, replace(asked, running=False, poses=self.poses), 0)


class ProposingFailed(Command):
    """Why nothing came of the ``number``-th asking."""

    number: int
    reason: str

    def __call__(self, session: Session) -> Session:
        if session.proposals is None or session.proposals.number != self.number:
            return session
        return replace(session, proposals=None).with_error(self.reason)


class StepProposals(Command):
    """Show another proposal: ``by`` places on, round and round."""

    by: int = 1

    def __call__(self, session: Session) -> Session:
        asked = session.proposals
        if asked is None or not asked.poses or not asked.document.shows_same(session.document):
            return session
        return _with_proposal(session, asked, (asked.index + self.by) % len(asked.poses))


class TakeProposal(Command):
    """The proposal that is shown becomes the start pose."""

    def __call__(self, session: Session) -> Session:
        asked = session.proposals
        if asked is None or not asked.poses:
            return session
        document = session.document.at_pose(asked.poses[asked.index]).started
        same_step = asked.shown is session.document
        return replace(session.with_document(document, same_step), proposals=None)


def _with_proposal(session: Session, asked: ProposedStarts, index: int) -> Session:
    document = put(session.document, asked.poses[index])
    # One step back leads to before all proposals.
    session = session.with_document(document, same_step=asked.shown is session.document)
    return replace(session, proposals=replace(asked, index=index, shown=document))


# --- searches and maps --------------------------------------------------------------------------


class StartSearch(Command):
    """Search for the active object from the pose at hand."""

    def __call__(self, session: Session) -> Session:
        document = session.document
        return _searching(session, document, (document.settings,), (document.active,))


class SearchAll(Command):
    """Search for all objects in turn, each from the pose at hand, until none improves; those that
    are locked stay where they are.
    """

    def __call__(self, session: Session) -> Session:
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


class CompareMethods(Command):
    """Search from the start pose by both methods, by the one that is chosen last."""

    def __call__(self, session: Session) -> Session:
        document = session.document
        methods = sorted(METHODS, key=lambda method: method == document.settings.method)
        settings = tuple(session.settings_by(method) for method in methods)
        return _searching(session, document.reset, settings, (document.active,))


def _searching(
    session: Session, start: Document, methods: tuple[FitSettings, ...], indices: tuple[int, ...]
) -> Session:
    """With a new search, unless one is running."""
    if session.searching:
        return session
    if session.preparation is not None and session.preparation.trouble:
        raise SettingsError(session.preparation.trouble)
    number, document = session.searches + 1, session.document
    if document.object.locked and indices == (document.active,):
        raise SettingsError(f"{label_of(document.object)} is locked: {UNLOCK} to search")
    return replace(
        session,
        searches=number,
        search=Search(number, start, methods, indices),
        history=session.history.with_step(document),
        anchor=start.scene,
        drag=None,
        before_drag=None,
    )


class TakeEnd(Command):
    """Where a method of the last comparison ended, as if it alone had been searched by."""

    index: int

    def __call__(self, session: Session) -> Session:
        if not 0 <= self.index < len(session.ends):
            return session
        end, before = session.ends[self.index], session.document
        document = found_at(before, end.update).with_object(settings=end.settings)
        taken = session.with_document(document)
        if end.settings.method != before.settings.method:
            taken = replace(taken, aside=before.settings)
        start, settings = before.reset, (end.settings,)
        ended = Search(session.searches, start, settings, (before.active,), False, end.update)
        return replace(taken, search=ended, anchor=start.scene)


class StopSearch(Command):
    """Stop; the best pose so far is kept. One that has not begun is as if never asked for."""

    def __call__(self, session: Session) -> Session:
        if session.search is None or not session.search.running:
            return session
        if session.preparation is not None:
            return RevertSearch()(session)
        return replace(session, search=replace(session.search, running=False))


class AcceptSearch(Command):
    """Keep what the search found, and put the search away."""

    def __call__(self, session: Session) -> Session:
        return replace(session, search=None, proposals=None, anchor=session.document.scene)


class RevertSearch(Command):
    """Back to the pose before the search; one that runs is stopped."""

    goes_back = True

    def __call__(self, session: Session) -> Session:
        return session if session.search is None else Undo()(session)


class SearchAdvanced(WorkerUpdate, eq=False):
    """A worker's update of search ``number``."""

    number: int
    update: SearchUpdate

    def __call__(self, session: Session) -> Session:
        search = session.search
        if search is None or search.number != self.number or not search.running:
            return session
        latest = self.update
        found = replace(search, latest=latest, running=not latest.is_over)
        document = found_at(session.document, latest)
        return replace(session, document=document, search=found, ends=latest.ends or session.ends)


def found_at(document: Document, update: SearchUpdate) -> Document:
    """The document where a search is, or has ended."""
    for index, placing in update.placings.items():
        result = update.results.get(index)
        document = document.at_progress(index, placing.problem, placing.progress, result)
    is_seen = is_in_sight(document)
    return document if is_seen else document.with_view(update.problem.views[0].index)


class SearchFailed(DragCommand, eq=False):
    """Search ``number`` could not be run."""

    number: int
    reason: str

    def __call__(self, session: Session) -> Session:
        if session.search is None or session.search.number != self.number:
            return session
        return RevertSearch()(session).with_error(self.reason)


class PreparationAdvanced(WorkerUpdate, eq=False):
    """What is still made ready by now (None: nothing more), or why it cannot be."""

    preparation: Preparation | None

    def __call__(self, session: Session) -> Session:
        trouble = "" if self.preparation is None else self.preparation.trouble
        if trouble:
            waited = RevertSearch()(session) if session.searching else session
            session = replace(waited, proposals=None).with_error(trouble)
        return replace(session, preparation=self.preparation)


class LandscapeAdvanced(WorkerUpdate, eq=False):
    """A worker's update of the maps, for each loss that is shown."""

    update: tuple[LandscapeUpdate, ...]

    def __call__(self, session: Session) -> Session:
        stays = all(maps.document.shows_same(session.document) for maps in self.update)
        return replace(session, landscapes=self.update) if stays else session


class PickInLandscape(Command):
    """A point (u, v) of a map, in [0, 1] from its lower left corner: the pose goes there."""

    first: int
    second: int
    u: float
    v: float

    def __call__(self, session: Session) -> Session:
        # Maps of two losses are about one pose, and as wide.
        for maps in session.landscapes:
            for piece in maps.slices:
                if (piece.first, piece.second) == (self.first, self.second):
                    parameters = picked_parameters(piece, maps.parameters, self.u, self.v)
                    view = maps.case.problem.views[0]
                    found = session.document.at_numbers(view.chart, parameters, view.index)
                    return session.with_document(found)
        return session


def picked_parameters(piece: Slice, centre: FloatArray, u: float, v: float) -> FloatArray:
    """(d,): the parameters at a press on a map through ``centre`` (d,).

    ``u`` and ``v`` are the place from the map's left and lower border as a share of its side;
    beyond 0 and 1 the border is meant. Nothing snaps to the grid.
    """
    parameters = np.array(centre, dtype=float)
    u, v = (min(max(float(share), 0.0), 1.0) for share in (u, v))
    x, y = piece.first_values, piece.second_values
    parameters[piece.first] = x[0] + u * (x[-1] - x[0])
    parameters[piece.second] = y[0] + v * (y[-1] - y[0])
    return parameters


# --- how it is looked at ------------------------------------------------------------------------


class ChangeView(DragCommand):
    """How the model is shown; None leaves as it is."""

    name: str | None = None
    opacity: float | None = None
    hidden: bool | None = None

    def __call__(self, session: Session) -> Session:
        changes = self.given("name", "opacity", "hidden")
        return replace(session, look=replace(session.look, **changes))


class ChangeLandscape(DragCommand):
    """How the maps are drawn; None leaves as it is."""

    half_width: float | None = None
    large: tuple[int, int] | None = None
    """The pair whose map becomes large, or small again."""
    whose: Whose | None = None

    def __call__(self, session: Session) -> Session:
        changes = self.given("half_width", "large", "whose")
        if self.large is not None and self.large == session.maps.large:
            changes["large"] = None
        return replace(session, maps=replace(session.maps, **changes))


class OverlayDrawn(WorkerUpdate, eq=False):
    """A worker has drawn the model; until its loss is known, that of the last drawing is shown."""

    overlay: Overlay

    def __call__(self, session: Session) -> Session:
        new, old = self.overlay, session.overlay
        if not new.loss_is_current and old is not None:
            current = old.request.has_loss_of(new.request) and old.loss_is_current
            new = replace(new, losses=old.losses, loss_is_current=current)
        return replace(session, overlay=new)


class LossComputed(WorkerUpdate, eq=False):
    """A worker knows the loss of a pose that is, or a moment ago was, drawn."""

    overlay: Overlay

    def __call__(self, session: Session) -> Session:
        new, old = self.overlay, session.overlay
        if old is None or old.loss_is_current:
            return session
        current = old.request.has_loss_of(new.request)
        known = replace(old, losses=new.losses, loss_is_current=current)
        return replace(session, overlay=known)
