"""Maps of objects for data sets: masks, depth, normals and coordinates, in the folders of BOP."""

import json
import math
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.conversion import metres_per_unit
from poseviewer.files.mesh.load import load_mesh
from poseviewer.files.scene_json import SceneRecord
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.fit.visibility import depth_image, visibility_of_depths
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.types import PlacedModel

MAX_LEVEL = 65535
"""Largest value of 16 bits."""


def model_coordinates(model: PlacedModel, depth: NDArray[np.float32]) -> FloatArray:
    """Return (height, width, 3): the point of the model, in its frame, that each pixel shows.

    It is NaN where ``depth`` (height, width) is not finite.
    """
    pose, (height, width) = model.pose, depth.shape
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    known = np.where(np.isfinite(depth), depth, np.nan).astype(float)
    return pose.camera_from_model.inverse().apply(pose.camera.points_at(pixels, known))


def object_coordinates(model: PlacedModel, depth: NDArray[np.float32]) -> FloatArray:
    """Return (height, width, 3): normalised object coordinates (NOCS, Wang et al. 2019).

    They are 0.5 in the middle of the model's box, whose diagonal has length 1, and 0 beside it.
    """
    points = (model_coordinates(model, depth) - model.mesh.centre) / model.mesh.diameter + 0.5
    return np.nan_to_num(points)


def pictures_of_objects(
    scene: SceneRecord, first: int = 0, masks_alone: bool = False
) -> dict[str, bytes]:
    """Draw PNG pictures, and ``scene_camera.json``, by their names in a folder.

    They are, of image i (the first is ``first``) and object j: ``mask/i_j`` of the object alone,
    ``mask_visib/i_j`` where others do not occlude it, ``normal/i_j`` (camera axes, -1 to 1 in 16
    bits) and ``nocs/i_j``; and ``depth/i`` of all, in steps of ``depth_scale`` mm, or of the
    models' unit where that is not known.
    """
    contents, cameras = dict[str, bytes](), {}
    meshes = {item.path: load_mesh(item.path) for item in scene.objects}
    unit = next((item.model.unit for item in scene.objects if item.model.unit), None)
    mm = 1.0 if unit is None else 1000.0 * metres_per_unit(unit)
    for image, view in enumerate(scene.views, first):
        models = [
            PlacedModel(meshes[item.path].without(item.without), scene.pose(index, image - first))
            for index, item in enumerate(scene.objects)
        ]
        depths = [depth_image(model) for model in models]
        shown = visibility_of_depths(depths)
        for object_index, (model, depth) in enumerate(zip(models, depths, strict=True)):
            masks = {"mask": shown.drawn[object_index], "mask_visib": shown.seen(object_index)}
            pictures = {kind: np.where(m, 255, 0).astype(np.uint8) for kind, m in masks.items()}
            if not masks_alone:
                normals = SoftwareRenderer(model.mesh).render(model.pose).normals
                maps = {"normal": 0.5 * (normals + 1.0), "nocs": object_coordinates(model, depth)}
                pictures |= {kind: _in_16_bits(m, masks["mask"]) for kind, m in maps.items()}
            for kind, picture in pictures.items():
                contents[f"{kind}/{image:06d}_{object_index:06d}.png"] = _png(picture)
        if masks_alone:
            continue
        nearest = mm * np.minimum.reduce(depths).astype(float)
        nearest[~np.isfinite(nearest)] = 0.0
        step = 10.0 ** math.ceil(math.log10(max(nearest.max(), 1e-9) / MAX_LEVEL))
        contents[f"depth/{image:06d}.png"] = _png(np.rint(nearest / step).astype(np.uint16))
        cameras[str(image)] = {"depth_scale": step}
        if isinstance(view.camera, Perspective):
            cameras[str(image)]["cam_K"] = opencv_matrix(view.camera).ravel().tolist()
    if cameras:
        contents["scene_camera.json"] = json.dumps(cameras, indent=2).encode() + b"\n"
    return contents


def save_pictures(folder: Path, pictures: Mapping[str, bytes], overwrite: bool) -> None:
    """Write all pictures into a folder, or none where one is there already.

    Raises:
        PoseFileError: a picture is there and ``overwrite`` is False, or cannot be written.
    """
    for name in pictures:
        if (folder / name).exists() and not overwrite:
            found = "is there already and was not touched"
            raise PoseFileError(
                f"{folder / name}: {found}; name another folder, or add --overwrite."
            )
    for name, data in pictures.items():
        make_folder((folder / name).parent)
        write_whole(folder / name, data, PoseFileError)


def _in_16_bits(values: NDArray, drawn: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Encode values in [0, 1] as a picture that is black where nothing is ``drawn``."""
    levels = np.rint(MAX_LEVEL * np.clip(values, 0.0, 1.0))
    return np.where(drawn[..., None], levels, 0).astype(np.uint16)


def _png(picture: NDArray) -> bytes:
    rows = picture if picture.ndim == 2 else picture[..., ::-1]
    return cv2.imencode(".png", np.ascontiguousarray(rows))[1].tobytes()
