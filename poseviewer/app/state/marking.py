"""Quick starts in the app: marks are set, moved and removed, and the pose follows from them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from poseviewer.app.state.document import UNLOCK, WHEELS, Document, Marks, Pair, label_of
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
from poseviewer.vehicle.wheel_pose import FEWEST_RIM_POINTS, Wheels, poses_from_wheels

MARKING = ("pairs", "wheels")
"""The tools with which a press sets a mark."""
MARK_REACH = 12.0
"""A mark is taken within this distance (px of the screen)."""
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
        place, marks = point + self.offset, _marks_of(document, self.tool)
        new = place if self.tool == "wheels" else replace(marks[self.mark], pixel=place)
        marks = (*marks[: self.mark], new, *marks[self.mark + 1 :])
        document = _with_marks(document, self.tool, marks)
        return document if self.tool == "wheels" else solved(document, self.tool)


def marks_in_photo(marks: Marks, tool: str) -> FloatArray:
    """(n, 2): where the marks of a tool are, px."""
    return np.array(marks.rims).reshape(-1, 2) if tool == "wheels" else marks.correspondences[1]


def mark_at(document: Document, tool: str, point: FloatArray, zoom: float) -> MarkDrag | None:
    """The mark within reach of ``point``; ``zoom``: screen px per photo px. While a pair waits for
    its place in the photo there is none: marks may lie close together.
    """
    places = marks_in_photo(document.marks, tool)
    if not len(places) or (tool == "pairs" and document.marks.waits_for_pixel):
        return None
    away = np.linalg.norm(places - point, axis=1) * zoom
    nearest = int(np.argmin(away))
    if away[nearest] > MARK_REACH:
        return None
    return MarkDrag(tool, nearest, places[nearest] - point)


def with_mark(document: Document, tool: str, point: FloatArray) -> Document:
    """With one more mark at ``point`` (2,), and the pose that follows, if one does.

    Raises:
        QuickStartError: nothing can be marked there.
    """
    marks = document.marks
    if tool == "wheels":
        if document.model.keypoints is None:
            raise QuickStartError(
                "The model has no wheels that poseviewer knows of; give MODEL.keypoints.json "
                "beside it, or use point pairs."
            )
        if len(marks.rims) == WHEELS * FEWEST_RIM_POINTS:
            raise QuickStartError("Both wheels are outlined; drag their points, or clear them.")
        return solved(_with_marks(document, tool, (*marks.rims, point)), tool)
    if marks.waits_for_pixel:
        pairs = (*marks.pairs[:-1], replace(marks.pairs[-1], pixel=point))
        return solved(_with_marks(document, tool, pairs), tool)
    if len(marks.pairs) == MOST_PAIRS:
        raise QuickStartError(f"{MOST_PAIRS} point pairs are enough; remove one first.")
    found = surface_point(document.mesh, document.pose, point)
    if found is None:
        raise QuickStartError("There is no model there; click a point of the model as it is drawn.")
    return document.with_marks(pairs=(*marks.pairs, Pair(found)), note="")


def without_mark(document: Document, tool: str, index: int) -> Document:
    """Without a mark of a tool, and the pose that follows from the others, if one does."""
    marks = _marks_of(document, tool)
    return solved(_with_marks(document, tool, (*marks[:index], *marks[index + 1 :])), tool)


def without_last(document: Document, tool: str) -> Document:
    """Without the last mark of a tool; half a pair goes alone. The same object if there is none."""
    marks = _marks_of(document, tool)
    if tool == "pairs" and document.marks.waits_for_pixel:
        return _with_marks(document, tool, marks[:-1])
    return without_mark(document, tool, len(marks) - 1) if marks else document


def without_marks(document: Document, tool: str) -> Document:
    """Without all marks of a tool; the pose stays. The same object if there are none."""
    if not _marks_of(document, tool):
        return document
    return _with_marks(document, tool, ()).with_marks(note="")


def solved(document: Document, tool: str) -> Document:
    """With the pose that the marks of a tool give; where they give none it stays, with a note."""
    try:
        pose = _pose_of_wheels(document) if tool == "wheels" else _pose_of_pairs(document)
    except QuickStartError as error:
        return document.with_marks(note=str(error))
    if pose is not None and document.object.locked:
        note = f"{label_of(document.object)} is locked: {UNLOCK} to move it."
        return document.with_marks(note=note)
    return (document if pose is None else document.at_pose(pose)).with_marks(note="")


def pairs_done(document: Document) -> int:
    """Count the finished pairs."""
    return len(document.marks.correspondences[0])


def pair_errors(document: Document) -> FloatArray:
    """(n,): how far, in px, each pair that is done is off at the pose at hand."""
    return fit_of(document.pose, *document.marks.correspondences).errors_px


def _marks_of(document: Document, tool: str) -> tuple:
    return document.marks.rims if tool == "wheels" else document.marks.pairs


def _with_marks(document: Document, tool: str, marks: tuple) -> Document:
    return document.with_marks(**{"rims" if tool == "wheels" else "pairs": marks})


def _pose_of_pairs(document: Document) -> Pose | None:
    """The pose, and with a free focal length and enough pairs the camera; None: too few yet."""
    (points, pixels), pose = document.marks.correspondences, document.pose
    if len(points) < fewest_pairs(pose.camera):
        return None
    free = document.settings.free_focal and len(points) >= FEWEST_FOR_FOCAL
    free = free and len(document.scene.views) == 1  # the cameras of several views are known
    if free and isinstance(pose.camera, Perspective):
        return focal_from_pairs(points, pixels, pose.camera)[0].pose
    fits = poses_from_pairs(points, pixels, pose.camera)
    return likeliest(fits, points, document.mesh, pose).pose


def _pose_of_wheels(document: Document) -> Pose | None:
    """The pose of two wheels; None: they are not both outlined yet."""
    ellipses, keypoints = document.marks.ellipses, document.model.keypoints
    if len(ellipses) < WHEELS or keypoints is None:
        return None
    return poses_from_wheels(Wheels(*ellipses), keypoints, document.pose.camera)[0].pose
