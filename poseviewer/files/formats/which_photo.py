"""Which photo the numbers of a file belong to, where the photo was undistorted for the pose.

A tool that has the photo's lens model gets camera and lens of the photo as taken. Every other gets
the undistorted photo, written beside its file, and the pinhole camera of that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import PhotoFileError, PoseFileError, PoseViewerError
from poseviewer.files.formats.request import Request
from poseviewer.files.photo.calibrated import photo_text, pixels_for, undistorted
from poseviewer.files.photo.load import load_photo, save_image
from poseviewer.files.pose.file import PhotoReference, PoseRecord
from poseviewer.files.writing import sha256_of
from poseviewer.geometry.photo import Photo


@dataclass(frozen=True, slots=True)
class ForPhoto:
    """A pose, ready to be written for one photo."""

    record: PoseRecord
    """Without an undistortion where it is written for the undistorted photo."""
    request: Request
    files: tuple[Path, ...] = ()
    """The undistorted photo, where it was written."""
    notes: tuple[str, ...] = ()


@contextmanager
def for_one_photo(
    record: PoseRecord, request: Request, held: str | None, beside: Callable[[], Path]
) -> Iterator[ForPhoto]:
    """The pose for the photo as taken where a format has its lens (``held``: what that calls it),
    else for the undistorted photo, which is written to ``request.undistorted_photo`` or
    ``beside()``, and taken away again where what follows fails.

    Raises:
        PoseViewerError: the photo is not known or unusable; a file is in the way; there is nothing
            to undistort.
    """
    if record.undistortion is None:
        if request.undistorted_photo is not None:
            raise PoseFileError(
                "--undistorted-photo, and the pose is one in the photo as taken, without a lens; "
                "leave it out."
            )
        yield ForPhoto(record, request)
        return
    if held is not None and request.undistorted_photo is None:
        yield ForPhoto(record, request, (), (_note_as_taken(record, held),))
        return
    path = request.undistorted_photo or beside()
    picture = _undistorted(record, request)
    is_new = _write(path, picture, request)
    try:
        yield _for_undistorted(record, request, path)
    except PoseViewerError:
        if is_new:
            path.unlink()
        raise


def _note_as_taken(record: PoseRecord, held: str) -> str:
    if held == "both":
        return (
            "The pose and its camera belong to the undistorted photo; the file's distortion block "
            "says how that is made of the photo as taken."
        )
    return f"Camera and lens ({held}) are those of {_name(record)} as taken."


def _name(record: PoseRecord) -> str:
    return (record.photo.file if record.photo else None) or "the photo"


def _undistorted(record: PoseRecord, request: Request) -> Photo:
    if request.photo is None:
        raise PoseFileError(
            "The pose is one in the undistorted photo, which has to be written for it, and the "
            "photo as taken is not known; add --photo FILE."
        )
    photo, camera = load_photo(request.photo), record.pose.camera
    if (photo.width, photo.height) != (camera.width, camera.height):
        raise PhotoFileError(
            f"{photo.name}: {photo.width}x{photo.height} px, and the pose is one for "
            f"{camera.width}x{camera.height} px; name the photo of the pose with --photo."
        )
    known = record.photo.sha256 if record.photo else None
    if known and known.lower() != photo.sha256:
        raise PhotoFileError(
            f"{photo.name}: not the photo that the pose was found on (the fingerprints differ); "
            "name that one with --photo, or this one if you mean it."
        )
    assert record.undistortion is not None  # asked for such poses alone
    return undistorted(photo, record.undistortion)


def _write(path: Path, picture: Photo, request: Request) -> bool:
    """Write the picture; False where a file was there already, with just these pixels or to be
    replaced.
    """
    there = path.exists()
    if there and request.photo is not None and path.samefile(request.photo):
        raise PhotoFileError(
            f"{path}: is the photo as taken, which is never replaced; name another file with "
            "--undistorted-photo."
        )
    if there and not request.overwrite:
        if path.is_file() and np.array_equal(load_photo(path).pixels, picture.pixels):
            return False
        raise PhotoFileError(
            f"{path}: is there already and was not touched; name another for the undistorted "
            "photo with --undistorted-photo, or add --overwrite."
        )
    save_image(path, pixels_for(path, picture), photo_text(picture))
    return not there


def _for_undistorted(record: PoseRecord, request: Request, path: Path) -> ForPhoto:
    camera, name = record.pose.camera, _name(record)
    photo = PhotoReference(path.name, camera.width, camera.height, sha256_of(path))
    # BOP numbers its images by the names of their files.
    image = request.image or (record.photo.file if record.photo else None)
    note = (
        f"All numbers belong to {path.name}, the undistorted photo, which is written; not to "
        f"{name} as taken."
    )
    return ForPhoto(
        replace(record, undistortion=None, photo=photo),
        replace(request, photo=path, image=image),
        (path,),
        (note,),
    )
