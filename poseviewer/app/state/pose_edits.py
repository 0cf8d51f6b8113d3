"""Edits of the active object's pose by fields, buttons and maps, and of the camera, about which the
model keeps its place and its size in the photo.
"""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.app.state.document import scale_at, with_camera
from poseviewer.app.state.dragging import roll, rotate, scale_about, translate
from poseviewer.app.state.edits import edit
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.sides import look_from

NudgeKind = Literal["move", "turn", "roll", "scale"]
NUDGE_MOVE_PX = 1.0
NUDGE_TURN = math.radians(1.0)
NUDGE_SCALE = 1.01
MIN_FOCAL_PX = 1.0
MAX_FOCAL = 1000.0
"""Largest focal length, in the photo's longer side: a telescope's."""
MAX_CENTRE_OFFSET = 10.0
"""Largest distance of the principal point from the photo's middle, in its longer side: more than
any crop of a photo leaves."""
MIN_FIELD_DEG = 0.5
MAX_FIELD_DEG = 170.0
"""Largest field of view."""


@edit
def nudge(session: Session, kind: NudgeKind, x: float = 0.0, y: float = 0.0) -> Session:
    """Change the pose by small steps.

    Args:
        session: before the edit.
        kind: motion; "move" and "turn" go along ``x`` and ``y``, "roll" and "scale" by ``x``.
        x: steps to the right.
        y: steps down.

    Raises:
        SettingsError: poses are being propagated.
    """
    _require_rest(session)
    pose, centre = session.document.pose, session.document.mesh.centre
    match kind:
        case "move":
            pose = translate(pose, centre, NUDGE_MOVE_PX * np.array([x, y]))
        case "turn":
            # The near side follows.
            pose = rotate(pose, centre, NUDGE_TURN * np.array([y, -x, 0.0]))
        case "roll":
            pose = roll(pose, centre, NUDGE_TURN * x)
        case "scale":
            pose = scale_about(pose, centre, NUDGE_SCALE**x)
    return session.with_pose(pose)


def _require_rest(session: Session) -> None:
    """Refuse to move the model by a key while poses are propagated, which would end that."""
    if session.is_propagating:
        found = "poses are being propagated, so the model was not moved"
        raise SettingsError(f"{found}; stop that first (Esc)")


def pose_numbers(pose: Pose) -> dict[str, float]:
    """X, Y, Z and distance of the model's origin in the camera's frame, in the model's unit; Euler
    angles about the camera's fixed axes x, y, z in this order, in degrees; focal length in px.
    Parallel projection has a scale, px per unit, in place of Z, distance and focal length.
    """
    translation, rotation = pose.camera_from_model.translation, pose.camera_from_model.rotation
    angles = (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        math.atan2(-rotation[2, 0], math.hypot(rotation[2, 1], rotation[2, 2])),
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )
    turns = {f"turn {axis}": math.degrees(angle) for axis, angle in zip("xyz", angles, strict=True)}
    x, y, z = map(float, translation)
    if isinstance(pose.camera, Parallel):
        return {"X": x, "Y": y, **turns, "scale": pose.camera.scale}
    distance = float(np.linalg.norm(translation))
    return {"X": x, "Y": y, "Z": z, "distance": distance, **turns, "focal": pose.camera.fx}


def with_number(pose: Pose, name: str, value: float) -> Pose:
    """The pose with another value of ``pose_numbers``, except of distance and focal length."""
    numbers = pose_numbers(pose) | {name: value}
    depth = pose.camera_from_model.translation[2]
    angles = [numbers[f"turn {axis}"] for axis in "xyz"]
    translation = np.array([numbers["X"], numbers["Y"], numbers.get("Z", depth)])
    if isinstance(pose.camera, Parallel):
        pose = replace(pose, camera=replace(pose.camera, scale=numbers["scale"]))
    rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    return replace(pose, camera_from_model=RigidTransform(rotation, translation))


@edit
def set_number(session: Session, name: str, value: float) -> Session:
    """Set one of ``pose_numbers``."""
    pose = session.document.pose
    if not math.isfinite(value) or name not in pose_numbers(pose):
        raise SettingsError(f"{name} = {value} is no number of the pose")
    if pose_numbers(pose)[name] == value:
        return session
    return session.with_pose(with_number(pose, name, value))


@edit
def set_parameter(session: Session, name: str, value: float) -> Session:
    """Set a parameter of the chart by its name."""
    chart, parameters = session.document.chart, np.array(session.document.parameters)
    if name not in chart.names or not math.isfinite(value):
        raise SettingsError(f"{name} = {value} is no parameter of the chart")
    index = chart.names.index(name)
    if float(parameters[index]) == value:
        return session
    parameters[index] = value
    pose, scale = chart.to_pose(parameters), scale_at(chart, parameters)
    return session.with_document(session.document.at_pose(pose, scale=scale))


@edit
def pick_in_landscape(session: Session, first: int, second: int, u: float, v: float) -> Session:
    """Take the pose at a point of a map.

    Args:
        session: before the edit.
        first: index of the parameter along the map's width.
        second: index of the parameter along its height.
        u: share of the width, from the left.
        v: share of the height, from below.
    """
    for landscape in session.results.landscapes:
        for piece in landscape.slices:
            if (piece.first, piece.second) == (first, second):
                parameters = parameters_at(piece, landscape.parameters, (u, v))
                document = session.document.at_params(landscape.problem, parameters)
                return session.with_document(document)
    return session


def parameters_at(piece: Slice, centre: FloatArray, point: tuple[float, float]) -> FloatArray:
    """(d,): parameters at a ``point`` (u, v), clipped to [0, 1], of a map about ``centre`` (d,)."""
    parameters = np.array(centre, dtype=float)
    parameters[piece.first] = np.interp(point[0], [0.0, 1.0], piece.first_values[[0, -1]])
    parameters[piece.second] = np.interp(point[1], [0.0, 1.0], piece.second_values[[0, -1]])
    return parameters


@edit
def view_from(session: Session, side: str) -> Session:
    """Rotate the model to show a side; a model without a pose goes to the photo's middle."""
    document, model = session.document, session.document.model
    pose = look_from(side, model.mesh, model.keypoints, document.pose.camera)
    if document.object.is_placed:
        rotation, centre = pose.camera_from_model.rotation, model.mesh.centre
        translation = document.pose.camera_from_model.apply(centre) - rotation @ centre
        pose = replace(document.pose, camera_from_model=RigidTransform(rotation, translation))
    return session.with_pose(pose)


@edit
def reset_to_start(session: Session) -> Session:
    """Go back to the start pose; fails like ``nudge``."""
    _require_rest(session)
    return session.with_document(session.document.at_start)


@edit
def make_start(session: Session) -> Session:
    """Make the current pose the start pose."""
    return session.with_document(session.document.with_start_here)


@edit
def set_projection(session: Session, projection: Literal["perspective", "parallel"]) -> Session:
    """Set perspective or parallel projection."""
    document, camera = session.document, session.document.pose.camera
    if isinstance(camera, Parallel) is (projection == "parallel"):
        return session
    if projection == "parallel":
        other = Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
    else:
        start = document.start.camera
        start = start if isinstance(start, Perspective) else document.photo.default_camera()
        other = replace(start, cx=camera.cx, cy=camera.cy)
    return _change_camera(session, other)


@edit
def set_camera(
    session: Session,
    fx: float | None = None,
    fy: float | None = None,
    cx: float | None = None,
    cy: float | None = None,
) -> Session:
    """Set intrinsics, px, by OpenCV's convention (pixel centres at integers); None: as it is.

    Args:
        session: before the edit.
        fx: focal length; ignored under parallel projection.
        fy: likewise.
        cx: principal point.
        cy: likewise.
    """
    now = session.document.pose.camera
    given = (fx, fy, cx, cy)
    pairs = zip(given, intrinsics_of(now), strict=True)
    fx, fy, cx, cy = (old if value is None else value for value, old in pairs)
    longer = max(now.width, now.height)
    max_offset, max_focal = MAX_CENTRE_OFFSET * longer, MAX_FOCAL * longer
    if not math.hypot(cx - now.width / 2.0, cy - now.height / 2.0) <= max_offset:
        raise SettingsError(
            f"cx, cy = {cx:g}, {cy:g}: wanted a centre within {max_offset:g} px of the photo's "
            "middle; nothing was changed"
        )
    is_parallel = isinstance(now, Parallel)
    if not is_parallel and not all(MIN_FOCAL_PX <= value <= max_focal for value in (fx, fy)):
        raise SettingsError(
            f"fx, fy = {fx:g}, {fy:g}: wanted focal lengths of {MIN_FOCAL_PX:g} to "
            f"{max_focal:g} px; nothing was changed"
        )
    camera = camera_from_integer_centres(Perspective(fx, fy, cx, cy, now.width, now.height))
    camera = replace(now, cx=camera.cx, cy=camera.cy) if is_parallel else camera
    return _change_camera(session, camera)


@edit
def set_field_of_view(session: Session, degrees: float) -> Session:
    """Set equal focal lengths by the field of view of the photo's longer side, in degrees."""
    now = session.document.pose.camera
    camera = Perspective.from_field_of_view(degrees, now.width, now.height)
    return set_camera(camera.fx, camera.fy)(session)


def intrinsics_of(camera: Camera) -> tuple[float, ...]:
    """fx, fy, cx and cy in px, as OpenCV has them; the scale in place of focal lengths."""
    camera = camera_as_integer_centres(camera)
    focal = (camera.scale,) * 2 if isinstance(camera, Parallel) else (camera.fx, camera.fy)
    return (*focal, camera.cx, camera.cy)


def _change_camera(session: Session, camera: Camera) -> Session:
    document = session.document
    if len(document.scene.views) > 1:
        raise SettingsError(
            "the cameras of several photos are known: open this photo alone to change its camera"
        )
    changed = document.at_pose(with_camera(document.pose, camera, document.mesh.centre))
    if document.object.is_placed:
        return session.with_document(changed)
    session = session.with_document(changed.with_object(is_placed=False))
    return session.with_first_proposals if session.is_looking else session
