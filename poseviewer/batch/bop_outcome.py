"""The poses of a batch on a BOP scene, as the BOP scene that they make."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from poseviewer.batch.manifest import Manifest
from poseviewer.batch.results import JobResult
from poseviewer.errors import BatchError
from poseviewer.files.formats.bop_images import (
    CAMERAS,
    BopObject,
    load_bop_images,
    same_intrinsics,
    save_bop_images,
)
from poseviewer.files.formats.bop_scene import MODEL_NAME, PHOTO_NAME, load_scene_file
from poseviewer.files.pose.file import PoseRecord, load_pose
from poseviewer.geometry.camera import Camera, Perspective


def save_scene(folder: Path, manifest: Manifest, results: Sequence[JobResult]) -> None:
    """Write ``scene_gt.json`` and ``scene_camera.json`` into the folder of results; nothing where
    the rows are not from a scene.

    The poses are those of all rows that have one, mm, in the order of the rows. The cameras are
    the scene's own, as its file has them.

    Raises:
        PoseViewerError: the scene is gone, or the files cannot be written.
    """
    if manifest.scene is None:
        return
    poses: dict[int, list[BopObject]] = defaultdict(list)
    for result in sorted(results, key=lambda result: result.row):
        if result.pose:
            found = BopObject(_object_of(result), _record(folder, result).pose.camera_from_model)
            poses[image_of(result.photo)].append(found)
    save_bop_images(folder, load_scene_file(Path(manifest.scene) / CAMERAS), dict(poses))


def require_scene_camera(manifest: Manifest, photo: str, camera: Camera) -> None:
    """Refuse a pose that is by another camera than the scene's, which BOP could not say.

    Raises:
        BatchError: it is.
    """
    if manifest.scene is None:
        return
    number = image_of(photo)
    images = load_bop_images(Path(manifest.scene)).images
    own = next((image.camera for image in images if image.number == number), None)
    if own is None or not isinstance(camera, Perspective) or not same_intrinsics(own, camera):
        raise BatchError(
            f"The camera is not the BOP scene's for image {number}; undo (Z) what changed it, the "
            "poses of a scene are by its own cameras."
        )


def image_of(photo: str) -> int:
    """The number of an image by its photo's name."""
    return _number(PHOTO_NAME, Path(photo).name)


def _object_of(result: JobResult) -> int:
    return _number(MODEL_NAME, Path(result.model).name)


def _number(pattern: str, name: str) -> int:
    found = re.fullmatch(pattern, name)
    if found is None:
        raise BatchError(f"{name}: no number of BOP's in its name; run the batch again.")
    return int(found[1])


def _record(folder: Path, result: JobResult) -> PoseRecord:
    return load_pose(folder / result.pose, 1, 1)
