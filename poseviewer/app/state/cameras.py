"""Other cameras for the pose at hand: typed in, by field of view, or of the other projection.

The model's centre stays in its place of the photo, and the model as large as it was.
"""

from __future__ import annotations

import math
from dataclasses import replace

from poseviewer.app.state import commands as c
from poseviewer.app.state.document import Document, with_camera, with_projection
from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Camera, Parallel, Perspective, Pose
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres

LEAST_FOCAL_PX = 1.0
LARGEST_FOCAL = 1000.0
"""Times the photo's longer side: a telescope's."""
FARTHEST_CENTRE = 10.0
"""From the photo's middle, times its longer side: more than any crop of a photo leaves."""
NARROWEST_DEG, WIDEST_DEG = 0.5, 170.0
"""Fields of view."""


def with_typed_camera(document: Document, typed: c.SetCamera) -> Pose:
    """The pose seen by a camera whose numbers were typed in; under parallel projection only its
    centre counts.

    Raises:
        SettingsError: no camera is like that.
    """
    photo, now = document.registration.photo, document.pose.camera
    _require_centre(typed, photo.width, photo.height)
    if not isinstance(now, Parallel):
        _require_focal(typed, LARGEST_FOCAL * max(photo.width, photo.height))
    parameters = (typed.fx, typed.fy, typed.cx, typed.cy)
    camera: Camera = camera_from_integer_centres(
        Perspective(*parameters, photo.width, photo.height)
    )
    if isinstance(now, Parallel):
        camera = replace(now, cx=camera.cx, cy=camera.cy)
    return with_camera(document.pose, camera, document.registration.mesh.centre)


def with_field_of_view(document: Document, degrees: float) -> Pose:
    """The pose seen by a camera with so wide a view of the photo's longer side.

    Raises:
        SettingsError: no photo has such a field of view.
    """
    if not NARROWEST_DEG <= degrees <= WIDEST_DEG:
        raise SettingsError(
            f"field of view = {degrees:g}: wanted {NARROWEST_DEG:g} to {WIDEST_DEG:g} degrees; "
            "nothing was changed"
        )
    photo, centre = document.registration.photo, camera_as_integer_centres(document.pose.camera)
    camera = Perspective.from_field_of_view(degrees, photo.width, photo.height)
    return with_typed_camera(document, c.SetCamera(camera.fx, camera.fy, centre.cx, centre.cy))


def with_other_projection(document: Document, projection: str) -> Pose:
    """The pose under ``perspective`` or ``parallel``; the same object where it is so already."""
    camera, start = document.pose.camera, document.registration.start.camera
    fallback = document.registration.photo.default_camera()
    if isinstance(start, Perspective):
        fallback = start
    fallback = replace(fallback, cx=camera.cx, cy=camera.cy)
    return with_projection(document.pose, projection, fallback, document.registration.mesh.centre)


def _require_focal(typed: c.SetCamera, largest: float) -> None:
    if not all(LEAST_FOCAL_PX <= value <= largest for value in (typed.fx, typed.fy)):
        raise SettingsError(
            f"fx, fy = {typed.fx:g}, {typed.fy:g}: wanted focal lengths of {LEAST_FOCAL_PX:g} to "
            f"{largest:g} px; nothing was changed"
        )


def _require_centre(typed: c.SetCamera, width: int, height: int) -> None:
    reach = FARTHEST_CENTRE * max(width, height)
    away = math.hypot(typed.cx - width / 2.0, typed.cy - height / 2.0)
    if not away <= reach:
        raise SettingsError(
            f"cx, cy = {typed.cx:g}, {typed.cy:g}: wanted a centre within {reach:g} px of the "
            "photo's middle; nothing was changed"
        )
