"""Which photo the numbers of a file belong to, where the photo was undistorted for the pose.

A tool that has the photo's lens model gets camera and lens of the photo as taken: the same
polynomials under its own names. Every other gets the undistorted photo, written beside its file,
and the pinhole camera of that.

OpenCV's order is k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty; the fisheye's is k1 k2 k3 k4.
COLMAP: https://github.com/colmap/colmap/blob/main/src/colmap/sensor/models.h. nerfstudio hands its
``k1 k2 k3 p1 p2`` (or the fisheye's ``k1 .. k4``) to OpenCV: its ``_undistort_image``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np

from poseviewer.errors import PhotoFileError, PoseFileError, PoseViewerError
from poseviewer.files.formats.request import Request, photo_name, require_perspective
from poseviewer.files.photo import SAME, load_photo, photo_text, pixels_for, save_image, undistorted
from poseviewer.files.pose import PhotoReference, PoseRecord
from poseviewer.files.writing import sha256_of
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import Lens
from poseviewer.geometry.photo import Photo

LensName = Callable[[Lens], str | None]
"""What a format calls a lens's model; None where it does not have it."""


def seen_as_taken(record: PoseRecord, tool: str) -> tuple[Perspective, Lens | None]:
    """Camera (pixel centres at i + 0.5) and lens of the photo as taken; None for a pinhole.

    Raises:
        PoseFileError: the projection is parallel, which this tool's files cannot say.
    """
    camera = require_perspective(record, tool)
    if record.undistortion is None:
        return camera, None
    return record.undistortion.taken, record.undistortion.lens


def colmap_lens(lens: Lens | None) -> tuple[str, tuple[float, ...]] | None:
    """COLMAP's model, with two focal lengths, and its distortion parameters; None: it has none."""
    if lens is None:
        return "PINHOLE", ()
    k = lens.coefficients
    if lens.model == "fisheye":
        return "OPENCV_FISHEYE", k
    if any(k[8:]):
        return None
    return ("FULL_OPENCV", (*k, 0.0, 0.0, 0.0)[:8]) if any(k[4:]) else ("OPENCV", k[:4])


def nerfstudio_lens(lens: Lens | None) -> tuple[str, dict[str, float]] | None:
    """Nerfstudio's model and its parameters; None: it has none. Its fourth ``k`` is another."""
    k = (0.0,) * 4 if lens is None else lens.coefficients
    if lens is not None and lens.model == "fisheye":
        return "OPENCV_FISHEYE", dict(zip(("k1", "k2", "k3", "k4"), k, strict=True))
    if any(k[5:]):
        return None
    names = ("k1", "k2", "p1", "p2", "k3")
    return "OPENCV", dict(zip(names, k if any(k[4:]) else k[:4], strict=False))


def lens_held(record: PoseRecord, name: LensName) -> str | None:
    """A format's name for the lens before the camera as taken, where it has that lens; None too
    where the pose has another camera than that of the undistorted photo (a focal length that was
    found): no lens model says that.
    """
    undistortion, camera = record.undistortion, record.pose.camera
    if undistortion is None or not isinstance(camera, Perspective):
        return None
    same = np.allclose(astuple(camera), astuple(undistortion.camera), rtol=SAME)
    return name(undistortion.lens) if same else None


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
    name = photo_name(record) or "the photo"
    if held is not None and request.undistorted_photo is None:
        note = f"Camera and lens ({held}) are those of {name} as taken."
        if held == "both":
            note = (
                "The pose and its camera belong to the undistorted photo; the file's distortion "
                "block says how that is made of the photo as taken."
            )
        yield ForPhoto(record, request, notes=(note,))
        return
    path = request.undistorted_photo or beside()
    is_new = _write(path, _undistorted(record, request), request)
    camera = record.pose.camera
    photo = PhotoReference(path.name, camera.width, camera.height, sha256_of(path))
    note = (
        f"All numbers belong to {path.name}, the undistorted photo, which is written; not to "
        f"{name} as taken."
    )
    # BOP numbers its images by the names of their files.
    asked = replace(request, photo=path, image=request.image or photo_name(record))
    try:
        yield ForPhoto(replace(record, undistortion=None, photo=photo), asked, (path,), (note,))
    except PoseViewerError:
        if is_new:
            path.unlink()
        raise


def _undistorted(record: PoseRecord, request: Request) -> Photo:
    if request.photo is None:
        raise PoseFileError(
            "The pose is one in the undistorted photo, which has to be written for it, and the "
            "photo as taken is not known; add --photo FILE."
        )
    photo = load_photo_of(record, request.photo)
    known = record.photo.sha256 if record.photo else None
    if known and known.lower() != photo.sha256:
        raise PhotoFileError(
            f"{photo.name}: not the photo that the pose was found on (the fingerprints differ); "
            "name that one with --photo, or this one if you mean it."
        )
    assert record.undistortion is not None  # asked for such poses alone
    return undistorted(photo, record.undistortion)


def load_photo_of(record: PoseRecord, path: Path) -> Photo:
    """The photo of a pose.

    Raises:
        PhotoFileError: it cannot be read, or has another size than the pose's.
    """
    photo, camera = load_photo(path), record.pose.camera
    if (photo.width, photo.height) != (camera.width, camera.height):
        raise PhotoFileError(
            f"{photo.name}: {photo.width}x{photo.height} px, and the pose is one for "
            f"{camera.width}x{camera.height} px; name the photo of the pose with --photo."
        )
    return photo


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
