"""Poses that bring a model to a place of the photo, its axis upwards, and surface points."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Parallel, Pose
from poseviewer.geometry.mesh import Mesh, hull_points
from poseviewer.geometry.transform import RigidTransform

FRAMINGS = 12
"""Rounds of ``fit_into_rectangle``: in perspective the box changes its shape on the way."""
FLAT = np.cos(np.radians(3.0))
"""Cosine of the largest angle between faces of the hull that carry the model together."""
PREFERENCE = 2.0
"""Factor by which another axis must be likelier than z to be upwards: z is in most files."""


def fit_into_rectangle(
    pose: Pose, mesh: Mesh, rectangle: tuple[float, float, float, float]
) -> Pose:
    """Translate the model so that its box just fits into a rectangle (left, top, width, height)."""
    left, top, *size = rectangle
    middle, points = np.array([left, top]) + np.array(size) / 2.0, hull_points(mesh)
    radius = float(np.linalg.norm(points - mesh.centre, axis=1).max())
    for _ in range(FRAMINGS):
        outline, camera = pose.project(points), pose.camera
        low, high = outline.min(axis=0), outline.max(axis=0)
        factor = float(np.min(np.array(size) / np.maximum(high - low, 1e-9)))
        centre = middle + factor * (pose.project(mesh.centre) - (low + high) / 2.0)
        depth = pose.camera_from_model.apply(mesh.centre)[2]
        if isinstance(camera, Parallel):
            camera = replace(camera, scale=camera.scale * factor)
        else:
            # Never so near that a corner comes behind the camera.
            depth = max(depth / factor, 1.05 * radius)
        pose = with_point_at(replace(pose, camera=camera), mesh.centre, centre, depth)
    return pose


def with_point_at(
    pose: Pose, point: ArrayLike, pixel: ArrayLike, depth: float | None = None
) -> Pose:
    """Translate the model until a point is seen at a pixel.

    Args:
        pose: pose of the model.
        point: (3,), of the model.
        pixel: (2,), of the photo.
        depth: depth of the point; None: the same as before.
    """
    camera, rotation = pose.camera, pose.camera_from_model.rotation
    far = float(pose.camera_from_model.apply(point)[2]) if depth is None else depth
    target = camera.points_at(pixel, far)
    return Pose(camera, RigidTransform(rotation, target - rotation @ np.asarray(point)))


def find_up(mesh: Mesh) -> FloatArray:
    """Find the axis, or its opposite, along which the model most likely stands."""
    try:
        hull = ConvexHull(hull_points(mesh))
    except QhullError:  # flat
        return np.array([0.0, 0.0, 1.0])
    corners = hull.points[hull.simplices] - mesh.centre
    a, b, c = np.moveaxis(corners / np.linalg.norm(corners, axis=2, keepdims=True), 1, 0)
    # A. van Oosterom, J. Strackee, The Solid Angle of a Plane Triangle, 1983.
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    scalar = 1.0 + np.sum(a * b, axis=1) + np.sum(b * c, axis=1) + np.sum(c * a, axis=1)
    angles = 2.0 * np.arctan2(volume, scalar)
    ups = np.vstack([np.eye(3), -np.eye(3)])
    likely = np.array([angles[hull.equations[:, :3] @ -up > FLAT].sum() for up in ups])
    best = int(np.argmax(likely))
    return ups[best if likely[best] > PREFERENCE * likely[2] else 2]


def surface_point(mesh: Mesh, pose: Pose, pixel: ArrayLike) -> FloatArray | None:
    """Return the point (3,) of the surface, in the model's frame, seen at ``pixel``, if any."""
    hit = surface_hit(mesh, pose, pixel)
    return None if hit is None else hit[1]


def surface_hit(mesh: Mesh, pose: Pose, pixel: ArrayLike) -> tuple[int, FloatArray] | None:
    """Return the face seen at ``pixel`` and the point (3,) there, in the model's frame, if any.

    T. Moeller and B. Trumbore, *Fast, minimum storage ray-triangle intersection*, 1997.
    """
    camera, model_from_camera = pose.camera, pose.camera_from_model.inverse()
    if isinstance(camera, Parallel):
        back = pose.camera_from_model.apply(mesh.centre)[2] - 2.0 * mesh.diameter
        origin, direction = camera.points_at(pixel, back), np.array([0.0, 0.0, 1.0])
    else:
        origin, direction = np.zeros(3), camera.rays(pixel)
    origin = model_from_camera.apply(origin)
    direction = model_from_camera.rotation @ direction
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    first, second = b - a, c - a
    across = np.cross(direction, second)
    determinant = np.einsum("ij,ij->i", first, across)
    is_crossed = determinant != 0.0  # others are seen edge-on
    inverse = np.divide(1.0, determinant, where=is_crossed, out=np.zeros_like(determinant))
    away = origin - a
    u = np.einsum("ij,ij->i", away, across) * inverse
    perpendicular = np.cross(away, first)
    v = perpendicular @ direction * inverse
    along = np.einsum("ij,ij->i", second, perpendicular) * inverse
    hit = is_crossed & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (along > 0.0)
    if not hit.any():
        return None
    nearest = int(np.argmin(np.where(hit, along, np.inf)))
    return nearest, origin + float(along[nearest]) * direction
