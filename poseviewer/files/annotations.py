"""Masks of annotation tools: COCO's outlines and run lengths, Labelme's shapes."""

from collections.abc import Sequence
from typing import Annotated, Any

import cv2
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from poseviewer.errors import list_names
from poseviewer.files.checks import InputFile, Number
from poseviewer.geometry.lens import MAX_SIDE_PX

Two: Any = Annotated[tuple[Number, ...], Meta(min_length=2, max_length=2)]
SHIFT = 4
"""Binary digits of a corner's fraction of a pixel, as OpenCV takes it."""

MAX_PIXELS = 100_000_000
"""Pixels of the largest photos that are read."""
MAX_SHIFT = 60
"""Bits of a run length, of which the largest photo has 27."""


def annotated_pixels(file: InputFile, photo: str, label: str = "") -> NDArray[np.float32]:
    """Return 1 in the pixels (height, width) of the only object that a file marks in a photo.

    Args:
        file: the file.
        photo: name of the photo, without which the file is of one photo.
        label: that of the object (a category's name); "": the file marks only one.

    Raises:
        PoseViewerError: it marks none, or several, or is of neither tool.
    """
    data = file.load_object()
    if isinstance(data.get("annotations"), list):
        return _of_coco(file, data, photo, label)
    if isinstance(data.get("shapes"), list):
        return _of_labelme(file, data, label)
    wanted = "wanted COCO's annotations, Labelme's shapes, or a picture, white where pixels count"
    raise file.error("no mask in it", wanted)


def _of_coco(file: InputFile, data: dict[str, Any], photo: str, label: str) -> NDArray[np.float32]:
    images = file.decode(data.get("images", []), list[dict[str, Any]], "images")
    named = [one for one in images if str(one.get("file_name")).rpartition("/")[2] == photo]
    image = (named or images)[0] if len(named or images) == 1 else None
    if image is None:
        found = f"{len(named)} of its {len(images)} images are called {photo or 'as the photo'}"
        raise file.error(found, "wanted one, name it as the photo")
    entries = file.decode(data["annotations"], list[dict[str, Any]], "annotations")
    own = [one for one in entries if one.get("image_id") == image.get("id")]
    kinds = file.decode(data.get("categories", []), list[dict[str, Any]], "categories")
    names = {str(kind.get("id")): kind.get("name") for kind in kinds}
    ids = [str(one.get("category_id")) for one in own]
    (only,) = _only_one(file, own, [str(names.get(own, own)) for own in ids], label)
    size = _size(file, image.get("width"), image.get("height"))
    said = only.get("segmentation")
    if isinstance(said, dict):
        return _of_runs(file, said, size)
    return _filled(file, said, size)


def _of_labelme(file: InputFile, data: dict[str, Any], label: str) -> NDArray[np.float32]:
    shapes = file.decode(data["shapes"], list[dict[str, Any]], "shapes")
    labels = [str(one.get("label")) for one in shapes]
    size = _size(file, data.get("imageWidth"), data.get("imageHeight"))
    outlines = []
    for shape in _only_one(file, shapes, labels, label, may_have_parts=True):
        kind = shape.get("shape_type", "polygon")
        corners = np.array(file.decode(shape.get("points"), list[Two], "points"))
        if kind == "rectangle" and len(corners) == 2:
            (left, top), (right, bottom) = corners
            corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        elif kind != "polygon":
            raise file.error(f"a shape of type {str(kind)[:20]!r}", "wanted polygons or rectangles")
        outlines.append(corners.ravel().tolist())
    return _filled(file, outlines, size)


def _only_one(
    file: InputFile,
    entries: list[dict[str, Any]],
    labels: list[str],
    label: str,
    may_have_parts: bool = False,
) -> list[dict[str, Any]]:
    named = [(one, own) for one, own in zip(entries, labels, strict=True) if label in ("", own)]
    kinds = sorted(set(labels))
    count = len({own for _, own in named}) if may_have_parts else len(named)
    if count != 1:
        called = f" called {label!r}" if label else ""
        found = f"it marks {count} objects{called} in the photo" + (
            f" ({list_names(kinds)})" * bool(kinds)
        )
        name = "name it by `MaskFile.label`" if len(kinds) > 1 else "leave the others out of a copy"
        raise file.error(found, f"wanted one, {name}")
    return [one for one, _ in named]


def _size(file: InputFile, width: Any, height: Any) -> tuple[int, int]:
    sides = [file.size(side, "the picture's size") or 0 for side in (width, height)]
    if not all(0 < side <= MAX_SIDE_PX for side in sides):
        raise file.error("it does not say how large the photo is", "wanted its width and height")
    if sides[0] * sides[1] > MAX_PIXELS:
        found = f"it is for a photo of {sides[0]:,}x{sides[1]:,} px"
        raise file.error(found, f"poseviewer takes up to {MAX_PIXELS:,} pixels")
    return sides[0], sides[1]


def _filled(file: InputFile, outlines: Any, size: tuple[int, int]) -> NDArray[np.float32]:
    """Fill outlines, whose corners count from the picture's corner."""
    rows = file.decode(outlines, list[list[Number]], "the outline")
    if not rows or any(len(row) < 6 or len(row) % 2 for row in rows):
        raise file.error("an outline of fewer than 3 corners", "wanted x and y of each corner")
    mask, most = np.zeros(size[::-1], np.uint8), 2.0 * MAX_SIDE_PX
    for row in rows:
        corners = np.clip(np.reshape(row, (-1, 2)) - 0.5, -most, most) * 2**SHIFT
        cv2.fillPoly(mask, [np.rint(corners).astype(np.int32)], 1, shift=SHIFT)
    return mask.astype(np.float32)


def _of_runs(file: InputFile, said: dict[str, Any], size: tuple[int, int]) -> NDArray[np.float32]:
    """Read COCO's run lengths, of pixels by columns, that begin with those that do not count."""
    counts, (width, height) = said.get("counts"), size
    with file.naming_errors():
        runs = _unpacked(counts) if isinstance(counts, str) else file.flat_numbers(counts, "counts")
    if sum(runs) != width * height or min(runs, default=-1.0) < 0.0:
        found = f"run lengths of {sum(runs):g} pixels"
        raise file.error(found, f"wanted {width * height:,}, those of the photo")
    values = np.repeat(np.arange(len(runs)) % 2, np.array(runs, np.int64))
    return values.reshape(width, height).T.astype(np.float32)


def _unpacked(text: str) -> Sequence[float]:
    """Run lengths of pycocotools' text: 5 bits a letter, from the third on a difference."""
    runs, at = list[int](), 0
    while at < len(text):
        value, shift, is_more = 0, 0, True
        while is_more and at < len(text):
            bits = ord(text[at]) - 48
            value |= (bits & 0x1F) << shift
            if shift > MAX_SHIFT:
                raise ValueError("a run length of too many letters")
            is_more, at, shift = bool(bits & 0x20), at + 1, shift + 5
            if not is_more and bits & 0x10:
                value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
    return runs
