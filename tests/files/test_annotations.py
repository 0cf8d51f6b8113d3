"""Masks as annotation tools write them: one object is read, several are asked about."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseviewer.errors import PhotoFileError
from poseviewer.files.masks import MaskFile, load_mask
from tests.writing import write

WIDTH, HEIGHT = 64, 48
COUNTS = np.zeros((HEIGHT, WIDTH))
COUNTS[10:20, 30:40] = 1.0
CORNERS = [[30, 10], [40, 10], [40, 20], [30, 20]]
FLAT = [float(x) for corner in CORNERS for x in corner]


def runs() -> list[int]:
    """Run lengths by columns, from those that do not count."""
    flat = COUNTS.T.ravel()
    ends = [0, *(np.flatnonzero(np.diff(flat)) + 1).tolist(), flat.size]
    return np.diff(ends).tolist()


def packed(values: list[int]) -> str:
    """Pack as cocoapi's ``rleToString`` does."""
    text = ""
    for i, value in enumerate(values):
        left, is_more = value - (values[i - 2] if i > 2 else 0), True
        while is_more:
            bits, left = left & 0x1F, left >> 5
            is_more = left != (-1 if bits & 0x10 else 0)
            text += chr(48 + (bits | 0x20 * is_more))
    return text


def coco(segmentation: Any, **more: Any) -> dict[str, Any]:
    images = [{"id": i, "file_name": f"in/{name}.png", "width": WIDTH, "height": HEIGHT}
              for i, name in ((1, "photo"), (2, "other"))]  # fmt: skip
    entry = {"image_id": 1, "category_id": 7, "segmentation": segmentation}
    other = {"image_id": 2, "category_id": 7, "segmentation": [[0.0] * 6]}
    return {"images": images, "annotations": [entry, other]} | more


def labelme(*shapes: dict[str, Any]) -> dict[str, Any]:
    return {"shapes": shapes, "imageWidth": WIDTH, "imageHeight": HEIGHT}


ENTRY = {"label": "block", "points": CORNERS, "shape_type": "polygon"}
KINDS = {
    "polygons": coco([FLAT]),
    "runs": coco({"counts": runs(), "size": [HEIGHT, WIDTH]}),
    "packed runs": coco({"counts": packed(runs()), "size": [HEIGHT, WIDTH]}),
    "labelme": labelme(ENTRY),
    "a rectangle": labelme({**ENTRY, "points": CORNERS[::2], "shape_type": "rectangle"}),
}


@pytest.mark.parametrize("name", KINDS)
def test_the_only_object_of_an_annotation_is_what_counts(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "mask.json", KINDS[name])
    found = load_mask(path, (WIDTH, HEIGHT), "photo.png").weights
    different = np.argwhere(found != COUNTS)  # the border of an outline may count or not
    assert np.all((different >= [9, 29]) & (different <= [20, 40]))
    assert np.array_equal(found[11:19, 31:39], COUNTS[11:19, 31:39])
    assert "runs" not in name or not len(different)


@pytest.mark.parametrize(("content", "words"), [
    (labelme(ENTRY, {**ENTRY, "label": "dog"}),
     r"marks 2 objects in the photo \(block, dog\); wanted one, name it by `MaskFile.label`"),
    (coco([FLAT], annotations=[]), "marks 0 objects"),
    (coco([FLAT], annotations=[{"image_id": 1}] * 3), "marks 3 objects"),
    (coco([FLAT], images=[]), "0 of its 0 images are called photo.png"),
    (coco([FLAT[:4]]), "fewer than 3 corners"),
    (coco({"counts": [5, 6]}), "run lengths of 11 pixels; wanted 3,072"),
    (coco({"counts": "o" * 100_000}), "not a readable mask"),
    (labelme({**ENTRY, "shape_type": "circle"}), "a shape of type 'circle'"),
    (labelme(ENTRY) | {"imageWidth": None}, "how large"),
    (labelme({**ENTRY, "points": [[1, 2], [3]]}), "is a list of 1; wanted"),
    (coco([[float("nan"), *FLAT[1:]]]), "wanted a number"),
    (labelme(ENTRY) | {"imageWidth": 20_000, "imageHeight": 30_000}, "20,000x30,000 px"),
    ({"projection": "perspective"}, "no mask in it"),
])  # fmt: skip
def test_what_is_no_mask_of_one_object_is_said(tmp_path: Path, content: Any, words: str) -> None:
    with pytest.raises(PhotoFileError, match=rf"mask\.json: .*{words}"):
        load_mask(write(tmp_path / "mask.json", content), (WIDTH, HEIGHT), "photo.png")


DOG = {"label": "dog", "points": [[1, 1], [9, 1], [9, 9]]}
CATEGORIES = [{"id": 7, "name": "block"}, {"id": 8, "name": "dog"}]
BLOCK = {"image_id": 1, "category_id": 7, "segmentation": [FLAT]}
OF_SEVERAL = {
    "coco": coco([], categories=CATEGORIES, annotations=[BLOCK, {**BLOCK, "category_id": 8}]),
    "labelme": labelme(DOG, ENTRY, DOG),
}


@pytest.mark.parametrize("name", OF_SEVERAL)
def test_a_label_chooses_an_object(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "mask.json", OF_SEVERAL[name])
    alone = load_mask(write(tmp_path / "alone.json", labelme(ENTRY)), (WIDTH, HEIGHT))
    chosen = load_mask(MaskFile(path, "block"), (WIDTH, HEIGHT), "photo.png")
    assert np.array_equal(chosen.weights, alone.weights)
    with pytest.raises(PhotoFileError, match=r"0 objects called 'cat' in the photo \(block, dog\)"):
        load_mask(MaskFile(path, "cat"), (WIDTH, HEIGHT), "photo.png")


def test_a_label_of_what_has_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PhotoFileError, match="no labels, such as 'dog'"):
        load_mask(MaskFile(tmp_path / "mask.png", "dog"))
