"""Key points of a vehicle: the wheel centres and the axle that the paper's pose is made of."""

from dataclasses import dataclass

import numpy as np

from poseviewer.geometry.arrays import FloatArray, freeze_array
from poseviewer.geometry.mesh import Mesh

MIN_SIDE_OFFSET = 0.4
"""Smallest offset of a side's wheels from the model's middle, in shares of half its width."""


@dataclass(frozen=True, slots=True, eq=False)
class SideKeypoints:
    """The key points of one side, in the model's frame and unit.

    The axle is made perpendicular to the wheelbase, as the chart's closed form needs.
    """

    rear_wheel: FloatArray
    """(3,): centre of the rear wheel's outer face."""
    front_wheel: FloatArray
    """(3,): centre of the front wheel's outer face."""
    axle: FloatArray
    """(3,): unit direction of the rear axle, outwards on this side."""

    def __post_init__(self) -> None:
        rear = freeze_array(self.rear_wheel, (3,))
        front = freeze_array(self.front_wheel, (3,))
        along = front - rear
        if not np.linalg.norm(along) > 0.0:
            raise ValueError("rear and front wheel are the same point")
        axle = np.asarray(self.axle, dtype=float)
        across = axle - along * (axle @ along) / (along @ along)
        if not np.linalg.norm(across) > 0.5 * np.linalg.norm(axle):
            raise ValueError("the axle points along the wheelbase")
        object.__setattr__(self, "rear_wheel", rear)
        object.__setattr__(self, "front_wheel", front)
        object.__setattr__(self, "axle", freeze_array(across / np.linalg.norm(across), (3,)))

    @property
    def wheelbase(self) -> float:
        """Distance between the wheel centres, in the model's unit."""
        return float(np.linalg.norm(self.front_wheel - self.rear_wheel))


@dataclass(frozen=True, slots=True)
class VehicleKeypoints:
    """The key points of both sides; the side that the camera sees counts."""

    left: SideKeypoints
    right: SideKeypoints


def keypoints_from_side(mesh: Mesh, rear: FloatArray, front: FloatArray) -> VehicleKeypoints:
    """Return the key points from the outer faces' centres (3,) of a side's two wheels.

    The other side is their mirror image. The vehicle's axes are the model's: the wheels are at its
    border to the side, and in its lower half.

    Raises:
        ValueError: the points are no wheels of one side.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    along = int(np.argmax(np.abs(front - rear)))
    away = ((rear + front) - (low + high)) / np.maximum(high - low, 1e-300)
    side, height = sorted({0, 1, 2} - {along}, key=lambda axis: -abs(away[axis]))
    if abs(away[side]) < MIN_SIDE_OFFSET:
        raise ValueError("they are not both at one side of the model")
    axes = np.eye(3)
    outwards, up = np.sign(away[side]) * axes[side], -np.sign(away[height]) * axes[height]
    across = (low + high)[side] * axes[side]
    flip = 1.0 - 2.0 * axes[side]
    given = SideKeypoints(rear, front, outwards)
    mirrored = SideKeypoints(flip * rear + across, flip * front + across, -outwards)
    is_left = float(np.cross(up, front - rear) @ outwards) > 0.0
    return VehicleKeypoints(given, mirrored) if is_left else VehicleKeypoints(mirrored, given)


def model_axes(keypoints: VehicleKeypoints) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors (3,) to the model's right, to its back, and upwards, in its frame."""
    right = keypoints.right.axle
    behind = keypoints.left.rear_wheel - keypoints.left.front_wheel
    behind = behind - right * (behind @ right)
    behind = behind / np.linalg.norm(behind)
    return right, behind, np.cross(behind, right)
