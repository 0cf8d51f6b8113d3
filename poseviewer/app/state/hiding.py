"""Edits that mask pixels by strokes, and leave out parts of the model."""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.app.state.document import MaskKind
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.fit.compared_pixels import enlarge_mask
from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.image import Photo
from poseviewer.geometry.mask import Mask
from poseviewer.geometry.placing import surface_hit

Shape = Literal["brush", "polygon", "scribble"]
SHAPES: tuple[Shape, ...] = ("brush", "polygon", "scribble")
KINDS: tuple[MaskKind, ...] = ("photo", "object", "found")
"""Kinds of masks, the user's first, and first those for all objects."""
HIDING = (*SHAPES, "part")
"""Tools: three that draw on the photo, and one that leaves out a part of the model."""
SUBPIXEL_BITS = 4
"""Binary digits of OpenCV's subpixel coordinates: sixteenths of a pixel."""
MAX_THICKNESS_PX = 32767
"""Thickest line that OpenCV draws."""
MAX_CORNERS = 4000
"""Corners to which polygons are thinned: OpenCV's time grows with the square of crossings."""


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A stroke on the photo."""

    shape: Shape
    points: FloatArray
    """(n, 2), px: the line's, or the polygon's corners."""
    radius: float
    """Half the line's width, px."""
    erase: bool = False
    """Whether the stroke unmasks pixels."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", freeze_array(self.points, (-1, 2)))

    def covers(self, width: int, height: int) -> NDArray[np.bool_]:
        """(height, width): pixels under the line, or inside the polygon."""
        canvas = np.zeros((height, width), np.uint8)
        # OpenCV's pixel centres are at integers.
        points = np.rint((self.points - 0.5) * 2**SUBPIXEL_BITS).astype(np.int32)
        if self.shape == "polygon":
            corners = points[:: -(-len(points) // MAX_CORNERS)]
            cv2.fillPoly(canvas, [corners], 1, shift=SUBPIXEL_BITS)
            return canvas > 0
        thickness = min(max(round(2.0 * self.radius), 1), MAX_THICKNESS_PX)
        first, radius = points[0].tolist(), max(self.radius, 0.5) * 2**SUBPIXEL_BITS
        cv2.circle(canvas, first, round(radius), 1, cv2.FILLED, shift=SUBPIXEL_BITS)
        cv2.polylines(canvas, [points], False, 1, thickness, shift=SUBPIXEL_BITS)
        return canvas > 0


@edit
def paint(session: Session, stroke: Stroke) -> Session:
    """Mask or unmask the pixels under a stroke."""
    photo = session.document.photo
    return mask_pixels(photo, stroke.covers(photo.width, photo.height), stroke.erase)(session)


@edit
def mask_pixels(
    session: Session, photo: Photo, pixels: NDArray[np.bool_], erase: bool = False
) -> Session:
    """Mask or unmask pixels of the large photo, for all objects or for the active one alone.

    Args:
        session: before the edit.
        photo: that the pixels were chosen in; nothing changes if another is shown now.
        pixels: (height, width).
        erase: unmask them.
    """
    document, is_own = session.document, masks_one_object(session)
    if document.photo is not photo:
        return session
    # Strokes are added to the first kind, and erased from all.
    for kind, all_frames in _masks(session, is_own)[: None if erase else 1]:
        mask = document.mask_of(kind, all_frames)
        before = np.ones((photo.height, photo.width), np.float32) if mask is None else mask.weights
        weights = np.where(pixels, np.float32(erase), before)
        if not np.array_equal(weights, before):
            mask = None if np.all(weights == 1.0) else Mask.of(weights)
            document = document.with_mask(mask, kind, all_frames)
    if document is not session.document:
        if document.settings.in_front == "nothing" and not erase:
            settings = replace(document.settings, in_front="painted")
            document = document.with_object(settings=settings)
        session = session.with_document(document)
    return forget_strokes()(session)


@drag_edit
def forget_strokes(session: Session) -> Session:
    """Have pages remove the strokes that they draw, which are masked by now, or failed."""
    return replace(session, pen=replace(session.pen, strokes=session.pen.strokes + 1))


@edit
def toggle_hiding(session: Session) -> Session:
    """Take the brush, or leave the tools that mask."""
    return replace(session, tool="pose" if session.tool in HIDING else "brush")


@edit
def unhide(session: Session) -> Session:
    """Unmask all pixels, or those that are masked for the active object alone."""
    document = session.document
    for kind, all_frames in _masks(session, masks_one_object(session)):
        if document.mask_of(kind, all_frames) is not None:
            document = document.with_mask(None, kind, all_frames)
    return session if document is session.document else session.with_document(document)


@edit
def hide_in_all_frames(session: Session) -> Session:
    """Hide in all frames of a sequence what is painted in the one that is shown."""
    document = session.document
    for kind in KINDS[:2]:
        mask = document.mask_of(kind)
        if session.document.scene.frames and mask is not None:
            known = document.mask_of(kind, all_frames=True)
            both = Mask.product([mask] if known is None else [known, mask])
            document = document.put_mask(None, kind).put_mask(both, kind, all_frames=True)
    return session if document is session.document else session.with_document(document)


@edit
def leave_out(session: Session, x: float, y: float) -> Session:
    """Leave out the part of the model at a pixel."""
    document = session.document
    mesh = document.mesh
    hit = surface_hit(mesh, document.pose, np.array([x, y]))
    if hit is None:
        raise QuickStartError("There is no model there; press on the part to be left out.")
    part = mesh.part_names[mesh.face_part[hit[0]]]
    return session.with_document(document.without_parts([*mesh.left_out, part]))


@edit
def bring_back(session: Session, index: int) -> Session:
    """Bring back a part by its index among those left out."""
    mesh = session.document.mesh
    if not 0 <= index < len(mesh.left_out):
        return session
    left = [name for i, name in enumerate(mesh.left_out) if i != index]
    return session.with_document(session.document.without_parts(left))


@edit
def hide_found(session: Session) -> Session:
    """Mask the pixels that the search took for occluders, for the user to correct."""
    occluded, document = occlusion_pixels(session), session.document
    if occluded is None:
        return session
    result, mask = document.object.result, document.mask_of("object")
    if result is not None and result.hidden:  # stays valid: the same pixels were compared
        hidden = list(result.hidden)
        hidden[document.view_index] = None
        document = document.with_result(replace(result, hidden=tuple(hidden)))
    weights = ~occluded if mask is None else mask.weights * ~occluded
    document = document.put_mask(Mask.of(weights), "object").put_mask(None, "found")
    return session.with_document(document)


def masks_one_object(session: Session) -> bool:
    """Whether strokes mask pixels for the active one of several objects alone."""
    return session.pen.for_one and len(session.document.scene.objects) > 1


def _masks(session: Session, is_own: bool) -> list[tuple[MaskKind, bool]]:
    """Kinds of masks of the large photo, or of the active object alone in it, and whether each is
    one of all frames.
    """
    layers = (False, True) if session.document.scene.frames else (False,)
    return [(kind, all_frames) for kind in KINDS[is_own:] for all_frames in layers]


def masks_of(session: Session) -> tuple[Mask | None, ...]:
    """The user's masks of the large photo, for all objects and for the active one alone."""
    masks = _masks(session, is_own=False)
    return tuple(session.document.mask_of(*which) for which in masks if which[0] != "found")


def occlusion_pixels(session: Session) -> NDArray[np.bool_] | None:
    """(height, width): pixels that searches for the active object took for occluders."""
    document = session.document
    now = _pixels_of_search(session)
    found = Mask.product((*document.occluders, *(() if now is None else (Mask.of(~now),))))
    return None if found is None else found.weights == 0.0


def _pixels_of_search(session: Session) -> NDArray[np.bool_] | None:
    """(height, width): pixels that the search for the current pose took for occluders."""
    document, progress = session.document, session.own_progress
    result, view_index = document.object.result, document.view_index
    if result is not None:
        return result.hidden[view_index] if result.hidden else None
    if progress is None or session.is_searching:
        return None
    # The search was stopped.
    view = next(view for view in progress.problem.views if view.view_index == view_index)
    if view.occluded is None:
        return None
    photo = document.photo
    return enlarge_mask(view.occluded, view.photo.factor, photo.width, photo.height)
