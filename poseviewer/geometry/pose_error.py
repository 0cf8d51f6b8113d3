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
    """The same, as 100 times the share of the diagonal of the model's box in the photo."""
    rotation_deg: float


def pose_error(
    mesh: Mesh, estimate: Pose, truth: Pose, symmetry: Symmetry = NO_SYMMETRY
) -> PoseError:
    """Errors over all vertices, infinite behind a camera, of the equal pose nearest in rotation."""
    estimate = symmetry.nearest_pose(estimate, truth)
    vertices = np.unique(mesh.vertices, axis=0)
    there = truth.project(vertices)
    distance = np.linalg.norm(estimate.project(vertices) - there, axis=1)
    pixels = float(np.nan_to_num(distance, nan=np.inf).mean())
    diagonal = float(np.linalg.norm(np.ptp(there, axis=0)))
    angle = rotation_angle(estimate.camera_from_model.rotation, truth.camera_from_model.rotation)
    return PoseError(pixels, 100.0 * pixels / diagonal, math.degrees(angle))
