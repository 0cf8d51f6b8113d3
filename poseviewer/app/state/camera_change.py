"""Change of a pose's camera: the model's centre keeps its pixel, and the model its size there."""

from dataclasses import replace

from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Pose
from poseviewer.starts.placing import with_point_at


def with_camera(pose: Pose, camera: Camera, centre: FloatArray) -> Pose:
    """The pose by another camera; ``centre`` (3,) of the model keeps its pixel and px per unit."""
    old, in_camera = pose.camera, pose.camera_from_model.apply(centre)
    depth = in_camera[2]
    px_per_unit = old.scale if isinstance(old, Parallel) else old.fx / depth
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=px_per_unit)
    else:
        depth = camera.fx / px_per_unit
    return with_point_at(replace(pose, camera=camera), centre, old.project(in_camera), depth)
