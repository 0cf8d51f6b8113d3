"""The calibrated camera of a photo, chosen and scaled from a file of cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.errors import CalibrationFileError
from poseviewer.files.camera.cameras import FileCamera, load_cameras
from poseviewer.geometry.camera import Perspective

ROUNDING_PX = 1.0
"""By how much a picture's size may differ from an exact scaling: programs round and cut off."""
MOST_NAMES = 8


@dataclass(frozen=True, slots=True)
class Calibration:
    """A file of cameras, and what the user says of it."""

    path: Path
    camera: str | None = None
    """Which camera of the file; None: the only one, or the one that took the photo."""
    crop: tuple[int, int, int, int] | None = None
    """The rectangle (left, top, width, height) of the calibrated picture that the photo shows."""
    resized: bool = False
    """The photo is the calibrated picture, or its rectangle, in another size."""
    fisheye: bool = False
    """The coefficients are of OpenCV's fisheye model, though the file does not say so."""
    zoom: float = 1.0
    """Focal length of the undistorted photo, as a share of the calibrated one."""


def load_calibration(choice: Calibration, photo: str, width: int, height: int) -> FileCamera:
    """The camera that took the photo named ``photo``, of ``width`` x ``height`` px.

    Raises:
        CalibrationFileError: the file cannot be used; it has several cameras and none of them is
            chosen; the camera is for pictures of another size.
    """
    found = _chosen(choice, load_cameras(choice.path, choice.fisheye), photo)
    return replace(found, camera=_for_size(choice, found.camera, width, height))


def _error(name: str, found: str, wanted: str) -> CalibrationFileError:
    return CalibrationFileError(f"{name}: {found}; {wanted}.")


def _chosen(choice: Calibration, cameras: list[FileCamera], photo: str) -> FileCamera:
    name = choice.path.name
    if choice.camera is not None:
        for camera in cameras:
            if camera.name == choice.camera:
                return camera
        raise _error(name, f"no camera {choice.camera[:30]!r} in it", f"it has {_names(cameras)}")
    if len(cameras) == 1:
        return cameras[0]
    stem = Path(photo).stem
    named = [c for c in cameras if photo in c.photos]
    # BOP numbers its photos: 000017.png is the scene's 17.
    named = named or [c for c in cameras if stem.isdigit() and c.name == str(int(stem))]
    if len(named) == 1:
        return named[0]
    found = f"{len(cameras)} cameras, {_names(cameras)}, and none of them named after {photo}"
    raise _error(name, found, "choose one by --calibration-camera NAME")


def _names(cameras: list[FileCamera]) -> str:
    names = [repr(camera.name) if camera.name else "one without a name" for camera in cameras]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more


def _for_size(choice: Calibration, camera: Perspective, width: int, height: int) -> Perspective:
    """The camera of the photo: cropped and resized as the user says, or of its size already."""
    name, sized = choice.path.name, camera.width > 0
    if choice.crop is not None:
        left, top, across, down = choice.crop
        outside = sized and (left + across > camera.width or top + down > camera.height)
        if min(left, top) < 0 or min(across, down) < 1 or outside:
            found = f"is for {_size(camera)}, and {left},{top},{across},{down} is not inside"
            raise _error(name, found, "give --calibration-crop left,top,width,height in its px")
        camera = camera.cropped(left, top, across, down)
    elif not sized:
        if choice.resized:
            found = "says no size of its pictures"
            raise _error(name, found, "give it as --calibration-crop 0,0,WIDTH,HEIGHT")
        return replace(camera, width=width, height=height)
    if (camera.width, camera.height) == (width, height):
        return camera
    if choice.resized and _is_scaling(camera, width, height):
        return camera.resized(width, height)
    raise _error(name, f"the camera is for {_size(camera)}, the photo has {width}x{height} px",
           _advice(choice, camera, width, height))  # fmt: skip


def _advice(choice: Calibration, camera: Perspective, width: int, height: int) -> str:
    if (camera.height, camera.width) == (width, height):
        return "the photo is turned upright, calibrate on upright photos"
    if _is_scaling(camera, width, height):
        return "if the photo is the whole picture resized, add --calibration-resized"
    if choice.resized:
        return "their sides differ in ratio, so it is no plain resizing"
    return "if it is a part of the calibrated picture, add --calibration-crop left,top,width,height"


def _is_scaling(camera: Perspective, width: int, height: int) -> bool:
    """Whether one factor, and rounding, makes one size of the other."""
    least = max((width - ROUNDING_PX) / camera.width, (height - ROUNDING_PX) / camera.height)
    most = min((width + ROUNDING_PX) / camera.width, (height + ROUNDING_PX) / camera.height)
    return least <= most


def _size(camera: Perspective) -> str:
    return f"{camera.width}x{camera.height} px" if camera.width else "pictures of unsaid size"
