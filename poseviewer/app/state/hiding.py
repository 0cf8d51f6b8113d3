"""Pixels that do not count, painted over, and parts of the model that are left out."""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.fit.compared_pixels import enlarge_mask
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.starts.placing import surface_hit

Shape = Literal["brush", "polygon", "scribble"]
SHAPES: tuple[Shape, ...] = ("brush", "polygon", "scribble")
HIDING = (*SHAPES, "part")
"""The tools: three that draw on the photo, and one that takes a part of the model."""
SUBPIXEL_BITS = 4
"""Binary digits after the point of OpenCV's coordinates: sixteenths of a pixel."""
MAX_THICKNESS = 32767
"""px: OpenCV draws no thicker line."""
MAX_CORNERS = 4000
"""Corners of a polygon that are filled: OpenCV's time grows with the square of its crossings."""


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A stroke drawn on the photo in one go."""

    shape: Shape
    points: FloatArray
    """(n, 2), px: along the line, or the polygon's corners."""
    radius: float
    """Half the line's width, px."""
    erase: bool = False
    """Whether what is covered counts again."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", freeze_array(self.points, (-1, 2)))

    def covers(self, width: int, height: int) -> NDArray[np.bool_]:
        """(height, width): what lies below the line, or inside the polygon."""
        canvas = np.zeros((height, width), np.uint8)
        # OpenCV's pixel centres are at integers.
        places = np.rint((self.points - 0.5) * 2**SUBPIXEL_BITS).astype(np.int32)
        if self.shape == "polygon":
            corners = places[:: -(-len(places) // MAX_CORNERS)]
            cv2.fillPoly(canvas, [corners], 1, shift=SUBPIXEL_BITS)
            return canvas > 0
        thickness = min(max(round(2.0 * self.radius), 1), MAX_THICKNESS)
        first, radius = places[0].tolist(), max(self.radius, 0.5) * 2**SUBPIXEL_BITS
        cv2.circle(canvas, first, round(radius), 1, cv2.FILLED, shift=SUBPIXEL_BITS)
        cv2.polylines(canvas, [places], False, 1, thickness, shift=SUBPIXEL_BITS)
        return canvas > 0


@edit
def paint(session: Session, stroke: Stroke) -> Session:
    """Hide what a stroke covers, or bring it back."""
    photo = session.document.photo
    return paint_found(photo, stroke.covers(photo.width, photo.height), stroke.erase)(session)


@edit
def paint_found(
    session: Session, photo: Photo, where: NDArray[np.bool_], erase: bool = False
) -> Session:
    """Hide pixels ``where`` (height, width) that were found for a photo, or bring them back."""
    document, is_own = session.document, is_for_one(session)
    if document.photo is not photo:  # another one by now
        return session
    for own in (True,) if is_own else (False, True) if erase else (False,):
        mask = document.own.mask if own else document.view.mask
        before = np.ones((photo.height, photo.width), np.float32) if mask is None else mask.weights
        weights = np.where(where, np.float32(erase), before)
        if not np.array_equal(weights, before):
            mask = None if np.all(weights == 1.0) else Mask.of(weights)
            document = document.with_mask(mask, own)
    if document is not session.document:
        if document.settings.in_front == "nothing" and not erase:
            settings = replace(document.settings, in_front="painted")
            document = document.with_object(settings=settings)
        session = session.with_document(document)
    return forget_strokes()(session)


@drag_edit
def forget_strokes(session: Session) -> Session:
    """Have pages forget the strokes that they still show: those are taken, or were in vain."""
    return replace(session, pen=replace(session.pen, strokes=session.pen.strokes + 1))


@edit
def toggle_hiding(session: Session) -> Session:
    """Take the brush that hides, or put the tools that hide away."""
    return replace(session, tool="pose" if session.tool in HIDING else "brush")


@edit
def unhide(session: Session) -> Session:
    """Let all pixels count again, or those that the active object alone has hidden."""
    document, is_own = session.document, is_for_one(session)
    if not any(masks_of(session)[is_own:]):
        return session
    document = document.with_mask(None, own=True)
    return session.with_document(document if is_own else document.with_mask(None))


@edit
def leave_out(session: Session, x: float, y: float) -> Session:
    """Leave out the part of the model that is seen at a point of the photo."""
    document = session.document
    mesh = document.mesh
    hit = surface_hit(mesh, document.pose, np.array([x, y]))
    if hit is None:
        raise QuickStartError("There is no model there; press on the part to be left out.")
    part = mesh.part_names[mesh.face_part[hit[0]]]
    return session.with_document(document.without_parts([*mesh.left_out, part]))


@edit
def bring_back(session: Session, index: int) -> Session:
    """Bring back a part that was left out, by its place among them."""
    mesh = session.document.mesh
    if not 0 <= index < len(mesh.left_out):
        return session
    left = [name for i, name in enumerate(mesh.left_out) if i != index]
    return session.with_document(session.document.without_parts(left))


@edit
def hide_found(session: Session) -> Session:
    """Hide what the search took for something in front, to be corrected."""
    in_front, document = occluded_pixels(session), session.document
    if in_front is None:
        return session
    result, at = document.object.result, document.view_index
    if result is not None:  # the same pixels were compared
        hidden = (*result.hidden[:at], None, *result.hidden[at + 1 :])
        document = document.with_object(result=replace(result, hidden=hidden))
    mask = document.own.mask
    weights = ~in_front if mask is None else mask.weights * ~in_front
    return session.with_document(document.with_own(mask=Mask.of(weights)))


def is_for_one(session: Session) -> bool:
    """Whether strokes are about the active one of several objects alone."""
    return session.pen.for_one and len(session.document.scene.objects) > 1


def masks_of(session: Session) -> tuple[Mask | None, Mask | None]:
    """The masks of the large photo, and of the active object alone there."""
    return session.document.view.mask, session.document.own.mask


def occluded_pixels(session: Session) -> NDArray[np.bool_] | None:
    """(height, width): what the search that led to the pose at hand took for something in front."""
    own, progress = session.document, session.own_progress
    if own.object.result is not None:
        return own.object.result.hidden[own.view_index] if own.object.result.hidden else None
    if progress is None or session.is_searching:
        return None
    # The search was stopped.
    view = next(view for view in progress.problem.views if view.view_index == own.view_index)
    if view.occluded is None:
        return None
    return enlarge_mask(view.occluded, view.photo.factor, own.photo.width, own.photo.height)
