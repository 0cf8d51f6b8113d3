"""HEIC photos, by way of libheif (an extra: ``pip install 'poseviewer[heic]'``)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from poseviewer.errors import PhotoFileError

BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
"""Of the file type box (ISO/IEC 23008-12): HEVC pictures, and pictures of any codec."""


def is_heic(data: bytes) -> bool:
    """Whether a file's bytes begin as an HEIC photo's."""
    return data[4:8] == b"ftyp" and data[8:12] in BRANDS


def open_heic(name: str, data: bytes) -> Any:
    """The file's main picture (``pillow_heif.HeifFile``), with its ``size``; not decoded yet.

    Raises:
        PhotoFileError: pillow-heif is not installed, or the file is damaged.
    """
    try:
        import pillow_heif
    except ImportError:
        raise PhotoFileError(
            f"{name}: HEIC photos need pillow-heif; pip install 'poseviewer[heic]', or save the "
            "photo as JPEG."
        ) from None
    try:
        return pillow_heif.open_heif(data, convert_hdr_to_8bit=False)
    except (ValueError, RuntimeError, OSError, EOFError, SyntaxError) as error:
        raise _damaged(name, error) from error


def decode_heic(name: str, picture: Any) -> NDArray:
    """(height, width, 1 to 4): its pixels, 8 bits, or 10 and 12 bits in the upper part of 16.

    libheif turns the picture as the file says; EXIF's orientation does not count in HEIC.

    Raises:
        PhotoFileError: the file is damaged.
    """
    try:
        pixels = np.array(picture)
    except (ValueError, RuntimeError, OSError, EOFError, SyntaxError) as error:
        raise _damaged(name, error) from error
    return pixels if pixels.ndim == 3 else pixels[..., None]


def heic_exif(picture: Any) -> Image.Exif:
    """The picture's EXIF tags; empty where it has none."""
    exif = Image.Exif()
    try:
        exif.load(picture.info.get("exif") or b"")
    except (SyntaxError, ValueError, OSError, KeyError):
        return Image.Exif()
    return exif


def _damaged(name: str, error: Exception) -> PhotoFileError:
    words = " ".join(str(error).split())[:80]
    return PhotoFileError(f"{name}: the HEIC photo is damaged or cut short ({words}); copy again.")
