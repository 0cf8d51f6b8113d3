"""Another camera for a pose: the model's centre stays in its place, as large as it was."""

import math
from dataclasses import replace

from poseviewer.errors import SettingsError
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_from_integer_centres
from poseviewer.starts.placing import with_point_at

LEAST_FOCAL_PX = 1.0
LARGEST_FOCAL = 1000.0
"""Times the photo's longer side: a telescope's."""
FARTHEST_CENTRE = 10.0
"""From the photo's middle, times its longer side: more than any crop of a photo leaves."""
NARROWEST_DEG, WIDEST_DEG = 0.5, 170.0
"""Fields of view."""


def with_camera(pose: Pose, camera: Camera, centre: FloatArray) -> Pose:
    """``pose`` seen by another camera; ``centre`` (3,) of the model stays in its place."""
    old, at = pose.camera, pose.camera_from_model.apply(centre)
    depth, per_unit = at[2], old.scale if isinstance(old, Parallel) else old.fx / at[2]
    if isinstance(camera, Parallel):
        camera = replace(camera, scale=per_unit)
    else:
        depth = camera.fx / per_unit
    return with_point_at(replace(pose, camera=camera), centre, old.project(at), depth)


def camera_from_numbers(fx: float, fy: float, cx: float, cy: float, now: Camera) -> Camera:
    """A camera of typed intrinsics in px (pixel centres at integers) for the photo of ``now``."""
    longer = max(now.width, now.height)
    reach, largest = FARTHEST_CENTRE * longer, LARGEST_FOCAL * longer
    if not math.hypot(cx - now.width / 2.0, cy - now.height / 2.0) <= reach:
        raise SettingsError(
            f"cx, cy = {cx:g}, {cy:g}: wanted a centre within {reach:g} px of the photo's middle; "
            "nothing was changed"
        )
    parallel = isinstance(now, Parallel)
    if not parallel and not all(LEAST_FOCAL_PX <= value <= largest for value in (fx, fy)):
        raise SettingsError(
            f"fx, fy = {fx:g}, {fy:g}: wanted focal lengths of {LEAST_FOCAL_PX:g} to "
            f"{largest:g} px; nothing was changed"
        )
    camera = camera_from_integer_centres(Perspective(fx, fy, cx, cy, now.width, now.height))
    return replace(now, cx=camera.cx, cy=camera.cy) if parallel else camera
