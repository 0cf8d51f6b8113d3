"""Marks for quick starts: edits that set, move and remove them and solve for the pose."""

from dataclasses import replace
from functools import lru_cache
from itertools import chain

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.app.state.document import (
    MARKING,
    UNLOCK,
    WHEELS,
    Document,
    Marks,
    label_of,
)
from poseviewer.app.state.dragging import Drag, nearest_point
from poseviewer.app.state.edits import drag_edit, edit
from poseviewer.app.state.session import Session
from poseviewer.errors import QuickStartError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.placing import surface_point
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.point_pairs import (
    MIN_PAIRS_FOR_FOCAL,
    fewest_pairs,
    fit_of,
    focal_from_pairs,
    likeliest,
    poses_from_pairs,
)
from poseviewer.starts.views import look_along
from poseviewer.starts.wheels import FoundWheels
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints, keypoints_from_side
from poseviewer.vehicle.wheel_pose import MIN_RIM_POINTS, Wheels, poses_from_wheels

MAX_PAIRS = 24
SAME_WHEEL = 0.2
"""Distance, in model diameters, below which a press marks the rear wheel anew: no wheelbase."""
CLEARANCE = 0.06
"""Height, as a share of a car's, below which it has wheels alone: its floor is twice as high."""
MIN_ELONGATION = 1.5
"""Smallest ratio of a car's length to its width: cars have 1.9 to 2.6."""


def marks_in_photo(marks: Marks, tool: str) -> FloatArray:
    """(n, 2): pixels of a tool's marks."""
    return np.array(getattr(marks, MARKING[tool][0])).reshape(-1, 2)


def mark_at(session: Session, point: FloatArray, zoom: float) -> int | None:
    """Index of the tool's mark at ``point``; None also while a pair still needs its pixel."""
    marks = session.document.marks
    if session.tool == "pairs" and marks.waits_for_pixel:
        return None
    return nearest_point(marks_in_photo(marks, session.tool), point, zoom)


def hold_mark(session: Session, mark: int, start: FloatArray) -> Drag:
    """Take hold of a mark at a point (2,). The pose follows point pairs during the drag."""
    tool = session.tool
    pixels, name = marks_in_photo(session.document.marks, tool), MARKING[tool][0]

    def follow(document: Document, point: FloatArray) -> Document:
        dragged = np.array(pixels)
        dragged[mark] += point - start
        document = document.with_marks(**{name: tuple(dragged)})
        return document if tool == "wheels" else solve_pose(document, tool)

    return Drag(follow, end=lambda document: solve_pose(document, tool))


@lru_cache(maxsize=4)
def pose_beside_wheels(mesh: Mesh, camera: Camera) -> Pose | None:
    """The pose in which a car is seen from one side; None: the mesh is not long, or does not stand,
    on its largest side, at its front and its rear alone.
    """
    low, high = mesh.bounds
    sides = np.maximum(high - low, 1e-300)
    height, width, length = np.argsort(sides)
    if sides[length] < MIN_ELONGATION * sides[width]:
        return None
    shares = (mesh.vertices - low) / sides
    for up, heights in ((1.0, shares[:, height]), (-1.0, 1.0 - shares[:, height])):
        lengths = shares[mesh.faces[(heights[mesh.faces] < CLEARANCE).any(axis=1)], length]
        is_rear, is_front = lengths.max(axis=1) < 0.4, lengths.min(axis=1) > 0.6
        if is_rear.any() and is_front.any() and np.all(is_rear | is_front):
            rotation = look_along(np.eye(3)[width], up * np.eye(3)[height])
            far = np.array([0.0, 0.0, 2.0 * mesh.diameter])
            return Pose(camera, RigidTransform(rotation, far - rotation @ mesh.centre))
    return None


@edit
def mark_model(session: Session, u: float, v: float) -> Session:
    """Mark a point of the model at shares (u, v) of its picture, from the lower left corner; a
    point that still needs its pixel is replaced. A car without a pose is looked for by its wheels.
    """
    if session.results.alone is None or not session.shows_model:
        return session
    if not session.marks_model:
        raise QuickStartError("Both wheels of the model are marked; click rims on the photo.")
    document, (pose, _) = session.document, session.results.alone
    point = np.array([u * pose.camera.width, (1.0 - v) * pose.camera.height])
    if document.marks.waits_for_pixel:
        document = document.with_marks(points=document.marks.points[:-1])
    session = session.with_document(_with_model_point(document, session.tool, point, pose))
    return session if session.marks_model else session.with_first_proposals


def with_mark(document: Document, tool: str, point: FloatArray) -> Document:
    """The document with a further mark at a pixel ``point`` (2,), and the pose by all marks."""
    marks = document.marks
    if tool == "wheels" and document.model.keypoints is None:
        raise QuickStartError("Press the middle of the model's wheels at the right first.")
    if tool == "wheels" and len(marks.rims) == WHEELS * MIN_RIM_POINTS:
        raise QuickStartError("Both wheels are outlined; drag their points, or clear them.")
    if tool == "pairs" and not marks.waits_for_pixel:
        if not document.object.is_placed:
            raise QuickStartError("Click a point of the model at the right first.")
        return _with_model_point(document, tool, point, document.pose)
    pixels = (*marks_in_photo(marks, tool), point)
    return solve_pose(document.with_marks(**{MARKING[tool][0]: pixels}), tool)


def _with_model_point(document: Document, tool: str, point: FloatArray, pose: Pose) -> Document:
    """Document with a mark on the model, at ``point`` (2,) of a picture by ``pose``."""
    points, surface = document.marks.points, surface_point(document.mesh, pose, point)
    if surface is None:
        raise QuickStartError("There is no model there; click a point of it as it is drawn.")
    if tool == "wheels":
        return _with_hub(document, surface)
    if len(points) == MAX_PAIRS:
        raise QuickStartError(f"{MAX_PAIRS} point pairs are enough; remove one first.")
    return document.with_marks(points=(*points, surface), note="")


def _with_hub(document: Document, hub: FloatArray) -> Document:
    """Document with the rear wheel's hub (3,), or with key points once the front one is there."""
    mesh, hubs = document.mesh, document.marks.hubs[:1]
    if not hubs or np.linalg.norm(hub - hubs[0]) < SAME_WHEEL * mesh.diameter:
        return document.with_marks(hubs=(hub,))
    try:
        keypoints = keypoints_from_side(mesh.whole, hubs[0], hub)
    except ValueError as error:
        raise QuickStartError(f"These are no two wheels of one side: {error}.") from error
    return _with_keypoints(document, keypoints, (*hubs, hub))


def _with_keypoints(
    document: Document, keypoints: VehicleKeypoints | None, hubs: tuple[FloatArray, ...]
) -> Document:
    model = document.model.with_content(keypoints=keypoints)
    return document.with_object(model=model, result=None).with_marks(hubs=hubs, note="")


@edit
def remark_wheels(session: Session) -> Session:
    """Forget the wheels of the model, to mark them anew."""
    session = session.with_document(_with_keypoints(session.document, None, ()))
    return replace(session, tool="wheels")


@drag_edit
def turn_model(session: Session, right: float, down: float) -> Session:
    """Turn the picture of the model; ``right`` and ``down`` are shares of its sides."""
    turn = Rotation.from_rotvec(np.pi * np.array([-down, right, 0.0]))
    turned = turn * Rotation.from_rotvec(session.display.model_turn)
    x, y, z = turned.as_rotvec().tolist()
    return replace(session, display=replace(session.display, model_turn=(x, y, z)))


@edit
def remove_mark(session: Session, index: int | None = None) -> Session:
    """Remove a mark of the tool, by default the last one, and solve for the pose again."""
    document = session.document
    marks, tool = document.marks, session.tool
    if tool == "pairs" and index is None and marks.waits_for_pixel:
        return session.with_document(document.with_marks(points=marks.points[:-1]))
    lists = {name: list(getattr(marks, name)) for name in MARKING.get(tool, ())}
    if tool == "wheels" and index is None and marks.hubs and not marks.rims:
        return session.with_document(_with_keypoints(document, None, marks.hubs[:-1]))
    if not any(lists.values()):
        return session
    for values in lists.values():
        del values[-1 if index is None else index]
    left = {name: tuple(values) for name, values in lists.items()}
    return session.with_document(solve_pose(document.with_marks(**left), tool))


@edit
def clear_marks(session: Session) -> Session:
    """Remove all marks of the tool; the pose stays."""
    names, document = MARKING.get(session.tool, ()), session.document
    hubs = document.marks.hubs if session.tool == "wheels" else ()
    if not hubs and not any(getattr(document.marks, name) for name in names):
        return session
    document = _with_keypoints(document, None, ()) if hubs else document
    return session.with_document(document.with_marks(**dict.fromkeys(names, ()), note=""))


@edit
def lay_wheels(session: Session, searched: Document, wheels: FoundWheels) -> Session:
    """Mark wheels that were found in a document by their rims, and take their pose."""
    document = session.document
    if document.shown != searched.shown:
        raise QuickStartError(
            "The wheels were found in another photo or for another model; look for them again."
        )
    outlines = (ellipse.outline(MIN_RIM_POINTS) for ellipse in wheels.wheels)
    marked = document.with_marks(rims=tuple(chain(*outlines)), note="")
    return session.with_document(marked.at_pose(wheels.fit.pose))


def solve_pose(document: Document, tool: str) -> Document:
    """The document with the pose by a tool's marks, or a note why there is none."""
    try:
        pose = _pose_of_wheels(document) if tool == "wheels" else _pose_of_pairs(document)
    except QuickStartError as error:
        return document.with_marks(note=str(error))
    if pose is not None and document.object.locked:
        note = f"{label_of(document.object)} is locked: {UNLOCK} to move it."
        return document.with_marks(note=note)
    return (document if pose is None else document.at_pose(pose)).with_marks(note="")


def pair_errors(document: Document) -> FloatArray:
    """(n,): reprojection error of each complete pair, px."""
    return fit_of(document.pose, *document.marks.correspondences).errors_px


def _pose_of_pairs(document: Document) -> Pose | None:
    """Pose by the pairs, with the focal length if it is free and they suffice; None: too few."""
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
    """Pose by two wheels; None: they are not both outlined yet."""
    ellipses, keypoints = document.marks.ellipses, document.model.keypoints
    if len(ellipses) < WHEELS or keypoints is None:
        return None
    return poses_from_wheels(Wheels(*ellipses), keypoints, document.pose.camera)[0].pose
