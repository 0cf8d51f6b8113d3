"""Photos with their calibrated cameras: undistorted once, for the search and for the eye."""

from __future__ import annotations

import json
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import CalibrationFileError, PhotoFileError
from poseviewer.files.camera.calibration import Calibration, load_calibration
from poseviewer.files.photo.load import load_photo
from poseviewer.files.pose.distortion import distortion_as_json
from poseviewer.files.pose.file import PoseRecord
from poseviewer.geometry.camera import Camera, Perspective
from poseviewer.geometry.frames import camera_as_integer_centres
from poseviewer.geometry.lens import LARGEST_SIDE, Undistortion, undistort
from poseviewer.geometry.photo import Photo

SAME = 1e-9
"""Relative: files round cx and cy in their last digit."""
DEEP_FORMATS = (".png", ".tif", ".tiff")
"""Those of 16 bits."""
NOTABLE = 1e-3
"""From which relative difference on two cameras are spoken of."""


def load_calibrated_photo(path: str | Path, calibration: Calibration | None = None) -> Photo:
    """The photo in a file; with a calibration, undistorted, and with its camera.

    Raises:
        PhotoFileError: the photo cannot be used.
        CalibrationFileError: the calibration cannot be, or not with this photo.
    """
    photo = load_photo(path)
    if calibration is None:
        return photo
    found = load_calibration(calibration, photo.name, photo.width, photo.height)
    if found.lens is None:
        return replace(photo, camera=found.camera)
    return undistorted(photo, Undistortion.of(found.lens, found.camera, calibration.zoom))


def undistorted(photo: Photo, undistortion: Undistortion) -> Photo:
    """The undistorted photo of one as taken.

    Raises:
        PhotoFileError: it is too wide or high.
        CalibrationFileError: it would show nothing.
    """
    if max(photo.width, photo.height) > LARGEST_SIDE:
        raise PhotoFileError(
            f"{photo.name}: {photo.width}x{photo.height} px; a photo can be undistorted up to "
            f"{LARGEST_SIDE} px a side, make it smaller first."
        )
    pixels, covered = undistort(photo.pixels, undistortion)
    if not covered.any():
        raise CalibrationFileError(
            f"{photo.name}: undistorted it shows nothing of the photo; check the distortion "
            "coefficients, and whether they are of the fisheye model."
        )
    pixels.flags.writeable = covered.flags.writeable = False
    return replace(
        photo,
        pixels=pixels,
        camera=undistortion.camera,
        undistortion=undistortion,
        covered=None if covered.all() else covered,
    )


def matched(photo: Photo, start: PoseRecord) -> tuple[Photo, PoseRecord, tuple[str, ...]]:
    """Photo and start pose, both of the same picture; and what the user should know.

    A start of an undistorted photo undistorts the photo. A calibrated camera stands in for the
    start's own, unless the start was found on just this undistorted photo.

    Raises:
        PoseViewerError: they do not go together.
    """
    if photo.camera is None:
        if start.undistortion is None:
            return photo, start, ()
        return undistorted(photo, start.undistortion), start, ()
    if same_undistortion(photo.undistortion, start.undistortion) and start.undistortion is not None:
        return photo, start, ()
    now = start.pose.camera
    if not isinstance(now, Perspective):
        raise CalibrationFileError(
            f"{photo.name}: the start pose is under parallel projection, and the calibration is "
            "of a perspective camera; leave one of the two out."
        )
    pose = replace(start.pose, camera=photo.camera)
    start = replace(start, pose=pose, undistortion=photo.undistortion, chart=None, loss=None)
    if np.allclose(astuple(now), astuple(photo.camera), rtol=NOTABLE):
        return photo, start, ()
    note = (
        f"The calibrated camera ({_numbers(photo.camera)}) is used, not the start pose's "
        f"({_numbers(now)}); rotation and translation stay."
    )
    return photo, start, (note,)


def same_undistortion(one: Undistortion | None, other: Undistortion | None) -> bool:
    """Whether two give the same picture, up to the rounding of files."""
    if one is None or other is None:
        return one is other
    if one.lens != other.lens:
        return False
    pairs = ((one.taken, other.taken), (one.camera, other.camera))
    return all(np.allclose(astuple(a), astuple(b), rtol=SAME) for a, b in pairs)


def photo_text(photo: Photo) -> str:
    """Which photo a picture or numbers belong to, to be written into their file."""
    text = f"Photo: {photo.label}; SHA-256 of its file: {photo.sha256}"
    if photo.undistortion is None:
        return text
    return f"{text}; distortion: {json.dumps(distortion_as_json(photo.undistortion))}"


def pixels_for(path: Path, photo: Photo) -> NDArray:
    """(height, width, 1 or 3): a photo's pixels as the format of a file's ending can hold them."""
    if path.suffix.lower() in DEEP_FORMATS:
        return photo.pixels
    return photo.as_rgb8(photo.width, photo.height)


def _numbers(camera: Camera) -> str:
    shifted = camera_as_integer_centres(camera)
    assert isinstance(shifted, Perspective)  # asked for perspective cameras alone
    return f"fx {shifted.fx:.1f}, fy {shifted.fy:.1f}, cx {shifted.cx:.1f}, cy {shifted.cy:.1f} px"
