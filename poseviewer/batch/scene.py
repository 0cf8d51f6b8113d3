"""A BOP scene as a batch: a row for each object in each image, and the poses found as a scene."""

from __future__ import annotations

import os
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from poseviewer.batch.results import JobResult, Manifest, make_folders
from poseviewer.batch.table import Job, with_keys
from poseviewer.errors import BatchError
from poseviewer.files.formats.bop import (
    CAMERAS,
    MODEL_FILE,
    MODEL_NAME,
    PHOTO_NAME,
    BopImage,
    BopObject,
    load_bop_images,
    load_scene_file,
    same_intrinsics,
    save_bop_images,
)
from poseviewer.files.pose import PoseRecord, load_pose, save_pose
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Camera, Perspective, Pose

STARTS = "starts"
"""In the folder of results: the start poses of a scene's rows."""


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What a scene's folder does not say."""

    models: Path | None = None
    """The folder of ``obj_000001.ply`` and so on, in mm."""
    objects: tuple[int, ...] = ()
    """Which objects; empty: all that have poses."""


def load_scene_jobs(
    scene: Path, out: Path, settings: FitSettings, options: SceneOptions
) -> tuple[Job, ...]:
    """The rows of a scene; their start poses are written into ``out``, where they changed."""
    if settings.free_focal:
        raise BatchError("--free-focal with a BOP scene, whose cameras are known; leave it out.")
    if options.models is None:
        raise BatchError(f"{scene.name}: a BOP scene; add --models FOLDER, of obj_000001.ply ...")
    if not options.models.is_dir():
        raise BatchError(
            f"--models {options.models}: no such folder; name that of obj_000001.ply ..."
        )
    objects = _objects_to_fit(scene, options)
    if not objects:
        raise BatchError(f"{scene}: no pose of the wanted objects in it; nothing to do.")
    make_folders(out, [STARTS])
    models = Path(os.path.relpath(options.models.resolve(), scene))
    jobs = []
    for row, (image, found, instance) in enumerate(objects, 1):
        start = os.path.relpath(_save_start(out, image, found, instance), scene)
        model = str(models / MODEL_FILE.format(found.object_id))
        jobs.append(Job(row, image.photo, model, start, str(scene)))
    return with_keys(jobs, settings)


def _objects_to_fit(scene: Path, options: SceneOptions) -> list[tuple[BopImage, BopObject, int]]:
    """Image, object at its start pose, and which of several of this object in the image."""
    found = []
    for image in load_bop_images(scene, posed=True):
        seen: Counter[int] = Counter()
        for one in image.objects:
            if not options.objects or one.object_id in options.objects:
                found.append((image, one, seen[one.object_id]))
                seen[one.object_id] += 1
    return found


def _save_start(out: Path, image: BopImage, found: BopObject, instance: int) -> Path:
    """The start pose as a file, which keeps its time where nothing changed."""
    more = f"-{instance + 1}" if instance else ""
    path = out / STARTS / f"{image.number:06d}-{found.object_id:06d}{more}.json"
    new = out / STARTS / ".new.json"
    save_pose(new, PoseRecord(Pose(image.camera, found.place)))
    if path.is_file() and path.read_bytes() == new.read_bytes():
        new.unlink()
    else:
        new.replace(path)
    return path


def save_scene(folder: Path, manifest: Manifest, results: Sequence[JobResult]) -> None:
    """Write the poses of a BOP scene's rows (mm) and the scene's cameras as a BOP scene."""
    if manifest.scene is None:
        return
    poses: dict[int, list[BopObject]] = defaultdict(list)
    for result in sorted(results, key=lambda result: result.row):
        if result.pose:
            place = load_pose(folder / result.pose, 1, 1).pose.camera_from_model
            found = BopObject(_number(MODEL_NAME, result.model), place)
            poses[_number(PHOTO_NAME, result.photo)].append(found)
    save_bop_images(folder, load_scene_file(Path(manifest.scene) / CAMERAS), dict(poses))


def require_scene_camera(manifest: Manifest, photo: str, camera: Camera) -> None:
    """Refuse a pose with another camera than the scene's, which a BOP scene cannot hold."""
    if manifest.scene is None:
        return
    number = _number(PHOTO_NAME, photo)
    images = load_bop_images(Path(manifest.scene))
    own = next((image.camera for image in images if image.number == number), None)
    if own is None or not isinstance(camera, Perspective) or not same_intrinsics(own, camera):
        raise BatchError(
            f"The camera is not the BOP scene's for image {number}; undo (Z) what changed it, the "
            "poses of a scene are by its own cameras."
        )


def _number(pattern: str, path: str) -> int:
    found = re.fullmatch(pattern, Path(path).name)
    if found is None:
        raise BatchError(f"{Path(path).name}: no BOP number in its name; run the batch again.")
    return int(found[1])
