"""Views of a model from everywhere: rotations that are spread evenly, and those of a vehicle that
stands on the ground.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from poseviewer.geometry.arrays import FloatArray
from poseviewer.vehicle.keypoints import VehicleKeypoints, model_axes

GROUND_STEP_DEG = 10.0
RISES_DEG = (-2.0, 6.0, 14.0, 24.0, 36.0)
"""From the ground, at which cars are photographed: from a kneeling person's to a first floor's."""
ROLLS_DEG = (-6.0, 0.0, 6.0)


def even_rotations(count: int) -> FloatArray:
    """(count, 3, 3): rotations spread evenly over all there are, the same each time.

    M. Alexa, *Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3)* (CVPR 2022). 2,000
    lie about 20 degrees apart.
    """
    step = np.arange(count) + 0.5
    share = step / count
    one = 2.0 * math.pi * step / math.sqrt(2.0)
    other = 2.0 * math.pi * step / 1.533751168755204288118041
    inner, outer = np.sqrt(share), np.sqrt(1.0 - share)
    parts = inner * np.sin(one), inner * np.cos(one), outer * np.sin(other), outer * np.cos(other)
    return Rotation.from_quat(np.column_stack(parts)).as_matrix()


def ground_views(keypoints: VehicleKeypoints) -> FloatArray:
    """(n, 3, 3): a vehicle on level ground, seen from all around by a camera held nearly level."""
    right, behind, up = model_axes(keypoints)
    found = []
    for turn in np.radians(np.arange(0.0, 360.0, GROUND_STEP_DEG)):
        level = math.cos(turn) * right + math.sin(turn) * behind
        for rise in np.radians(RISES_DEG):
            forward = -(math.cos(rise) * level + math.sin(rise) * up)
            down = -(up - (up @ forward) * forward)
            down = down / np.linalg.norm(down)
            upright = np.stack([np.cross(down, forward), down, forward])
            turns = [[0.0, 0.0, roll] for roll in np.radians(ROLLS_DEG)]
            found.append(Rotation.from_rotvec(turns).as_matrix() @ upright)
    return np.concatenate(found)
