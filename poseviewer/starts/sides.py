"""Poses of a model seen from one of its sides."""

import numpy as np

from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.placing import find_up, fit_into_rectangle
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.views import look_along
from poseviewer.vehicle.vehicle_keypoints import VehicleKeypoints, model_axes

FILLED = 0.6
"""Share of the photo's width or height that the model fills, whichever is less."""

SIDES = {
    "three-quarter": (-1.0, -1.3, 0.55),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "front": (0.0, -1.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "top": (0.0, 0.0, 1.0),
    "bottom": (0.0, 0.0, -1.0),
}
"""Camera positions as seen from the model: to its right, behind it, above it."""


def look_from(side: str, mesh: Mesh, keypoints: VehicleKeypoints | None, camera: Camera) -> Pose:
    """Return the pose in the photo's middle, filling ``FILLED`` of it, from one of ``SIDES``.

    Args:
        side: a key of ``SIDES``.
        mesh: the model.
        keypoints: key points of a vehicle; None: the model is none.
        camera: camera of the photo.
    """
    if side not in SIDES:
        raise SettingsError(f"no side {side!r} to look from; wanted one of {', '.join(SIDES)}")
    right, behind, up = upright_axes(mesh, keypoints)
    stand = np.array(SIDES[side])
    from_camera = -(stand[0] * right + stand[1] * behind + stand[2] * up)
    forward = from_camera / np.linalg.norm(from_camera)
    # Looking straight down or up, the front of the model is at the upper edge of the photo.
    upwards = up if abs(forward @ up) < 0.99 else -behind
    rotation = look_along(forward, upwards)
    far = np.array([0.0, 0.0, 2.0 * mesh.diameter])
    pose = Pose(camera, RigidTransform(rotation, far - rotation @ mesh.centre))
    width, height = FILLED * camera.width, FILLED * camera.height
    left, top = (camera.width - width) / 2.0, (camera.height - height) / 2.0
    return fit_into_rectangle(pose, mesh, (left, top, width, height))


def upright_axes(
    mesh: Mesh, keypoints: VehicleKeypoints | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors (3,) to the model's right, back and top.

    They come from a vehicle's wheels, from glTF's rule, or from how the model would most likely
    come to rest: by the solid angle of its hull's lowest face.
    """
    if keypoints is not None:
        return model_axes(keypoints)
    up = np.array([0.0, 1.0, 0.0]) if mesh.y_up else find_up(mesh)
    behind = np.array([0.0, 0.0, -1.0]) if up[1] else np.array([0.0, 1.0, 0.0])
    return np.cross(up, behind), behind, up
