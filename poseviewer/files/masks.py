"""Masks as pictures: white counts, black is occluded."""

from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from msgspec import structs
from PIL import Image

from poseviewer.errors import PhotoFileError
from poseviewer.files.checks import InputFile
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.files.writing import write_whole
from poseviewer.geometry.mask import Mask

INLINE = "data:image/png;base64,"
"""Start of a mask that stands in a scene's file itself."""


def load_mask(path: str | Path, size: tuple[int, int] | None = None) -> Mask:
    """Load the mask in a picture, or in a text of ``mask_text``, of ``size`` (width, height)."""
    is_inline = str(path).startswith(INLINE)
    file = InputFile(Path("a mask" if is_inline else path), [], PhotoFileError, "mask")
    if is_inline:
        with file.naming_errors():
            data = b64decode(str(path)[len(INLINE) :], validate=True)
            pixels = np.asarray(Image.open(BytesIO(data), formats=("PNG",)))
            weights = pixels * np.float32(1.0 / np.iinfo(pixels.dtype).max)
    else:
        weights = np.minimum(load_photo(path).grey(), 1.0)  # a sum of colours may end just above it
    height, width = weights.shape
    if size not in (None, (width, height)):
        found = f"the mask has {width}x{height} px, the photo {size[0]}x{size[1]} px"
        raise file.error(found, "save the mask in the photo's size")
    return Mask.of(weights)


def mask_text(mask: Mask | None) -> str | None:
    """Encode a mask as a picture in text."""
    return None if mask is None else INLINE + b64encode(mask_as_png(mask)).decode()


def mask_as_png(mask: Mask) -> bytes:
    """The picture of a mask, grey: to 16 bits where it is not black and white alone."""
    weights = mask.weights
    top = np.uint8(255) if np.all((weights == 0.0) | (weights == 1.0)) else np.uint16(65535)
    pixels = np.rint(weights.astype(float) * top).astype(top.dtype)
    return np.asarray(cv2.imencode(".png", pixels)[1]).tobytes()


def mask_path(pose_file: str | Path) -> Path:
    """Path of a pose file's mask: ``car.mask.png`` beside ``car.pose.json``."""
    path = Path(pose_file)
    return path.with_name(path.name.removesuffix(".json").removesuffix(".pose") + ".mask.png")


def save_pose_and_mask(path: str | Path, record: PoseRecord, mask: Mask | None) -> None:
    """Write a pose file and, beside it, its mask; each whole or not at all."""
    if mask is not None:
        beside = mask_path(path)
        write_whole(beside, mask_as_png(mask), PhotoFileError, is_own=True)
        record = structs.replace(record, mask=beside.name)
    save_pose(path, record)


def mask_beside(
    pose_file: str | Path, record: PoseRecord, size: tuple[int, int]
) -> tuple[Mask | None, tuple[str, ...]]:
    """Load the mask that a pose file names, or None and a note where it cannot be used."""
    if record.mask is None:
        return None, ()
    try:
        return load_mask(Path(pose_file).parent / bare_name(record.mask), size), ()
    except PhotoFileError as error:
        return None, (f"Nothing of the photo is hidden: {error}",)
