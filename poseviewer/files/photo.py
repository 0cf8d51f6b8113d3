"""Photos from files, undistorted where the camera is calibrated; pictures into files."""

import hashlib
import re
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError
from PIL.ExifTags import IFD
from PIL.ExifTags import Base as Tag

from poseviewer.errors import CalibrationFileError, PhotoFileError, printable
from poseviewer.files.cameras import Calibration, load_calibration
from poseviewer.files.checks import MAX_DATA_BYTES, InputFile, quiet_libraries
from poseviewer.files.structs import Distortion
from poseviewer.files.writing import write_whole
from poseviewer.geometry.image import Photo
from poseviewer.geometry.lens import MAX_SIDE_PX, UPRIGHT, Undistortion, undistort
from poseviewer.processes import memory_bytes

HEIC_ENDINGS = (".heic", ".heif")
ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", *HEIC_ENDINGS)
FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "PPM")
"""Pillow's names of them; its readers of others believe the lengths that a file claims."""
RAW_ENDINGS = (".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw")
WHITE_IS_ZERO = 0
"""Value of TIFF's ``PhotometricInterpretation``."""
IN_PLANES = 2
"""Value of ``PlanarConfiguration``: each colour has a plane of its own."""
REDUCED = 1
"""Value of ``NewSubfileType`` of a preview, as that of raw files is."""
NO_PAGE = 1 | 4
"""Values of ``NewSubfileType`` of previews and masks."""
PAGED = ("TIFF", "WEBP", "PNG")
"""Formats of several pictures; a phone's JPEG holds a map of brightness beside its picture."""
PAGED_ENDINGS = (".tif", ".tiff", ".webp", ".png")
OF_PAGES = OSError, SyntaxError, ValueError, TypeError, LookupError, ArithmeticError, struct.error
"""Errors of damaged pages, whose picture before them is whole."""
MAX_PAGES = 1000
"""Pages of a TIFF that are counted."""
MAX_MEGAPIXELS = 100.0
FRAME_BYTES_PER_PX = 100
"""Memory of a process that tracks, for each px of a frame: 9.3 GB were taken at 96 megapixels."""
ROWS = 256
"""Rows of pixels that are turned from BGR to RGB at a time."""
MAX_SCANS = 100
"""Progressive JPEGs have some ten."""
MARKER = re.compile(rb"\xff([^\x00\x01\xd0-\xd7\xff])", re.DOTALL)
"""A JPEG's marker before a segment with its length, or its end (ITU-T T.81, B.1.1.3)."""
HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
"""Brands in the file type box (ISO/IEC 23008-12): HEVC pictures, and pictures of any codec."""
OF_CAMERAS = {Tag.Make, Tag.ExposureTime, Tag.FocalLength}
MM_PER_RESOLUTION_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""EXIF FocalPlaneResolutionUnit: inch, cm, mm, um."""


def load_photo(path: str | Path) -> Photo:
    """Load a photo of up to 100 megapixels, 8 or 16 bits, upright, without transparency."""
    file = _photo_input(path)
    with file.naming_errors(), quiet_libraries():
        data = file.load_bytes()
        is_heic = data[4:8] == b"ftyp" and data[8:12] in HEIC_BRANDS
        pixels, focal, is_transparent = (_decode_heic if is_heic else _decode)(file, data)
        if pixels.dtype not in (np.uint8, np.uint16):
            raise file.error(f"pixels of type {pixels.dtype}", "save it with 8 or 16 bits")
        pixels = np.ascontiguousarray(pixels)
        pixels.flags.writeable = False
        sha256 = hashlib.sha256(data).hexdigest()
        pages = 1 if is_heic else _count_pages(data)
    notes = ("Its transparency is left out.",) if is_transparent else ()
    notes += (f"The first of its {pages:,} pictures is used.",) if pages > 1 else ()
    return Photo(pixels, printable(file.path.name), sha256, focal, notes)


def load_alpha(path: str | Path) -> NDArray[np.float32] | None:
    """Opacity (height, width), from 0 to 1, of a picture that ``load_photo`` reads, upright; None
    for one without.
    """
    file = _photo_input(path)
    if file.path.suffix.lower() in HEIC_ENDINGS:
        return None
    with (
        file.naming_errors(), quiet_libraries(), file.open() as stream,
        Image.open(stream, formats=FORMATS) as image,
    ):  # fmt: skip
        if not image.has_transparency_data:
            return None
        upright = ImageOps.exif_transpose(image).convert("RGBA")
        return np.asarray(upright)[..., 3].astype(np.float32) / np.float32(255.0)


def orientation_of(path: str | Path) -> int:
    """EXIF's orientation of a photo, from 1 to 8, in which other tools may not show it."""
    number = _exif_tags(path).get(Tag.Orientation, UPRIGHT)
    return number if number in range(1, 9) else UPRIGHT


@dataclass(frozen=True, slots=True)
class PhotoHeader:
    """Header of a photo."""

    width: int
    height: int
    """Upright, px."""
    orientation: int
    """EXIF's, from 1 to 8."""
    has_colour: bool = True
    """Whether its pixels may differ in more than brightness."""
    bits: int = 8
    """Bits of a pixel's value."""


def load_header(path: str | Path) -> PhotoHeader:
    """Read the header of a photo, and nothing else.

    Raises:
        PhotoFileError: it is not a picture that can be read, or is too large.
    """
    file = _photo_input(path)
    with file.naming_errors(), quiet_libraries(), file.open() as stream:
        if file.path.suffix.lower() in HEIC_ENDINGS:
            photo = load_photo(path)
            return PhotoHeader(photo.width, photo.height, UPRIGHT)
        try:
            with Image.open(stream, formats=FORMATS) as image:
                is_late = image.format == "PNG" and "exif" not in image.info  # getexif decodes it
                size, exif = image.size, Image.Exif() if is_late else image.getexif()
                mode = image.mode
        except UnidentifiedImageError:
            raise file.error("not a picture that can be read", "wanted a whole one") from None
        refuse_size(file, *size)
    orientation = exif.get(Tag.Orientation, UPRIGHT)
    orientation = orientation if orientation in range(1, 9) else UPRIGHT
    width, height = size[::-1] if orientation > 4 else size
    has_colour = mode not in ("1", "L", "LA", "P", "PA") and mode[0] not in "IF"
    return PhotoHeader(width, height, orientation, has_colour, 16 if mode[0] in "IF" else 8)


def was_taken_by_a_camera(path: str | Path) -> bool:
    """Tell whether a picture's EXIF names camera or exposure, or it is HEIC, of cameras alone."""
    is_heic = Path(path).suffix.lower() in HEIC_ENDINGS
    return is_heic or not OF_CAMERAS.isdisjoint(_exif_tags(path))


def _exif_tags(path: str | Path) -> dict[int, Any]:
    """EXIF of a picture by tag; {} for a HEIC photo, or a file that cannot be read."""
    file = _photo_input(path)
    with (
        suppress(PhotoFileError), file.naming_errors(), file.open() as stream,
        quiet_libraries(), Image.open(stream, formats=FORMATS) as image,
    ):  # fmt: skip
        exif = image.getexif()
        return {**exif, **exif.get_ifd(IFD.Exif)}
    return {}


def save_image(path: str | Path, rgb: NDArray, *, is_own: bool = False) -> None:
    """Write a picture (height, width, 3), RGB, in the format of the file's ending."""
    path = Path(path)
    if not cv2.haveImageWriter(f"a{path.suffix}"):
        found = f"pictures cannot be written as {path.suffix!r}"
        raise _photo_input(path).error(found, "use .png or .jpg")
    data = np.asarray(cv2.imencode(path.suffix, np.ascontiguousarray(rgb[..., ::-1]))[1])
    write_whole(path, data.tobytes(), PhotoFileError, is_own=is_own)


def _photo_input(path: str | Path) -> InputFile:
    return InputFile(Path(path), [], PhotoFileError, "photo", MAX_DATA_BYTES)


def _decode(file: InputFile, data: bytes) -> tuple[NDArray, float | None, bool]:
    """Pixels (h, w, 1 or 3), 35-mm focal length, and whether there was transparency."""
    if (scans := _scans(data)) > MAX_SCANS:
        raise file.error(f"a JPEG of {scans:,} scans or more", "save it again")
    raw = file.error("a raw photo", "develop it to JPEG, PNG or TIFF first")
    if file.path.suffix.lower() in RAW_ENDINGS:
        raise raw
    try:
        with Image.open(BytesIO(data), formats=FORMATS) as image:
            tags = getattr(image, "tag_v2", {})
            is_preview = Tag.DNGVersion in tags or tags.get(Tag.NewSubfileType, 0) & REDUCED
            if is_preview or data[8:10] == b"CR":
                raise raw
            refuse_size(file, *image.size)
            focal = focal_35mm(image.getexif(), image.width, image.height)
            is_transparent = image.has_transparency_data
            image.load()  # whether it is whole: OpenCV fills up with grey
            depth = max(tags.get(Tag.BitsPerSample, (data[24] if image.format == "PNG" else 8,)))
            if depth <= 8 and image.mode[0] not in "IF":
                ImageOps.exif_transpose(image, in_place=True)
                if image.mode not in ("L", "RGB"):
                    image = image.convert("L" if image.mode in ("1", "LA") else "RGB")
                return np.atleast_3d(np.asarray(image)), focal, is_transparent
            is_planar = tags.get(Tag.PlanarConfiguration, 1) == IN_PLANES
            if is_planar and tags.get(Tag.SamplesPerPixel, 1) > 1:
                found = "a TIFF of 16 bits that has each colour in a plane of its own"
                raise file.error(found, "save it with interleaved pixels, or as PNG")
            image.close()  # frees its pixels
    except UnidentifiedImageError:
        wanted = "wanted JPEG, PNG, TIFF, WebP or BMP with 8 or 16 bits"
        raise file.error("not a picture that can be read", wanted) from None
    except Image.DecompressionBombError:
        found = f"more than {MAX_MEGAPIXELS:.0f} megapixels"
        raise file.error(found, "make it smaller first") from None
    # OpenCV reads 16 bits of each colour, turns them upright, and leaves transparency out.
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise file.error("OpenCV cannot read this kind of picture", "save it as PNG or JPEG")
    if tags.get(Tag.PhotometricInterpretation, 1) == WHITE_IS_ZERO and picture.dtype == np.uint16:
        np.invert(picture, out=picture)  # which OpenCV leaves out
    if picture.ndim == 2:
        return picture[..., None], focal, is_transparent
    for top in range(0, len(picture), ROWS):  # in place: the whole is up to 0.6 GB
        picture[top : top + ROWS] = picture[top : top + ROWS, :, ::-1]
    return picture, focal, is_transparent


def _count_pages(data: bytes) -> int:
    with suppress(*OF_PAGES), Image.open(BytesIO(data), formats=FORMATS) as image:
        return sum(1 for _ in _pages_of(image)) if image.format == "TIFF" else _page_limit(image)
    return 1


def _page_limit(image: Image.Image) -> int:
    """Count the pictures in a file, with previews and masks."""
    if image.format not in PAGED or not getattr(image, "is_animated", False):
        return 1
    return MAX_PAGES if image.format == "TIFF" else min(getattr(image, "n_frames", 1), MAX_PAGES)


def _pages_of(image: Image.Image) -> Iterator[Image.Image]:
    """Yield a file at each of its pictures in turn, without previews and masks."""
    with suppress(EOFError):
        for number in range(_page_limit(image)):
            image.seek(number)
            if not getattr(image, "tag_v2", {}).get(Tag.NewSubfileType, 0) & NO_PAGE:
                yield image


def count_pages(path: Path) -> int:
    """Count the pictures in a file, without previews and masks; 0: it is no picture."""
    file = _photo_input(path)
    with suppress(PhotoFileError), file.naming_errors(), quiet_libraries():
        return _count_pages(file.load_bytes())
    return 0


def iterate_pages(file: InputFile) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Yield the pictures in a file, upright, RGB of 8 bits, with their times in s; 0: not said."""
    time = 0.0
    with Image.open(BytesIO(file.load_bytes()), formats=FORMATS) as image:
        for page in _pages_of(image):
            refuse_size(file, *page.size)
            upright = ImageOps.exif_transpose(page)
            pixels = np.asarray(upright)
            if pixels.dtype.kind in "iu" and pixels.itemsize > 1:
                upright = Image.fromarray((pixels >> 8).astype(np.uint8))
            yield time, np.asarray(upright.convert("RGB"))
            time += float(page.info.get("duration") or 0.0) / 1000.0


def _scans(data: bytes) -> int:
    """Number of a JPEG's scans, each of which is decoded over the whole picture; 0 for others."""
    at, count = 2, 0
    while data.startswith(b"\xff\xd8") and (marker := MARKER.search(data, at)):
        count += marker[1] == b"\xda"
        if marker[1] == b"\xd9" or count > MAX_SCANS:
            break
        at = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2], "big")
    return count


def refuse_size(file: InputFile, width: int, height: int) -> None:
    """Raise the file's error where a picture of ``width`` x ``height`` px is too large."""
    if width * height > MAX_MEGAPIXELS * 1e6:
        wanted = f"poseviewer takes up to {MAX_MEGAPIXELS:.0f} megapixels, make it smaller first"
        raise file.error(f"{width}x{height} px", wanted)


def frame_bytes(width: int, height: int) -> int:
    """Return the memory, in bytes, that a process which tracks frames of a size takes."""
    return FRAME_BYTES_PER_PX * width * height


def refuse_frames(file: InputFile, width: int, height: int) -> None:
    """Raise the file's error where frames of ``width`` x ``height`` px are too large to track."""
    refuse_size(file, width, height)
    needed, there = frame_bytes(width, height), memory_bytes()
    if needed > there:
        found = f"{width}x{height} px, which take {needed / 1e9:.1f} GB of memory to track"
        raise file.error(
            found, f"this machine has {there / 1e9:.1f}, make the frames smaller first"
        )


def focal_35mm(exif: Image.Exif, width: int, height: int) -> float | None:
    """EXIF's own 35-mm focal length, else from the focal length and the sensor's resolution."""
    try:
        tags = exif.get_ifd(IFD.Exif)
        focal = float(tags.get(Tag.FocalLengthIn35mmFilm, 0))
        if not focal:
            unit = MM_PER_RESOLUTION_UNIT[tags.get(Tag.FocalPlaneResolutionUnit, 2)]
            per_mm = float(tags.get(Tag.FocalPlaneXResolution, 0)) / unit
            # The resolution belongs to the picture as taken; it may have been shrunk since.
            taken = float(tags.get(Tag.ExifImageWidth, 0)) or width
            diagonal = float(np.hypot(taken, taken * height / width)) / per_mm
            focal = float(tags.get(Tag.FocalLength, 0)) * 43.2666 / diagonal
    except (KeyError, TypeError, ValueError, ZeroDivisionError, SyntaxError, OSError):
        return None
    return focal if 1.0 < focal < 10000.0 else None


def _decode_heic(file: InputFile, data: bytes) -> tuple[NDArray, float | None, bool]:
    """Values as of ``_decode``; 16 bits hold pixels of more than 8 in the upper ones."""
    try:
        import pillow_heif
    except ImportError:
        wanted = "pip install 'poseviewer[heic]', or save the photo as JPEG"
        raise file.error("HEIC photos need pillow-heif", wanted) from None
    picture = pillow_heif.open_heif(data, convert_hdr_to_8bit=False)
    width, height = picture.size
    refuse_size(file, width, height)
    pixels, exif = np.array(picture).reshape(height, width, -1), Image.Exif()
    exif.load(picture.info.get("exif") or b"")
    colours = pixels[..., :-1] if picture.has_alpha else pixels
    return colours, focal_35mm(exif, width, height), picture.has_alpha


def load_calibrated_photo(path: str | Path, calibration: Calibration | None = None) -> Photo:
    """The photo in a file; with a calibration, undistorted, and with its camera."""
    photo = load_photo(path)
    if calibration is None:
        return photo
    size = photo.width, photo.height
    chosen, notes = load_calibration(calibration, photo.name, *size, orientation_of(path))
    photo = replace(photo, notes=(*photo.notes, *notes))
    if chosen.lens is None:
        return replace(photo, camera=chosen.camera)
    return undistort_photo(photo, Undistortion.of(chosen.lens, chosen.camera))


def undistort_photo(photo: Photo, undistortion: Undistortion) -> Photo:
    """Undistort a photo as taken.

    Raises:
        PhotoFileError: the result is too large or shows nothing.
    """
    if max(photo.width, photo.height) > MAX_SIDE_PX:
        wanted = f"undistorted up to {MAX_SIDE_PX} px a side, make it smaller first"
        raise PhotoFileError(f"{photo.name}: {photo.width}x{photo.height} px; {wanted}.")
    pixels, covered = undistort(photo.pixels, undistortion)
    if not covered.any():
        wanted = "check the distortion coefficients, and whether they are of the fisheye model"
        raise CalibrationFileError(f"{photo.name}: undistorted it shows nothing; {wanted}.")
    pixels.flags.writeable = covered.flags.writeable = False
    covered = None if covered.all() else covered
    camera = undistortion.camera
    return replace(photo, pixels=pixels, camera=camera, undistortion=undistortion, covered=covered)


def photo_text(photo: Photo) -> str:
    """Name of the photo that numbers belong to, to be written into their file."""
    text = f"Photo: {photo.label}; SHA-256 of its file: {photo.sha256}"
    if photo.undistortion is None:
        return text
    return f"{text}; distortion: {msgspec.json.encode(Distortion.of(photo.undistortion)).decode()}"


def save_photo(path: Path, photo: Photo, *, is_own: bool = False) -> None:
    """Write a photo with as many bits as the format of the file's ending holds; whole or not."""
    pixels = photo.pixels
    if path.suffix.lower() not in (".png", ".tif", ".tiff"):
        pixels = photo.as_rgb8(photo.width, photo.height)
    save_image(path, pixels, is_own=is_own)
