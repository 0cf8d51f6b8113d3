"""Edits of the camera; the model stays where it is in the photo, and as large."""

from dataclasses import replace
from typing import Literal

from poseviewer.app.state.camera_change import camera_from_numbers, with_camera
from poseviewer.app.state.edits import edit
from poseviewer.app.state.session import Session
from poseviewer.errors import SettingsError
from poseviewer.geometry.camera import Camera, Parallel, Perspective
from poseviewer.geometry.frames import camera_as_integer_centres


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
def set_camera(session: Session, fx: float, fy: float, cx: float, cy: float) -> Session:
    """Set intrinsics in px, as OpenCV has them (pixel centres at integers)."""
    return _change_camera(
        session, camera_from_numbers(fx, fy, cx, cy, session.document.pose.camera)
    )


@edit
def set_field_of_view(session: Session, degrees: float) -> Session:
    """Set equal focal lengths from the view of the photo's longer side; the centre stays."""
    now = camera_as_integer_centres(session.document.pose.camera)
    camera = Perspective.from_field_of_view(degrees, now.width, now.height)
    return set_camera(camera.fx, camera.fy, now.cx, now.cy)(session)


def _change_camera(session: Session, camera: Camera) -> Session:
    """Session with the active object seen by another camera."""
    document = session.document
    if len(document.scene.views) > 1:
        raise SettingsError(
            "the cameras of several photos are known: open this photo alone to change its camera"
        )
    return session.with_pose(with_camera(document.pose, camera, document.mesh.centre))
