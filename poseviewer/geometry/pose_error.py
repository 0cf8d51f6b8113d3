"""Error of a pose against the truth."""

import math
from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.camera import Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.symmetry_group import NO_SYMMETRY, Symmetry
from poseviewer.geometry.transform import rotation_angle


@dataclass(frozen=True, slots=True)
class PoseError:
    """The distance between an estimated and the true pose of one model in one photo."""

    reprojection_px: float
    """Mean distance in the photo between the model's vertices at both poses."""
    percent: float
    """``reprojection_px`` by the diagonal of the model's box in the photo, per cent."""
    rotation_deg: float


def pose_error(
    mesh: Mesh, estimate: Pose, truth: Pose, symmetry: Symmetry = NO_SYMMETRY
) -> PoseError:
    """Compare a pose with the truth over all vertices; infinite behind a camera.

    Args:
        mesh: the model.
        estimate: the pose, in place of which the equal one nearest in rotation is taken.
        truth: the true pose.
        symmetry: symmetry of the model.
    """
    estimate = symmetry.nearest_pose(estimate, truth)
    vertices = np.unique(mesh.vertices, axis=0)
    true_pixels = truth.project(vertices)
    distance = np.linalg.norm(estimate.project(vertices) - true_pixels, axis=1)
    pixels = float(np.nan_to_num(distance, nan=np.inf).mean())
    diagonal = float(np.linalg.norm(np.ptp(true_pixels, axis=0)))
    angle = rotation_angle(estimate.camera_from_model.rotation, truth.camera_from_model.rotation)
    percent = 100.0 * pixels / diagonal if math.isfinite(pixels) else math.inf
    return PoseError(pixels, percent, math.degrees(angle))
