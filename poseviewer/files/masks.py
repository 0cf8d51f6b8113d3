"""Masks as pictures: white counts, black is hidden by something in front. A pose file names its
mask, which lies beside it.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from msgspec import structs

from poseviewer.errors import PhotoFileError
from poseviewer.files.checks import Reading
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import load_photo
from poseviewer.files.pose import PoseRecord, save_pose
from poseviewer.files.writing import write_whole
from poseviewer.geometry.mask import Mask


def load_mask(path: str | Path, width: int, height: int) -> Mask:
    """The mask in a picture, white 1 and black 0."""
    mask = load_photo(path)
    if (mask.width, mask.height) != (width, height):
        found = f"the mask has {mask.width}x{mask.height} px, the photo {width}x{height} px"
        reading = Reading(Path(path), error_type=PhotoFileError)
        raise reading.error(found, "save the mask in the photo's size")
    return Mask.of(np.minimum(mask.grey(), 1.0))  # a sum of colours may end just above it


def mask_as_png(mask: Mask) -> bytes:
    """The picture of a mask, grey: to 16 bits where it is not black and white alone."""
    weights = mask.weights
    top = np.uint8(255) if np.all((weights == 0.0) | (weights == 1.0)) else np.uint16(65535)
    pixels = np.rint(weights.astype(float) * top).astype(top.dtype)
    return np.asarray(cv2.imencode(".png", pixels)[1]).tobytes()


def mask_from_png(data: bytes) -> Mask:
    """The mask that ``mask_as_png`` made a picture of; raises ValueError where it is none."""
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if pixels is None or pixels.ndim != 2:
        raise ValueError("not a grey picture")
    return Mask.of(pixels * np.float32(1.0 / (65535 if pixels.dtype == np.uint16 else 255)))


def mask_path(pose_file: str | Path) -> Path:
    """Path of a pose file's mask: ``car.mask.png`` beside ``car.pose.json``."""
    path = Path(pose_file)
    return path.with_name(path.name.removesuffix(".json").removesuffix(".pose") + ".mask.png")


def save_pose_and_mask(path: str | Path, record: PoseRecord, mask: Mask | None) -> None:
    """Write a pose file, and its mask, where there is one, beside it; each whole or not at all."""
    if mask is not None:
        beside = mask_path(path)
        write_whole(beside, mask_as_png(mask), PhotoFileError)
        record = structs.replace(record, mask=beside.name)
    save_pose(path, record)


def mask_beside(
    pose_file: str | Path, record: PoseRecord, width: int, height: int
) -> tuple[Mask | None, tuple[str, ...]]:
    """The mask that a pose file names; None and a note where it cannot be used."""
    if record.mask is None:
        return None, ()
    try:
        return load_mask(Path(pose_file).parent / bare_name(record.mask), width, height), ()
    except PhotoFileError as error:
        return None, (f"Nothing of the photo is hidden: {error}",)
