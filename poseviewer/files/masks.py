"""Masks as pictures: white counts, black is occluded."""

from base64 import b64decode, b64encode
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from msgspec import structs
from numpy.typing import NDArray
from PIL import Image

from poseviewer.errors import PhotoFileError, PoseFileError
from poseviewer.files.annotations import annotated_pixels
from poseviewer.files.checks import InputFile, quiet_libraries
from poseviewer.files.mesh.named import bare_name
from poseviewer.files.photo import load_alpha, load_photo
from poseviewer.files.pose import PoseRecord, pose_bytes
from poseviewer.files.writing import write_whole
from poseviewer.geometry.mask import Mask

INLINE = "data:image/png;base64,"
"""Start of a mask that stands in a scene's file itself."""


@dataclass(frozen=True, slots=True)
class MaskFile:
    """A file of a mask, and what the user says of it."""

    path: Path
    label: str = ""
    """Label of the object in an annotation of several; "": of the only one."""


def load_mask(
    named: str | Path | MaskFile, size: tuple[int, int] | None = None, photo: str = ""
) -> Mask:
    """Load a mask: a picture, its transparency where that varies; an array; an annotation; or a
    text of ``mask_text``.

    Args:
        named: the file, or the text.
        size: width and height that it has to have, px.
        photo: name of the photo, which an annotation may be of.
    """
    path, label = (named.path, named.label) if isinstance(named, MaskFile) else (named, "")
    is_inline = str(path).startswith(INLINE)
    file = InputFile(Path("a mask" if is_inline else path), [], PhotoFileError, "mask")
    if is_inline:
        with file.naming_errors():
            data = b64decode(str(path)[len(INLINE) :], validate=True)
            pixels = np.asarray(Image.open(BytesIO(data), formats=("PNG",)))
            weights = pixels * np.float32(1.0 / np.iinfo(pixels.dtype).max)
    elif file.path.suffix.lower() == ".json":
        weights = annotated_pixels(file, photo, label)
    elif label:
        wanted = "wanted an annotation (COCO, Labelme), or leave the label out"
        raise file.error(f"it has no labels, such as {label!r}", wanted)
    elif file.path.suffix.lower() == ".npy":
        weights = _of_array(file)
    else:
        weights = _of_picture(file)
    height, width = weights.shape
    if size not in (None, (width, height)):
        found = f"the mask has {width}x{height} px, the photo {size[0]}x{size[1]} px"
        raise file.error(found, "save the mask in the photo's size")
    return Mask.of(weights)


def mask_note(mask: Mask, name: str) -> str:
    """Say that a mask hides nothing, or everything; "": it hides a part."""
    low, high = float(mask.weights.min()), float(mask.weights.max())
    if high == 0.0:
        return f"{name}: the mask hides the whole photo; white is what counts."
    return f"{name}: the mask hides nothing." if low == high else ""


def _of_picture(file: InputFile) -> NDArray[np.float32]:
    photo = load_photo(file.path)
    weights = np.minimum(photo.grey(), 1.0)  # a sum of colours may end just above it
    alpha = load_alpha(file.path)
    if alpha is not None and np.ptp(alpha) > 0.0:
        if not np.any(weights[alpha == alpha.max()]):
            found = "black where it is opaque, and transparent elsewhere"
            raise file.error(found, "save it in black and white without transparency")
        return alpha
    values = np.unique(weights)
    is_of_two = len(values) == 2 and values[0] == 0.0  # such as 0 and 1 of 255
    return (weights > 0.0).astype(np.float32) if is_of_two else weights


def _of_array(file: InputFile) -> NDArray[np.float32]:
    with file.naming_errors(), quiet_libraries():
        file.check_size()
        # Mapped, so that a head which says more than there is takes no memory.
        values = np.squeeze(np.load(file.path, mmap_mode="r", allow_pickle=False))
    if values.ndim != 2 or values.dtype.kind not in "biuf":
        found = f"an array of shape {values.shape} and type {values.dtype}"
        raise file.error(found, "wanted a number for each pixel (height, width)")
    top = 1.0
    if not np.all((values >= 0) & (values <= 1)):  # or it holds what is no number
        top = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 255.0
        if not np.all((values >= 0) & (values <= top)):
            found = "an array of numbers below 0 or above 255, or of none"
            raise file.error(found, "wanted them from 0 to 1, or to 255")
    return values.astype(np.float32) / np.float32(top)


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
