"""What the images of a BOP scene show of each object: ``mask/``, ``mask_visib/``,
``scene_gt_info.json`` and ``scene_gt_coco.json``, as the BOP toolkit makes them.

Masks are called by image and by the object's place in the image's list in ``scene_gt.json``. Boxes
are left, top, width, height in px; ``px_count_valid`` is that of all pixels, since there are no
depth images. The COCO annotations are of what is visible; ``ignore`` marks what is hardly so.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.bop import load_bop_images, scene_text
from poseviewer.files.writing import make_folder, write_whole

MASKS, VISIBLE_MASKS = "mask", "mask_visib"
INFO, COCO = "scene_gt_info.json", "scene_gt_coco.json"
LEAST_VISIBLE = 0.1
"""Share below which BOP leaves an object out of its scores."""
NO_BOX = [-1, -1, -1, -1]
"""BOP's box of nothing."""

Info = dict[str, Any]
"""An object's entry in ``scene_gt_info.json``."""


@dataclass(frozen=True, slots=True, eq=False)
class Annotation:
    """What an image shows of one object."""

    silhouette: NDArray[np.bool_]
    """(height, width): where it would be seen if it were alone."""
    visible: NDArray[np.bool_]
    """(height, width): where it is seen."""
    whole_pixels: int
    """Of the silhouette, also beyond the image."""
    whole_box: list[int]
    """The same of its box."""

    def as_info(self) -> Info:
        """As ``scene_gt_info.json`` has it."""
        visible, inside = int(self.visible.sum()), int(self.silhouette.sum())
        return {
            "bbox_obj": self.whole_box,
            "bbox_visib": box_of(self.visible),
            "px_count_all": self.whole_pixels,
            "px_count_valid": inside,
            "px_count_visib": visible,
            "visib_fract": visible / self.whole_pixels if self.whole_pixels else 0.0,
        }


def box_of(mask: NDArray[np.bool_]) -> list[int]:
    """Left, top, width, height of the pixels of a mask (height, width); ``NO_BOX`` without any."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return list(NO_BOX)
    left, top = int(columns[0]), int(rows[0])
    return [left, top, int(columns[-1]) + 1 - left, int(rows[-1]) + 1 - top]


def save_masks(folder: Path, image: int, annotations: Sequence[Annotation]) -> list[Info]:
    """Write the masks of an image's objects; returns their entries in ``scene_gt_info.json``.

    Raises:
        PoseFileError: the folder cannot be written to.
    """
    for name in (MASKS, VISIBLE_MASKS):
        make_folder(folder / name)
        for number, annotation in enumerate(annotations):
            mask = annotation.silhouette if name == MASKS else annotation.visible
            data = np.asarray(cv2.imencode(".png", 255 * mask.astype(np.uint8))[1]).tobytes()
            write_whole(mask_file(folder / name, image, number), data, PoseFileError)
    return [annotation.as_info() for annotation in annotations]


def mask_file(folder: Path, image: int, number: int) -> Path:
    """Where the mask of an image's object lies in ``mask/`` or ``mask_visib/``."""
    return folder / f"{image:06d}_{number:06d}.png"


def save_annotation_files(folder: Path, infos: Mapping[int, Sequence[Info]]) -> None:
    """Write ``scene_gt_info.json`` and ``scene_gt_coco.json`` into a scene's folder, for the images
    whose masks are written: by their numbers their objects' entries.

    Raises:
        PoseFileError: the folder cannot be written to, or a mask is gone.
    """
    entries = {str(image): list(found) for image, found in infos.items()}
    write_whole(folder / INFO, scene_text(entries), PoseFileError)
    images = {image.number: image for image in load_bop_images(folder).images}
    ids = {image: [one.object_id for one in images[image].objects] for image in infos}
    photos = {image: images[image].photo for image in infos}
    text = json.dumps(_coco(folder, infos, ids, photos))
    write_whole(folder / COCO, (text + "\n").encode(), PoseFileError)


def _coco(
    folder: Path,
    infos: Mapping[int, Sequence[Info]],
    object_ids: Mapping[int, Sequence[int]],
    photos: Mapping[int, str],
) -> dict[str, Any]:
    images, annotations = [], []
    for image in sorted(infos):
        size: tuple[int, int] = (0, 0)
        for number, info in enumerate(infos[image]):
            path = mask_file(folder / VISIBLE_MASKS, image, number)
            mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            if mask is None:
                raise PoseFileError(f"{path}: no such mask; write the masks again.")
            size = mask.shape[1], mask.shape[0]
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": image,
                    "category_id": object_ids[image][number],
                    "iscrowd": 0,
                    "area": info["px_count_visib"],
                    "bbox": info["bbox_visib"],
                    "segmentation": run_lengths(mask > 0),
                    "width": size[0],
                    "height": size[1],
                    "ignore": info["visib_fract"] < LEAST_VISIBLE,
                }
            )
        file = {"id": image, "file_name": photos[image], "width": size[0], "height": size[1]}
        images.append(file)
    known = sorted({number for found in object_ids.values() for number in found})
    return {
        "info": {"description": "poses found by poseviewer"},
        "categories": [{"id": number, "name": str(number)} for number in known],
        "images": images,
        "annotations": annotations,
    }


def run_lengths(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """COCO's uncompressed run-length encoding: lengths of runs down the columns, of 0 first."""
    values = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(values)) + 1
    edges = np.concatenate([[0], changes, [len(values)]])
    counts = np.diff(edges).tolist()
    return {"counts": [0, *counts] if values[:1].any() else counts, "size": list(mask.shape)}
