"""Masks as pictures: white counts, black is occluded."""

from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from msgspec import structs
from PIL import Image

from poseviewer.errors import PhotoFileError, PoseFileError
from poseviewer.files.checks import InputFile
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PoseRecord, pose_bytes
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


def mask_paths(pose_file: str | Path) -> tuple[Path, Path]:
    """Paths of a pose file's masks, the user's and that of what was found in front:
    ``car.mask.png`` and ``car.occluders.png`` beside ``car.pose.json``.
    """
    path = Path(pose_file)
    stem = path.name.removesuffix(".json").removesuffix(".pose")
    return path.with_name(f"{stem}.mask.png"), path.with_name(f"{stem}.occluders.png")


def pose_contents(
    path: Path, record: PoseRecord, mask: Mask | None = None, occluders: Mask | None = None
) -> dict[Path, bytes]:
    """Return the files of a pose: its masks, and last the pose file, which names them.

    Args:
        path: the pose file.
        record: its content, without masks.
        mask: the user's.
        occluders: 0 where a search found something in front.
    """
    names = zip(("mask", "occluders"), mask_paths(path), (mask, occluders), strict=True)
    known = [(name, beside, own) for name, beside, own in names if own is not None]
    record = structs.replace(record, **{name: beside.name for name, beside, _ in known})
    return {beside: mask_as_png(own) for _, beside, own in known} | {path: pose_bytes(path, record)}


def save_pose_and_masks(path: str | Path, *content: Any) -> None:
    """Write the files of ``pose_contents``, each whole or not at all."""
    for file, data in pose_contents(Path(path), *content).items():
        is_mask = file != Path(path)
        write_whole(file, data, PhotoFileError if is_mask else PoseFileError, is_own=is_mask)


def masks_beside(
    pose_file: str | Path, record: PoseRecord, size: tuple[int, int]
) -> tuple[Mask | None, Mask | None, tuple[str, ...]]:
    """Load the mask and the occluders that a pose file names; None, and a note, for one that
    cannot be used.
    """
    masks, notes = list[Mask | None](), list[str]()
    for name in (record.mask, record.occluders):
        masks.append(None)
        if name is not None:
            try:
                masks[-1] = load_mask(Path(pose_file).parent / bare_name(name), size)
            except PhotoFileError as error:
                notes.append(f"Nothing of the photo is hidden: {error}")
    return masks[0], masks[1], tuple(notes)
