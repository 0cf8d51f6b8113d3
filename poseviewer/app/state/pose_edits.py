"""Edits of the active object's pose by numbers, buttons and maps."""

import math
from contextlib import suppress
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.app.state.document import Document, scale_at
from poseviewer.app.state.dragging import roll, rotate, scale_about, translate
from poseviewer.app.state.edits import edit
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.fit.slices import Slice
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.loading import scale_by_rays
from poseviewer.starts.placing import look_from

NudgeKind = Literal["move", "turn", "roll", "scale"]
NUDGE_MOVE_PX = 1.0
NUDGE_TURN = math.radians(1.0)
NUDGE_SCALE = 1.01


def put(document: Document, pose: Pose) -> Document:
    """Document at a new pose; among views of unknown scale, at the scale by which they see it."""
    scale = None
    if document.scene.free_scale:
        with suppress(SettingsError):
            views, name = document.scene.views, document.scene.name
            scale = 1.0 / scale_by_rays(views, document.view_index, document.mesh, pose, name)
    return document.at_pose(pose, scale=scale)


@edit
def nudge(session: Session, kind: NudgeKind, x: float = 0.0, y: float = 0.0) -> Session:
    """Move the pose by small steps to the right and down; or turn, roll, scale it by ``x``."""
    pose, centre = session.document.pose, session.document.mesh.centre
    match kind:
        case "move":
            pose = translate(pose, centre, NUDGE_MOVE_PX * np.array([x, y]))
        case "turn":
            # To the right: about the downward axis, so that the near side follows.
            pose = rotate(pose, centre, NUDGE_TURN * np.array([y, -x, 0.0]))
        case "roll":
            pose = roll(pose, centre, NUDGE_TURN * x)
        case "scale":
            pose = scale_about(pose, centre, NUDGE_SCALE**x)
    return session.with_pose(pose)


def pose_numbers(pose: Pose) -> dict[str, float]:
    """X, Y, Z and distance of the model's origin in the camera's frame, in the model's unit; turns
    about the camera's x, y and z axes, in this order, in degrees; focal length in px. Under
    parallel projection there is a scale, px per unit, and neither Z nor distance.
    """
    place, turn = pose.camera_from_model.translation, pose.camera_from_model.rotation
    turns = (
        math.atan2(turn[2, 1], turn[2, 2]),
        math.atan2(-turn[2, 0], math.hypot(turn[2, 1], turn[2, 2])),
        math.atan2(turn[1, 0], turn[0, 0]),
    )
    said = dict(zip("XYZ", map(float, place), strict=True))
    said |= {"distance": float(np.linalg.norm(place))}
    said |= {f"turn {axis}": math.degrees(angle) for axis, angle in zip("xyz", turns, strict=True)}
    if isinstance(pose.camera, Parallel):
        del said["Z"], said["distance"]
        return {**said, "scale": pose.camera.scale}
    return {**said, "focal": pose.camera.fx}


def with_number(pose: Pose, name: str, value: float) -> Pose:
    """The pose with another value of ``pose_numbers``, except of distance and focal length."""
    numbers = pose_numbers(pose) | {name: value}
    depth = pose.camera_from_model.translation[2]
    turns = [numbers[f"turn {axis}"] for axis in "xyz"]
    place = np.array([numbers["X"], numbers["Y"], numbers.get("Z", depth)])
    if isinstance(pose.camera, Parallel):
        pose = replace(pose, camera=replace(pose.camera, scale=numbers["scale"]))
    rotation = Rotation.from_euler("xyz", turns, degrees=True).as_matrix()
    return replace(pose, camera_from_model=RigidTransform(rotation, place))


@edit
def set_number(session: Session, name: str, value: float) -> Session:
    """Set one of ``pose_numbers``; what is typed in its field is one undoable step."""
    pose = session.document.pose
    if not math.isfinite(value) or name not in pose_numbers(pose):
        raise SettingsError(f"{name} = {value} is no number of the pose")
    if pose_numbers(pose)[name] == value:
        return session
    return session.with_document(session.document.at_pose(with_number(pose, name, value)), name)


@edit
def set_parameter(session: Session, name: str, value: float) -> Session:
    """Set a parameter of the chart by its name; what is typed in its field is one undoable step."""
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
def pick_in_landscape(session: Session, first: int, second: int, u: float, v: float) -> Session:
    """Go to a point (u, v) of a map, in [0, 1] from its lower left corner."""
    for landscape in session.results.landscapes:
        for piece in landscape.slices:
            if (piece.first, piece.second) == (first, second):
                parameters = parameters_at(piece, landscape.parameters, u, v)
                picked = session.document.at_params(landscape.problem, parameters)
                return session.with_document(picked)
    return session


def parameters_at(piece: Slice, centre: FloatArray, u: float, v: float) -> FloatArray:
    """(d,): parameters at shares ``u``, ``v``, cut to [0, 1], of a map about ``centre`` (d,)."""
    parameters = np.array(centre, dtype=float)
    parameters[piece.first] = np.interp(u, [0.0, 1.0], piece.first_values[[0, -1]])
    parameters[piece.second] = np.interp(v, [0.0, 1.0], piece.second_values[[0, -1]])
    return parameters


@edit
def view_from(session: Session, side: str) -> Session:
    """Turn the model so that a side is seen: where it is, or in the middle of the photo."""
    document = session.document
    model = session.document.model
    pose = session.document.pose
    seen = look_from(side, model.mesh, model.keypoints, pose.camera)
    if document.object.is_placed:
        rotation, centre = seen.camera_from_model.rotation, model.mesh.centre
        translation = pose.camera_from_model.apply(centre) - rotation @ centre
        seen = replace(pose, camera_from_model=RigidTransform(rotation, translation))
    return session.with_pose(seen)


@edit
def reset_to_start(session: Session) -> Session:
    """Go back to the start pose."""
    return session.with_document(session.document.at_start)


@edit
def make_start(session: Session) -> Session:
    """Make the pose at hand the start pose."""
    return session.with_document(session.document.with_start_here)
