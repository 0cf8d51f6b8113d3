"""Pictures of objects at their poses for data sets, with BOP's names and folders."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from poseviewer.errors import PoseFileError
from poseviewer.files.formats.bop import INFO, POSES, image_number, load_scene_file, scene_text
from poseviewer.files.formats.conversion import ConvertOptions, metres_per_unit
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.fit.visibility import depth_image, visibility_of_depths
from poseviewer.geometry.arrays import FloatArray
from poseviewer.geometry.camera import Perspective
from poseviewer.geometry.lens import opencv_matrix
from poseviewer.render.software.software_renderer import SoftwareRenderer
from poseviewer.scene.types import PlacedModel, Scene

NO_BOX = [-1, -1, -1, -1]
"""BOP's box of an invisible object."""
MAX_UINT16 = 65535
"""Largest value of a 16-bit picture."""


def object_coordinates(model: PlacedModel, depth: NDArray[np.float32]) -> FloatArray:
    """Compute normalised object coordinates (NOCS, Wang et al. 2019) from depth (height, width).

    Returns:
        (height, width, 3): 0.5 in the middle of the model's bounding box, whose diagonal has length
        1; 0 where the depth is not finite.
    """
    pose, (height, width) = model.pose, depth.shape
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    known = np.where(np.isfinite(depth), depth, np.nan).astype(float)
    points = pose.camera_from_model.inverse().apply(pose.camera.points_at(pixels, known))
    return np.nan_to_num((points - model.mesh.centre) / model.mesh.diameter + 0.5)


def pictures_of_objects(
    scene: Scene, first: int = 0, masks_alone: bool = False
) -> dict[str, bytes]:
    """Make the pictures of a scene, as the BOP toolkit does.

    Args:
        scene: scene whose objects have poses.
        first: number i of the first image.
        masks_alone: whether to make masks and ``scene_gt_info.json`` only.

    Returns:
        Content of each file by its name. Object j of image i has the PNG pictures ``mask/i_j``
        (alone), ``mask_visib/i_j`` (not occluded), ``normal/i_j`` (camera axes, -1 to 1 in 16
        bits) and ``nocs/i_j``. ``depth/i`` is in steps of ``depth_scale`` mm, or of the models'
        unit if that is unknown; ``scene_camera.json`` has this scale.
    """
    contents = dict[str, bytes]()
    cameras = {}
    infos = {}
    unit = next((item.model.unit for item in scene.objects if item.model.unit), None)
    mm = 1.0 if unit is None else 1000.0 * metres_per_unit(unit)
    for view_index, view in enumerate(scene.views):
        number = first + view_index
        models = [scene.model_at(index, view_index) for index in range(len(scene.objects))]
        depths = [depth_image(model) for model in models]
        shown = visibility_of_depths(depths)
        for object_index, (model, depth) in enumerate(zip(models, depths, strict=True)):
            visible = shown.mask(object_index)
            masks = {"mask": shown.silhouettes[object_index], "mask_visib": visible}
            infos.setdefault(str(number), []).append(_info(model, *masks.values()))
            pictures = {kind: np.where(m, 255, 0).astype(np.uint8) for kind, m in masks.items()}
            if not masks_alone:
                normals = SoftwareRenderer(model.mesh).render(model.pose).normals
                maps = {"normal": 0.5 * (normals + 1.0), "nocs": object_coordinates(model, depth)}
                pictures |= {kind: _in_16_bits(m, masks["mask"]) for kind, m in maps.items()}
            for kind, picture in pictures.items():
                contents[f"{kind}/{number:06d}_{object_index:06d}.png"] = _png(picture)
        if masks_alone:
            continue
        nearest = mm * np.minimum.reduce(depths).astype(float)
        nearest[~np.isfinite(nearest)] = 0.0
        step = 10.0 ** math.ceil(math.log10(max(nearest.max(), 1e-9) / MAX_UINT16))
        contents[f"depth/{number:06d}.png"] = _png(np.rint(nearest / step).astype(np.uint16))
        cameras[str(number)] = {"depth_scale": step}
        if isinstance(view.camera, Perspective):
            cameras[str(number)]["cam_K"] = opencv_matrix(view.camera).ravel().tolist()
    contents[INFO] = scene_text(infos).encode()
    if cameras:
        contents["scene_camera.json"] = json.dumps(cameras, indent=2).encode() + b"\n"
    return contents


def _info(
    model: PlacedModel, silhouette: NDArray[np.bool_], visible: NDArray[np.bool_]
) -> dict[str, Any]:
    """Entry of an object in ``scene_gt_info.json``."""
    whole = silhouette
    height, width = silhouette.shape
    top, left = 0, 0
    if not whole.any() or whole[[0, -1]].any() or whole[:, [0, -1]].any():
        top, left = height, width  # look a photo's side beyond the photo
        camera = model.pose.camera.crop(-left, -top, (3 * width, 3 * height))
        whole = np.isfinite(depth_image(replace(model, pose=replace(model.pose, camera=camera))))
    counts = {"all": whole, "valid": silhouette, "visib": visible}
    counts = {f"px_count_{name}": int(np.count_nonzero(mask)) for name, mask in counts.items()}
    count = counts["px_count_visib"]
    return {
        **counts,
        "visib_fract": count / counts["px_count_all"] if count else 0.0,
        "bbox_obj": _box(whole, top, left) if count else NO_BOX,
        "bbox_visib": _box(visible) if count else NO_BOX,
    }


def _box(mask: NDArray[np.bool_], top: int = 0, left: int = 0) -> list[int]:
    """BOP's box of a mask, px: left, top, and the differences to the right and to the bottom."""
    y, x = np.nonzero(mask)
    return [int(x.min()) - left, int(y.min()) - top, int(np.ptp(x)), int(np.ptp(y))]


def save_pictures(folder: Path, pictures: Mapping[str, bytes], overwrite: bool) -> None:
    """Write all pictures into a folder; none if one exists that must not be overwritten."""
    for name in pictures:
        if (folder / name).exists() and not overwrite:
            found = "is there already and was not touched"
            raise PoseFileError(f"{folder / name}: {found}; name another folder, or overwrite it.")
    for name, data in pictures.items():
        make_folder((folder / name).parent)
        write_whole(folder / name, data, PoseFileError)


def write_masks(
    scene: Scene,
    out: Path,
    options: ConvertOptions,
    tell: Callable[[int, int], object] = lambda *_: None,
) -> list[str]:
    """Write masks and ``scene_gt_info.json`` of a BOP scene; return notes on those left out.

    Args:
        scene: as it was written.
        out: folder of the BOP scene.
        options: as it was written with.
        tell: is given the number of the image that is drawn, and that of all.
    """
    if not all(item.model.location.is_file() for item in scene.objects):
        return [f"{INFO} and masks are not written: a model is not there; add `model`."]
    infos = load_scene_file(out / INFO)
    poses = load_scene_file(out / POSES)
    notes = []
    for view_index, view in enumerate(scene.views):
        tell(view_index + 1, len(scene.views))
        number = image_number(scene, options, view_index)
        pictures = pictures_of_objects(replace(scene, views=(view,)), number, masks_alone=True)
        new = json.loads(pictures.pop(INFO))
        is_there = str(number) in infos or any((out / name).exists() for name in pictures)
        if len(poses[str(number)]) != len(scene.objects):
            notes.append(f"Image {number} has other objects: {INFO} and masks stay as they are.")
        elif is_there and not (options.overwrite or len(scene.objects) > 1):
            notes.append(
                f"{INFO} and masks of image {number} are there; replace them with `overwrite`."
            )
        else:
            infos |= new
            save_pictures(out, pictures, overwrite=True)
    save_pictures(out, {INFO: scene_text(infos).encode()}, overwrite=True)
    return notes


def _in_16_bits(values: NDArray, mask: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Values in [0, 1] as a picture that is black beside the mask."""
    levels = np.rint(MAX_UINT16 * np.clip(values, 0.0, 1.0))
    return np.where(mask[..., None], levels, 0).astype(np.uint16)


def _png(picture: NDArray) -> bytes:
    rows = picture if picture.ndim == 2 else picture[..., ::-1]
    return cv2.imencode(".png", np.ascontiguousarray(rows))[1].tobytes()
