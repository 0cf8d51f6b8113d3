"""Quick starts in the app: marks are set, moved and removed, and the pose follows from them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document
from poseviewer.app.state.marks import WHEELS, Marks, Pair
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.starts.placing import surface_point
from poseviewer.starts.point_pairs import (
    FEWEST_FOR_FOCAL,
    fewest_pairs,
    fit_of,
    focal_from_pairs,
    likeliest,
    poses_from_pairs,
)
from poseviewer.vehicle.ellipses import FEWEST_RIM_POINTS
from poseviewer.vehicle.wheel_pose import Wheels, poses_from_wheels

MarkCommand = c.Press | c.DoublePress | c.RemoveMark | c.ClearMarks | c.LayWheels
MARKING = ("pairs", "wheels")
"""The tools with which a press sets a mark."""
MARK_REACH = 12.0
"""A mark is taken within so many px of the screen."""
MOST_PAIRS = 24


@dataclass(frozen=True, slots=True, eq=False)
class MarkDrag:
    """A mark that follows the pointer; of point pairs the pose follows at once."""

    tool: str
    mark: int
    offset: FloatArray
    """(2,): from the pointer to the mark, when it was taken."""

    def apply(self, document: Document, point: FloatArray) -> Document:
        """The mark at ``point`` (2,), px of the photo."""
        place, marks = point + self.offset, document.marks
        if self.tool == "wheels":
            rims = (*marks.rims[: self.mark], place, *marks.rims[self.mark + 1 :])
            return replace(document, marks=replace(marks, rims=rims))
        moved = replace(marks.pairs[self.mark], pixel=place)
        pairs = (*marks.pairs[: self.mark], moved, *marks.pairs[self.mark + 1 :])
        return solved(replace(document, marks=replace(marks, pairs=pairs)), self.tool)


def marks_in_photo(marks: Marks, tool: str) -> FloatArray:
    """(n, 2): where the marks of a tool are, px."""
    return np.array(marks.rims).reshape(-1, 2) if tool == "wheels" else marks.pixels


def mark_step(document: Document, tool: str, command: MarkCommand) -> Document | MarkDrag:
    """What a press, a double press or a button does with a marking tool: another document, the
    same one where nothing is to be done, or a mark taken hold of.

    Raises:
        QuickStartError: nothing can be marked there.
    """
    if isinstance(command, c.RemoveMark):
        return without_last(document, tool)
    if isinstance(command, c.ClearMarks):
        return without_marks(document, tool)
    if isinstance(command, c.LayWheels):
        return with_wheels(document, command)
    point = np.array([command.x, command.y])
    drag = mark_at(document, tool, point, command.zoom)
    if isinstance(command, c.DoublePress):
        return document if drag is None else _without(document, tool, drag.mark)
    return marked(document, tool, point) if drag is None else drag


def mark_at(document: Document, tool: str, point: FloatArray, zoom: float) -> MarkDrag | None:
    """The mark within reach of ``point``; ``zoom``: screen px per photo px. While a pair waits for
    its place in the photo there is none: marks may lie close together.
    """
    if tool == "pairs" and document.marks.waits_for_pixel:
        return None
    places = marks_in_photo(document.marks, tool)
    if not len(places):
        return None
    away = np.linalg.norm(places - point, axis=1) * zoom
    nearest = int(np.argmin(away))
    if away[nearest] > MARK_REACH:
        return None
    return MarkDrag(tool, nearest, places[nearest] - point)


def marked(document: Document, tool: str, point: FloatArray) -> Document:
    """With one more mark at ``point`` (2,), and the pose that follows, if one does.

    Raises:
        QuickStartError: nothing can be marked there.
    """
    marks = document.marks
    if tool == "wheels":
        return _with_rim_point(document, point)
    if marks.waits_for_pixel:
        pairs = (*marks.pairs[:-1], replace(marks.pairs[-1], pixel=point))
        return solved(replace(document, marks=replace(marks, pairs=pairs)), tool)
    if len(marks.pairs) == MOST_PAIRS:
        raise QuickStartError(f"{MOST_PAIRS} point pairs are enough; remove one first.")
    found = surface_point(document.registration.mesh, document.pose, point)
    if found is None:
        raise QuickStartError("There is no model there; click a point of the model as it is drawn.")
    return replace(document, marks=replace(marks, pairs=(*marks.pairs, Pair(found)), note=""))


def _with_rim_point(document: Document, point: FloatArray) -> Document:
    marks = document.marks
    if document.registration.keypoints is None:
        raise QuickStartError(
            "The model has no wheels that poseviewer knows of; give MODEL.keypoints.json beside "
            "it, or use point pairs."
        )
    if len(marks.rims) == WHEELS * FEWEST_RIM_POINTS:
        raise QuickStartError("Both wheels are outlined; drag their points, or clear them.")
    marks = replace(marks, rims=(*marks.rims, point))
    return solved(replace(document, marks=marks), "wheels")


def with_wheels(document: Document, found: c.LayWheels) -> Document:
    """With five marks on each ellipse that was found, in place of those on rims before, and its
    pose.

    Raises:
        QuickStartError: another photo or model is open by now.
    """
    now, then = document.registration, found.registration
    if now.photo is not then.photo or now.mesh is not then.mesh:
        raise QuickStartError(
            "The wheels were found in another photo or for another model; look for them again."
        )
    rims = (*found.rear.outline(FEWEST_RIM_POINTS), *found.front.outline(FEWEST_RIM_POINTS))
    marks = replace(document.marks, rims=rims, note="")
    return replace(document, marks=marks, pose=found.pose)


def without_last(document: Document, tool: str) -> Document:
    """Without the last mark of a tool; half a pair goes alone. The same object if there is none."""
    marks = document.marks
    if tool == "pairs" and marks.waits_for_pixel:
        return replace(document, marks=replace(marks, pairs=marks.pairs[:-1]))
    count = len(marks.rims if tool == "wheels" else marks.pairs)
    return _without(document, tool, count - 1) if count else document


def without_marks(document: Document, tool: str) -> Document:
    """Without all marks of a tool; the pose stays."""
    marks = document.marks
    if not (marks.rims if tool == "wheels" else marks.pairs):
        return document
    kept = replace(marks, rims=()) if tool == "wheels" else replace(marks, pairs=())
    return replace(document, marks=replace(kept, note=""))


def _without(document: Document, tool: str, index: int) -> Document:
    marks = document.marks
    if tool == "wheels":
        rims = (*marks.rims[:index], *marks.rims[index + 1 :])
        return solved(replace(document, marks=replace(marks, rims=rims)), tool)
    pairs = (*marks.pairs[:index], *marks.pairs[index + 1 :])
    return solved(replace(document, marks=replace(marks, pairs=pairs)), tool)


def solved(document: Document, tool: str) -> Document:
    """With the pose that the marks of a tool give; where they give none it stays, with a note."""
    marks = replace(document.marks, note="")
    try:
        pose = _pose_of_wheels(document) if tool == "wheels" else _pose_of_pairs(document)
    except QuickStartError as error:
        return replace(document, marks=replace(marks, note=str(error)))
    return replace(document, marks=marks, pose=pose or document.pose)


def _pose_of_pairs(document: Document) -> Pose | None:
    """The pose, and with a free focal length and enough pairs the camera; None: too few yet."""
    marks, pose = document.marks, document.pose
    points, pixels = marks.points, marks.pixels
    if len(points) < fewest_pairs(pose.camera):
        return None
    free = document.settings.free_focal and isinstance(pose.camera, Perspective)
    if free and len(points) >= FEWEST_FOR_FOCAL:
        assert isinstance(pose.camera, Perspective)
        return focal_from_pairs(points, pixels, pose.camera).fit.pose
    fits = poses_from_pairs(points, pixels, pose.camera)
    return likeliest(fits, points, document.registration.mesh, pose).pose


def _pose_of_wheels(document: Document) -> Pose | None:
    """The pose of two wheels; None: they are not both outlined yet."""
    ellipses = document.marks.ellipses
    keypoints = document.registration.keypoints
    if len(ellipses) < WHEELS or keypoints is None:
        return None
    return poses_from_wheels(Wheels(*ellipses), keypoints, document.pose.camera)[0].pose


def pair_errors(document: Document) -> FloatArray:
    """(n,): how far, in px, each pair that is done is off at the pose at hand."""
    marks = document.marks
    return fit_of(document.pose, marks.points, marks.pixels).errors_px
