"""What an image shows of placed models, as BOP annotates it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from poseviewer.files.formats.bop import load_scene_file
from poseviewer.files.formats.bop_masks import (
    COCO,
    INFO,
    Annotation,
    box_of,
    save_annotation_files,
    save_masks,
)
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.scene import SceneRecord
from poseviewer.fit.registration import PlacedModel
from poseviewer.fit.visibility import depth_image, visibility_of_depths
from poseviewer.geometry.camera import Perspective, Pose


def annotate(models: Sequence[PlacedModel]) -> list[Annotation]:
    """One for each of the models, by one perspective camera. As in BOP, whole silhouettes are
    counted in a picture of three times the size about the image.
    """
    found, depths = [], []
    for model in models:
        camera = model.pose.camera
        assert isinstance(camera, Perspective)  # BOP has no other
        width, height = camera.width, camera.height
        around = camera.cropped(-width, -height, 3 * width, 3 * height)
        wide = replace(model, pose=Pose(around, model.pose.camera_from_model))
        depths.append(depth_image(model))
        whole = np.isfinite(depth_image(wide))
        left, top, *size = box_of(whole)
        box = [left - width, top - height, *size] if whole.any() else [left, top, *size]
        found.append((int(whole.sum()), box))
    seen = visibility_of_depths(depths)
    return [
        Annotation(drawn, seen.seen(index), pixels, box)
        for index, (drawn, (pixels, box)) in enumerate(zip(seen.drawn, found, strict=True))
    ]


def save_image_annotations(folder: Path, image: int, scene: SceneRecord) -> tuple[Path, ...]:
    """Write masks and annotations of a scene's objects as those of an image that is in the folder
    of a BOP scene; returns the files of the annotations, which other images share.
    """
    meshes = {path: load_mesh(path) for path in {one.model for one in scene.objects}}
    placed = [PlacedModel(meshes[one.model], one.record.pose) for one in scene.objects]
    known = {int(name): infos for name, infos in load_scene_file(folder / INFO).items()}
    known[image] = save_masks(folder, image, annotate(placed))
    save_annotation_files(folder, known)
    return folder / INFO, folder / COCO
