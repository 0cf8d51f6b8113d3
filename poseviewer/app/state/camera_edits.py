"""Edits of the camera; the model keeps its place and its size in the photo."""

import math
from dataclasses import replace
from typing import Literal

from poseviewer.app.state.document import with_camera
from poseviewer.app.state.edits import edit
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Camera, Parallel, Perspective
from poseviewer.geometry.frames import camera_as_integer_centres, camera_from_integer_centres

MIN_FOCAL_PX = 1.0
MAX_FOCAL = 1000.0
"""Largest focal length, in the photo's longer side: a telescope's."""
MAX_CENTRE_OFFSET = 10.0
"""Largest distance of the principal point from the photo's middle, in its longer side: more than
any crop of a photo leaves."""
MIN_FIELD_DEG = 0.5
MAX_FIELD_DEG = 170.0
"""Largest field of view."""


@edit
def set_projection(session: Session, projection: Literal["perspective", "parallel"]) -> Session:
    """Set perspective or parallel projection."""
    document, camera = session.document, session.document.pose.camera
    if isinstance(camera, Parallel) is (projection == "parallel"):
        return session
    if projection == "parallel":
        other = Parallel(1.0, camera.cx, camera.cy, camera.width, camera.height)
    else:
        start = document.start.camera
        start = start if isinstance(start, Perspective) else document.photo.default_camera()
        other = replace(start, cx=camera.cx, cy=camera.cy)
    return _change_camera(session, other)


@edit
def set_camera(
    session: Session,
    fx: float | None = None,
    fy: float | None = None,
    cx: float | None = None,
    cy: float | None = None,
) -> Session:
    """Set intrinsics, px, by OpenCV's convention (pixel centres at integers); None: as it is.

    Args:
        session: before the edit.
        fx: focal length; ignored under parallel projection.
        fy: likewise.
        cx: principal point.
        cy: likewise.
    """
    now = session.document.pose.camera
    given = (fx, fy, cx, cy)
    pairs = zip(given, intrinsics_of(now), strict=True)
    fx, fy, cx, cy = (old if value is None else value for value, old in pairs)
    longer = max(now.width, now.height)
    max_offset, max_focal = MAX_CENTRE_OFFSET * longer, MAX_FOCAL * longer
    if not math.hypot(cx - now.width / 2.0, cy - now.height / 2.0) <= max_offset:
        raise SettingsError(
            f"cx, cy = {cx:g}, {cy:g}: wanted a centre within {max_offset:g} px of the photo's "
            "middle; nothing was changed"
        )
    is_parallel = isinstance(now, Parallel)
    if not is_parallel and not all(MIN_FOCAL_PX <= value <= max_focal for value in (fx, fy)):
        raise SettingsError(
            f"fx, fy = {fx:g}, {fy:g}: wanted focal lengths of {MIN_FOCAL_PX:g} to "
            f"{max_focal:g} px; nothing was changed"
        )
    camera = camera_from_integer_centres(Perspective(fx, fy, cx, cy, now.width, now.height))
    camera = replace(now, cx=camera.cx, cy=camera.cy) if is_parallel else camera
    return _change_camera(session, camera)


@edit
def set_field_of_view(session: Session, degrees: float) -> Session:
    """Set equal focal lengths by the field of view of the photo's longer side, in degrees."""
    now = session.document.pose.camera
    camera = Perspective.from_field_of_view(degrees, now.width, now.height)
    return set_camera(camera.fx, camera.fy)(session)


def intrinsics_of(camera: Camera) -> tuple[float, ...]:
    """fx, fy, cx and cy in px, as OpenCV has them; the scale in place of focal lengths."""
    camera = camera_as_integer_centres(camera)
    focal = (camera.scale,) * 2 if isinstance(camera, Parallel) else (camera.fx, camera.fy)
    return (*focal, camera.cx, camera.cy)


def _change_camera(session: Session, camera: Camera) -> Session:
    document = session.document
    if len(document.scene.views) > 1:
        raise SettingsError(
            "the cameras of several photos are known: open this photo alone to change its camera"
        )
    changed = document.at_pose(with_camera(document.pose, camera, document.mesh.centre))
    if document.object.is_placed:
        return session.with_document(changed)
    session = session.with_document(changed.with_object(is_placed=False))
    return session.with_first_proposals if session.is_looking else session
