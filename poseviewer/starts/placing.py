"""Placing a model in a photo: seen from one of its sides; and the surface point under a pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.keypoints import VehicleKeypoints, model_axes

FILLED = 0.7
"""Share of the photo's shorter side that the model's diameter is made to fill."""

SIDES = {
    "three-quarter": (-1.0, -1.3, 0.55),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
}
"""Where the camera stands, as seen from the model: to its right, behind it, above it."""


def look_from(side: str, mesh: Mesh, keypoints: VehicleKeypoints | None, camera: Camera) -> Pose:
    """The model in the middle of the photo, seen from ``side``, one of ``SIDES``.

    A vehicle's axes are those of its wheels; any other model is taken to have z upwards and to
    look along -y.

    Raises:
        SettingsError: there is no such side.
    """
    if side not in SIDES:
        raise SettingsError(f"no side {side!r} to look from; wanted one of {', '.join(SIDES)}")
    right, behind, up = model_axes(keypoints)
    stand = np.array(SIDES[side])
    from_camera = -(stand[0] * right + stand[1] * behind + stand[2] * up)
    forward = from_camera / np.linalg.norm(from_camera)
    # Looking straight down or up, the front of the model is at the upper edge of the photo.
    upwards = up if abs(forward @ up) < 0.99 else -behind
    across = np.cross(forward, upwards)
    across /= np.linalg.norm(across)
    rotation = np.array([across, np.cross(forward, across), forward])
    wanted_px = FILLED * min(camera.width, camera.height)
    size = mesh.diameter
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=wanted_px / size)
        middle = (camera.width / 2.0 - camera.cx, camera.height / 2.0 - camera.cy)
        place = np.array([*middle, 0.0]) / camera.scale + np.array([0.0, 0.0, 2.0 * size])
    else:
        depth = max(camera.fx * size / wanted_px, 0.75 * size)
        place = camera.rays([camera.width / 2.0, camera.height / 2.0]) * depth
    return Pose(camera, RigidTransform(rotation, place - rotation @ mesh.centre))


def surface_point(mesh: Mesh, pose: Pose, pixel: ArrayLike) -> FloatArray | None:
    """The nearest point (3,) of the surface, in the model's frame, that is seen at ``pixel``.

    Every face is asked (T. Moeller and B. Trumbore, *Fast, minimum storage ray-triangle
    intersection*, 1997); None where none is hit.
    """
    camera, model_from_camera = pose.camera, pose.camera_from_model.inverse()
    if isinstance(camera, Parallel):
        xy = (np.asarray(pixel, dtype=float) - np.array([camera.cx, camera.cy])) / camera.scale
        back = pose.camera_from_model.apply(mesh.centre)[2] - 2.0 * mesh.diameter
        origin, direction = np.append(xy, back), np.array([0.0, 0.0, 1.0])
    else:
        origin, direction = np.zeros(3), camera.rays(pixel)
    origin = model_from_camera.apply(origin)
    direction = model_from_camera.rotation @ direction
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    one, other = b - a, c - a
    across = np.cross(direction, other)
    determinant = np.einsum("ij,ij->i", one, across)
    crossed = determinant != 0.0  # others are seen edge-on
    inverse = np.divide(1.0, determinant, where=crossed, out=np.zeros_like(determinant))
    away = origin - a
    u = np.einsum("ij,ij->i", away, across) * inverse
    turned = np.cross(away, one)
    v = turned @ direction * inverse
    along = np.einsum("ij,ij->i", other, turned) * inverse
    hit = crossed & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (along > 0.0)
    if not hit.any():
        return None
    return origin + float(along[hit].min()) * direction
