"""A pose of a photo as a pose of the photo made smaller by a whole number."""

from __future__ import annotations

from poseviewer.geometry.camera import Parallel, Perspective, Pose


def level_pose(pose: Pose, factor: int) -> Pose:
    """The pose in the picture of a level: sizes rounded up, coordinates divided exactly."""
    if factor == 1:
        return pose
    camera = pose.camera
    width, height = reduced_size(camera.width, factor), reduced_size(camera.height, factor)
    cx, cy = camera.cx / factor, camera.cy / factor
    if isinstance(camera, Perspective):
        smaller = Perspective(camera.fx / factor, camera.fy / factor, cx, cy, width, height)
        return Pose(smaller, pose.camera_from_model)
    return Pose(Parallel(camera.scale / factor, cx, cy, width, height), pose.camera_from_model)


def reduced_size(size: int, factor: int) -> int:
    """Pixels along a side that shows ``size`` px, ``factor`` to each; the last may be in part."""
    return -(-size // factor)
