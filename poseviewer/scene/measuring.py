"""Measurements on a scene: surface points at pixels, their distance, and poses between objects.

Pixels are fixed while poses deviate: a measured point deviates as the place where its viewing ray
meets the plane of its triangle.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.placing import surface_hit
from poseviewer.render.overlay.contour import is_within_outline
from poseviewer.scene.types import Scene

OUTLINE_PX = 1.0
"""Distance beside an object's convex outline where its triangles are still tried: rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredPoint:
    """A point of an object's surface that a photo shows at a pixel."""

    object_index: int
    view_index: int
    at: Callable[[Pose], FloatArray]
    """Gives the coordinates (6,) by a pose of the object in the view."""
    coordinates: FloatArray
    """(6,): x, y, z in the model's frame, then in the camera's, in the model's unit."""
    deviations: FloatArray | None
    """(6,): their standard deviations; None: no search has said them."""


def measure_point(scene: Scene, pixel: ArrayLike, view_index: int = 0) -> MeasuredPoint | None:
    """Return the nearest point of any shown object at a pixel (2,) of a view; None beside them."""
    pixel, seen = np.asarray(pixel, dtype=float), list[tuple[float, int, FloatArray]]()
    for index, item in enumerate(scene.objects):
        mesh, pose = item.mesh, scene.pose(index, view_index)
        is_shown = item.is_placed and not item.hidden
        if is_shown and is_within_outline(pixel, pose, mesh, OUTLINE_PX):
            hit = surface_hit(mesh, pose, pixel)
            if hit is not None:
                depth = item.world_from_model.scale * pose.camera_from_model.apply(hit[1])[2]
                seen.append((float(depth), index, mesh.vertices[mesh.faces[hit[0]]]))
    if not seen:
        return None
    _, index, (corner, *others) = min(seen, key=itemgetter(0))
    normal = np.cross(*(others - corner))

    def at(pose: Pose) -> FloatArray:
        model_from_camera = pose.camera_from_model.inverse()
        near, far = pose.camera.points_at(np.array([pixel, pixel]), np.array([0.0, 1.0]))
        start, direction = model_from_camera.apply(near), model_from_camera.rotation @ (far - near)
        along = (normal @ (corner - start)) / (normal @ direction)
        return np.concatenate([start + along * direction, near + along * (far - near)])

    return MeasuredPoint(index, view_index, at, *_propagate(scene, [index], at, view_index))


def measure_distance(
    scene: Scene, first: MeasuredPoint, second: MeasuredPoint
) -> tuple[float, float | None]:
    """Return the distance of two points of a view and its standard deviation, if it is known, in
    the model's unit; of points on two objects in the world's.

    Raises:
        SettingsError: they are on two objects under parallel projection.
    """
    objects, part = [first.object_index], slice(0, 3)
    scales = [1.0, 1.0]
    if second.object_index not in objects:
        objects.append(second.object_index)
        scene.relative_pose(*objects)  # refuses a parallel projection
        scales, part = [scene.objects[i].world_from_model.scale for i in objects], slice(3, 6)

    def length(*poses: Pose) -> FloatArray:
        apart = scales[0] * first.at(poses[0])[part] - scales[1] * second.at(poses[-1])[part]
        return np.array([float(np.linalg.norm(apart))])

    values, deviations = _propagate(scene, objects, length, first.view_index)
    return float(values[0]), None if deviations is None else float(deviations[0])


def measure_relative(scene: Scene, object_index: int, other_index: int) -> dict[str, Any]:
    """Return the pose of an object in another's frame as numbers by their names.

    Returns:
        ``quaternion_wxyz``; ``translation`` and ``distance`` of the object's origin, in the other
        model's unit; ``degrees``, the angle of the rotation; ``scale``, the other model's units in
        one of the object's; where both covariances are known, ``distance_std``, ``degrees_std``.

    Raises:
        SettingsError: the projection is parallel.
    """
    relative = scene.relative_pose(object_index, other_index)
    rigid, turn = relative.rigid, relative.rigid.as_rotation_vector()
    axis = turn / max(np.linalg.norm(turn), 1e-300)

    def numbers(own: Pose, frame: Pose) -> FloatArray:
        a, b = own.camera_from_model, frame.camera_from_model
        distance = np.linalg.norm(relative.scale * a.translation - b.translation)
        change = Rotation.from_matrix(b.rotation.T @ a.rotation @ rigid.rotation.T).as_rotvec()
        return np.array([distance, math.degrees(axis @ (turn + change))])

    values, deviations = _propagate(scene, [object_index, other_index], numbers, 0)
    names = ("distance", "degrees", "distance_std", "degrees_std")
    known = [*values.tolist(), *(() if deviations is None else deviations.tolist())]
    quaternion, translation = rigid.as_quaternion().tolist(), rigid.translation.tolist()
    vectors = {"quaternion_wxyz": quaternion, "translation": translation, "scale": relative.scale}
    return {**vectors, **dict(zip(names, known, strict=False))}


def _propagate(
    scene: Scene, objects: list[int], function: Callable[..., FloatArray], view: int
) -> tuple[FloatArray, FloatArray | None]:
    """Return a function (n,) of objects' poses and its standard deviations, if all are known."""
    poses, variances = [scene.pose(index, view) for index in objects], 0.0
    for i, index in enumerate(objects):
        covariance = scene.covariance(index, view)
        if covariance is None:
            return function(*poses), None
        # The poses' errors are independent.
        partial = lambda pose, i=i: function(*poses[:i], pose, *poses[i + 1 :])  # noqa: E731
        variances = variances + covariance.deviations_of(partial) ** 2
    return function(*poses), np.sqrt(variances)
