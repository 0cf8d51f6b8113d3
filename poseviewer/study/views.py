"""Views of a vehicle as people photograph cars: from a side, somewhat above, filling the photo."""

from __future__ import annotations

import math

import numpy as np

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.mesh import Mesh
from poseviewer.geometry.transform import RigidTransform
from poseviewer.vehicle.keypoints import VehicleKeypoints

LARGEST_SHARE = 0.8
"""Of the photo's width and height that the vehicle fills at most."""
TURN_DEG, LEAST_RISE_DEG, MOST_RISE_DEG, ROLL_DEG = 50.0, 4.0, 25.0, 3.0
"""Off the view straight at a side; up from the ground; about the line of sight."""
DEPTH_PER_DIAMETER = 4.0
"""Where parallel projection puts the vehicle, which no photo can tell."""


def random_view(
    mesh: Mesh,
    keypoints: VehicleKeypoints,
    size: tuple[int, int],
    parallel: bool,
    random: np.random.Generator,
) -> Pose:
    """A pose in a photo of ``size`` (width, height) px that shows the whole vehicle."""
    rotation = _rotation(keypoints, random)
    seen = (mesh.vertices - mesh.centre) @ rotation.T
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    room = np.array(size) * LARGEST_SHARE
    scale = float(np.min(room / (high - low))) * random.uniform(0.75, 1.0)
    free = np.array(size) / scale - (high - low)
    middle = 0.25 * free * random.uniform(-1.0, 1.0, 2)
    camera, depth = _camera(size, scale, parallel, mesh.diameter, random)
    centre = np.array([*(middle - (low + high) / 2.0), depth])
    return Pose(camera, RigidTransform(rotation, centre - rotation @ mesh.centre))


def _camera(
    size: tuple[int, int],
    scale: float,
    parallel: bool,
    diameter: float,
    random: np.random.Generator,
) -> tuple[Camera, float]:
    """The camera, and the depth at which a unit of the model is ``scale`` px long."""
    width, height = size
    if parallel:
        camera = Parallel(scale, width / 2.0, height / 2.0, width, height)
        return camera, DEPTH_PER_DIAMETER * diameter
    camera = Perspective.from_field_of_view(random.uniform(20.0, 40.0), width, height)
    return camera, camera.fx / scale


def _rotation(keypoints: VehicleKeypoints, random: np.random.Generator) -> FloatArray:
    """(3, 3): camera from model."""
    left = keypoints.left
    up = np.cross(left.front_wheel - left.rear_wheel, left.axle)
    up = up / np.linalg.norm(up)
    side = (keypoints.left, keypoints.right)[int(random.integers(2))]
    along = (side.front_wheel - side.rear_wheel) / side.wheelbase
    turn = math.radians(random.uniform(-TURN_DEG, TURN_DEG))
    rise = math.radians(random.uniform(LEAST_RISE_DEG, MOST_RISE_DEG))
    level = math.cos(turn) * side.axle + math.sin(turn) * along
    forward = -(math.cos(rise) * level + math.sin(rise) * up)
    down = -(up - (up @ forward) * forward)
    down = down / np.linalg.norm(down)
    roll = math.radians(random.uniform(-ROLL_DEG, ROLL_DEG))
    right = np.cross(down, forward)
    cosine, sine = math.cos(roll), math.sin(roll)
    return np.stack([cosine * right + sine * down, cosine * down - sine * right, forward])
