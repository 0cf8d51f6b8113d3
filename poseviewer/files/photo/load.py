"""Photos and masks from files; pictures into files."""

from __future__ import annotations

import hashlib
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, UnidentifiedImageError

from poseviewer.errors import PhotoFileError
from poseviewer.files.photo.heic import decode_heic, heic_exif, is_heic, open_heic
from poseviewer.files.photo.picture_text import described
from poseviewer.files.quiet import quiet_libraries
from poseviewer.files.writing import write_whole
from poseviewer.geometry.photo import Photo

MAX_MEGAPIXELS = 100.0
LARGEST_FILE = 2_000_000_000
"""Bytes: 100 megapixels of three 32-bit floats have 1.2e9."""
MM_PER_RESOLUTION_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""EXIF FocalPlaneResolutionUnit: inch, cm, mm, um."""


def load_photo(path: str | Path) -> Photo:
    """The photo in a JPEG, PNG, TIFF, WebP, BMP or, with its extra, HEIC file: grey or RGB, 8 or
    16 bits, upright.

    Transparency is left out. The header is looked at first, so that a file that would unpack to
    more than 100 megapixels is refused before it is decoded.

    Raises:
        PhotoFileError: there is no such file, or it cannot be used as a photo.
    """
    path = Path(path)
    data = _read(path, "photo")
    if is_heic(data):
        return _heic_photo(path.name, data)
    orientation, focal = _inspect(path.name, data)
    pixels, notes = _decode(path.name, data)
    pixels = np.ascontiguousarray(_upright(pixels, orientation))
    pixels.flags.writeable = False
    return Photo(pixels, path.name, hashlib.sha256(data).hexdigest(), focal, tuple(notes))


def is_stored_turned(path: str | Path) -> bool:
    """Whether a photo's EXIF turns or mirrors it: other tools may show it as it is stored.

    Raises:
        PhotoFileError: it cannot be read.
    """
    path = Path(path)
    return _inspect(path.name, _read(path, "a photo"))[0] != 1


def _heic_photo(name: str, data: bytes) -> Photo:
    picture = open_heic(name, data)
    width, height = picture.size
    _refuse_size(name, width, height)
    pixels = decode_heic(name, picture)
    notes = ()
    if pixels.shape[2] in (2, 4):
        pixels, notes = pixels[..., :-1], ("Its transparency is left out.",)
    pixels = np.ascontiguousarray(pixels)
    pixels.flags.writeable = False
    focal = focal_35mm(heic_exif(picture), width, height)
    return Photo(pixels, name, hashlib.sha256(data).hexdigest(), focal, notes)


def load_mask(path: str | Path, width: int, height: int) -> NDArray[np.float32]:
    """(height, width) weights in [0, 1] from a picture, white 1 and black 0.

    Raises:
        PhotoFileError: no such file, not a picture, or not of the photo's size.
    """
    mask = load_photo(path)
    if (mask.width, mask.height) != (width, height):
        raise PhotoFileError(
            f"{mask.name}: the mask has {mask.width}x{mask.height} px, the photo "
            f"{width}x{height} px; save the mask in the photo's size."
        )
    return mask.grey()


def save_image(path: str | Path, rgb: NDArray, description: str = "") -> None:
    """Write a picture (height, width, 3), RGB, in the format of the file's ending; whole or not.

    A PNG keeps the ``description`` as its text of that name, a JPEG as its comment; other formats
    have no place for it.

    Raises:
        PhotoFileError: the format is unknown, or the folder missing or not to be written to.
    """
    path = Path(path)
    try:
        ok, data = cv2.imencode(path.suffix or ".", np.ascontiguousarray(rgb[..., ::-1]))
    except cv2.error:
        ok, data = False, np.zeros(0, np.uint8)
    if not ok:
        raise PhotoFileError(
            f"{path.name}: pictures cannot be written as {path.suffix!r}; use .png or .jpg."
        )
    write_whole(path, described(data.tobytes(), description), PhotoFileError)


def _read(path: Path, wanted: str) -> bytes:
    if path.is_dir():
        raise PhotoFileError(f"{path.name or path}: is a folder; wanted a {wanted} file.")
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise PhotoFileError(
                f"{path.name}: {size:,} bytes, more than any photo of {MAX_MEGAPIXELS:.0f} "
                f"megapixels; is it a {wanted}?"
            )
        data = path.read_bytes()
    except FileNotFoundError:
        raise PhotoFileError(
            f"{path.name}: no such file in {path.parent}; check the path."
        ) from None
    except OSError as error:
        raise PhotoFileError(f"{path.name}: cannot be read ({error.strerror}).") from error
    if not data:
        raise PhotoFileError(f"{path.name}: an empty file; wanted a {wanted}, copy it again.")
    return data


def _inspect(name: str, data: bytes) -> tuple[int, float | None]:
    """Orientation still to be undone (1 to 8) and 35-mm focal length, from a sound file.

    Pillow decodes the file once to find out whether it is whole: OpenCV fills up with grey.
    """
    # Pillow warns of large pictures and of odd metadata; the size is judged here instead.
    with quiet_libraries():
        try:
            with Image.open(BytesIO(data)) as image:
                _refuse_size(name, *image.size)
                exif = image.getexif()
                # OpenCV turns TIFF upright itself, and only TIFF (when nothing is converted).
                turned = 1 if image.format == "TIFF" else exif.get(ExifTags.Base.Orientation, 1)
                focal = focal_35mm(exif, image.width, image.height)
                image.load()
        except UnidentifiedImageError:
            raise PhotoFileError(
                f"{name}: not a picture that can be read; wanted JPEG, PNG, TIFF, WebP or BMP "
                "with 8 or 16 bits."
            ) from None
        except Image.DecompressionBombError:
            raise PhotoFileError(
                f"{name}: more than {MAX_MEGAPIXELS:.0f} megapixels; make it smaller first."
            ) from None
        except (OSError, SyntaxError, ValueError, EOFError) as error:
            raise PhotoFileError(
                f"{name}: the picture is damaged or cut short ({str(error)[:80]}); copy it again."
            ) from error
    return turned if turned in range(1, 9) else 1, focal


def _refuse_size(name: str, width: int, height: int) -> None:
    if width * height > MAX_MEGAPIXELS * 1e6:
        raise PhotoFileError(
            f"{name}: {width}x{height} px; poseviewer takes up to {MAX_MEGAPIXELS:.0f} megapixels, "
            "make it smaller first."
        )


def focal_35mm(exif: Image.Exif, width: int, height: int) -> float | None:
    """EXIF's own 35-mm focal length, else from the focal length and the sensor's resolution."""
    try:
        tags = exif.get_ifd(ExifTags.IFD.Exif)
        focal = float(tags.get(ExifTags.Base.FocalLengthIn35mmFilm, 0))
        if not focal:
            per_mm = (
                float(tags.get(ExifTags.Base.FocalPlaneXResolution, 0))
                / MM_PER_RESOLUTION_UNIT[tags.get(ExifTags.Base.FocalPlaneResolutionUnit, 2)]
            )
            # The resolution belongs to the picture as taken; it may have been shrunk since.
            taken = float(tags.get(ExifTags.Base.ExifImageWidth, 0)) or width
            diagonal = float(np.hypot(taken, taken * height / width)) / per_mm
            focal = float(tags.get(ExifTags.Base.FocalLength, 0)) * 43.2666 / diagonal
    except (KeyError, TypeError, ValueError, ZeroDivisionError, SyntaxError, OSError):
        return None
    return focal if 1.0 < focal < 10000.0 else None


def _decode(name: str, data: bytes) -> tuple[NDArray, list[str]]:
    """(h, w, 1 or 3) RGB, not yet turned upright."""
    notes: list[str] = []
    try:
        with quiet_libraries():
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        picture = None
    if picture is None:
        raise PhotoFileError(
            f"{name}: OpenCV cannot read this kind of picture; save it as PNG or JPEG."
        )
    picture = picture if picture.ndim == 3 else picture[..., None]
    if picture.dtype not in (np.uint8, np.uint16):
        picture = _as_16_bit(name, picture)
        notes.append("Its numbers were rounded to 16 bits.")
    if picture.shape[2] in (2, 4):
        notes.append("Its transparency is left out.")
        picture = picture[..., :-1]
    return (picture[..., ::-1] if picture.shape[2] == 3 else picture), notes


def _as_16_bit(name: str, picture: NDArray) -> NDArray[np.uint16]:
    """Pictures of floats in [0, 1]; other ranges have no known white."""
    wanted = "save it with 8 or 16 bits."
    if picture.dtype.kind != "f":
        raise PhotoFileError(f"{name}: pixels of type {picture.dtype}; {wanted}")
    if not np.isfinite(picture).all() or picture.min() < 0.0 or picture.max() > 1.0:
        raise PhotoFileError(f"{name}: floating-point pixels outside 0 to 1; {wanted}")
    return np.rint(picture * 65535.0).astype(np.uint16)


def _upright(pixels: NDArray, orientation: int) -> NDArray:
    """A picture turned as EXIF's orientation (1 to 8) says."""
    if orientation >= 5:
        pixels = pixels.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    return pixels
