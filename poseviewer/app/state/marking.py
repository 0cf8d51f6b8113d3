"""Quick starts: marks are set, moved and removed, and the pose follows from them."""

import numpy as np

from poseviewer.app.state.document import UNLOCK, WHEELS, Document, Marks, label_of
from poseviewer.app.state.dragging import Drag, nearest_place
from poseviewer.app.state.edits import edit
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective, Pose
from poseviewer.starts.placing import surface_point
from poseviewer.starts.point_pairs import (
    MIN_PAIRS_FOR_FOCAL,
    fewest_pairs,
    fit_of,
    focal_from_pairs,
    likeliest,
    poses_from_pairs,
)
from poseviewer.vehicle.vehicle_keypoints import keypoints_from_side
from poseviewer.vehicle.wheel_pose import MIN_RIM_POINTS, Ellipse, Wheels, poses_from_wheels

MARKING = {"pairs": ("pixels", "points"), "wheels": ("rims",)}
"""Fields of ``Marks`` by each tool that sets marks, the places on the photo first."""
MAX_PAIRS = 24


def marks_in_photo(marks: Marks, tool: str) -> FloatArray:
    """(n, 2): where the marks of a tool are, px."""
    return np.array(getattr(marks, MARKING[tool][0])).reshape(-1, 2)


def mark_at(document: Document, tool: str, point: FloatArray, zoom: float) -> int | None:
    """Index of the mark at ``point``; none while a pair waits for its place in the photo."""
    if tool == "pairs" and document.marks.waits_for_pixel:
        return None
    return nearest_place(marks_in_photo(document.marks, tool), point, zoom)


def hold_mark(held: Document, tool: str, mark: int, start: FloatArray) -> Drag:
    """Take hold of a mark at a point (2,); of point pairs the pose follows at once."""
    places, name = marks_in_photo(held.marks, tool), MARKING[tool][0]

    def follow(document: Document, point: FloatArray) -> Document:
        moved = np.array(places)
        moved[mark] += point - start
        document = document.with_marks(**{name: tuple(moved)})
        return document if tool == "wheels" else solve_pose(document, tool)

    return Drag(follow)


@edit
def mark_model(session: Session, u: float, v: float) -> Session:
    """Mark, or mark anew, the model's point at shares of its picture, from left and below."""
    if session.results.alone is None or not session.marks_model:
        return session
    document, (pose, _) = session.document, session.results.alone
    point = np.array([u * pose.camera.width, (1.0 - v) * pose.camera.height])
    if document.marks.waits_for_pixel:
        document = document.with_marks(points=document.marks.points[:-1])
    return session.with_document(_with_model_point(document, session.tool, point, pose))


def with_mark(document: Document, tool: str, point: FloatArray) -> Document:
    """The document with a mark more at ``point`` (2,) of the photo, and the pose that follows."""
    marks = document.marks
    if tool == "wheels" and document.model.keypoints is None:
        raise QuickStartError("Press the middle of the model's wheels at the right first.")
    if tool == "wheels" and len(marks.rims) == WHEELS * MIN_RIM_POINTS:
        raise QuickStartError("Both wheels are outlined; drag their points, or clear them.")
    if tool == "pairs" and not marks.waits_for_pixel:
        if not document.object.is_placed:
            raise QuickStartError("Click a point of the model at the right first.")
        return _with_model_point(document, tool, point, document.pose)
    places = (*marks_in_photo(marks, tool), point)
    return solve_pose(document.with_marks(**{MARKING[tool][0]: places}), tool)


def _with_model_point(document: Document, tool: str, point: FloatArray, pose: Pose) -> Document:
    """The document with a mark on the model, which a picture shows at ``point`` (2,)."""
    points, surface = document.marks.points, surface_point(document.mesh, pose, point)
    if surface is None:
        raise QuickStartError("There is no model there; click a point of it as it is drawn.")
    if tool == "wheels":
        return _with_hub(document, surface)
    if len(points) == MAX_PAIRS:
        raise QuickStartError(f"{MAX_PAIRS} point pairs are enough; remove one first.")
    return document.with_marks(points=(*points, surface), note="")


def _with_hub(document: Document, hub: FloatArray) -> Document:
    """The document with the rear wheel's hub (3,), or with the key points by the front one's."""
    mesh, hubs = document.mesh, document.marks.hubs
    if not hubs:
        return document.with_marks(hubs=(hub,))
    try:
        keypoints = keypoints_from_side(mesh.whole, hubs[0], hub)
    except ValueError as error:
        raise QuickStartError(f"These are no two wheels of one side: {error}.") from error
    model = document.model.with_content(keypoints=keypoints)
    return document.with_object(model=model, result=None).with_marks(hubs=())


@edit
def remove_mark(session: Session, index: int | None = None) -> Session:
    """Take a mark of the tool away, by default the last, half a pair alone; the pose follows."""
    document = session.document
    marks = session.document.marks
    tool = session.tool
    if tool == "pairs" and index is None and marks.waits_for_pixel:
        return session.with_document(document.with_marks(points=marks.points[:-1]))
    lists = {name: list(getattr(marks, name)) for name in MARKING.get(tool, ())}
    if not any(lists.values()):
        return session
    for places in lists.values():
        del places[-1 if index is None else index]
    left = {name: tuple(places) for name, places in lists.items()}
    return session.with_document(solve_pose(document.with_marks(**left), tool))


@edit
def clear_marks(session: Session) -> Session:
    """Take all marks of the tool at hand away; the pose stays."""
    names = MARKING.get(session.tool, ())
    if not any(getattr(session.document.marks, name) for name in names):
        return session
    cleared = session.document.with_marks(**dict.fromkeys(names, ()), note="")
    return session.with_document(cleared)


@edit
def lay_wheels(
    session: Session, sought: Document, rear: Ellipse, front: Ellipse, pose: Pose
) -> Session:
    """Mark both rims by ellipses that were found in a document, and take the pose they give."""
    document = session.document
    if document.shown != sought.shown:
        raise QuickStartError(
            "The wheels were found in another photo or for another model; look for them again."
        )
    rims = (*rear.outline(MIN_RIM_POINTS), *front.outline(MIN_RIM_POINTS))
    return session.with_document(document.with_marks(rims=rims, note="").at_pose(pose))


def solve_pose(document: Document, tool: str) -> Document:
    """Document with the pose that a tool's marks give; where they give none, with a note."""
    try:
        pose = _pose_of_wheels(document) if tool == "wheels" else _pose_of_pairs(document)
    except QuickStartError as error:
        return document.with_marks(note=str(error))
    if pose is not None and document.object.locked:
        note = f"{label_of(document.object)} is locked: {UNLOCK} to move it."
        return document.with_marks(note=note)
    return (document if pose is None else document.at_pose(pose)).with_marks(note="")


def pair_errors(document: Document) -> FloatArray:
    """(n,): how far, in px, each pair that is done is off at the pose at hand."""
    return fit_of(document.pose, *document.marks.correspondences).errors_px


def _pose_of_pairs(document: Document) -> Pose | None:
    """The pose, and with a free focal length and enough pairs the camera; None: too few yet."""
    (points, pixels), pose = document.marks.correspondences, document.pose
    if len(points) < fewest_pairs(pose.camera):
        return None
    free = document.settings.free_focal and len(points) >= MIN_PAIRS_FOR_FOCAL
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
