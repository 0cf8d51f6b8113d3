"""Choice of the views of a large set that a search compares."""

from collections.abc import Sequence

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.mesh import hull_in_photo
from poseviewer.scene.types import Scene

MAX_SEARCHED = 6
"""Number of views that a search compares at most: each takes as long as a photo alone, and what
further ones tell follows from one look at each (``fit.survey``)."""
MIN_SIZE = 0.5
"""Size of the object in a chosen view, by that where it is largest."""


def choose_views(scene: Scene, object_index: int, view_indices: Sequence[int]) -> list[int]:
    """Choose the views that differ most and show an object best, in the order given.

    The first is chosen in any case; each further one sees the object from the direction that is
    farthest from those of the chosen. Photos are not read.

    Args:
        scene: scene with the object.
        object_index: index of the object.
        view_indices: indices of views that show it.
    """
    if len(view_indices) <= MAX_SEARCHED:
        return list(view_indices)
    directions, sizes = directions_in_model(scene, object_index, view_indices), []
    for index in view_indices:
        pose = scene.pose(object_index, index)
        outline, camera = hull_in_photo(scene.objects[object_index].mesh, pose), pose.camera
        inside = np.clip(outline, 0.0, [camera.width, camera.height])
        sizes.append(float(np.prod(np.ptp(inside, axis=0))) ** 0.5 if len(outline) else 0.0)
    facing = directions @ directions.T
    is_large = np.array(sizes) >= MIN_SIZE * max(sizes)
    chosen, nearest = [0], facing[0]
    while len(chosen) < MAX_SEARCHED:
        left = np.where(is_large, nearest, np.inf)
        left[chosen] = np.inf
        if not np.isfinite(left).any():
            break
        chosen.append(int(np.argmin(left)))
        nearest = np.maximum(nearest, facing[chosen[-1]])
    return [view_indices[number] for number in sorted(chosen)]


def directions_in_model(scene: Scene, object_index: int, view_indices: Sequence[int]) -> FloatArray:
    """Return (n, 3): unit vectors from an object's centre to the camera of each view, in the
    model's frame.
    """
    centre = scene.objects[object_index].mesh.centre
    places = [scene.pose(object_index, index).camera_from_model for index in view_indices]
    towards = np.array([-place.rotation.T @ place.apply(centre) for place in places])
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)
