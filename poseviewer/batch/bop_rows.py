"""A BOP scene as a batch: a row for each object in each image, and the results as a scene."""

import os
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from poseviewer.batch.job_table import Job, with_keys
from poseviewer.batch.result_folder import Batch, Row
from poseviewer.errors import BatchError, PoseViewerError
from poseviewer.files.checks import is_there
from poseviewer.files.formats.bop import (
    CAMERAS,
    MODEL_FILE,
    MODEL_NAME,
    PHOTO_NAME,
    POSES,
    BopObject,
    SceneFile,
    load_bop_camera,
    load_bop_entries,
    load_scene_file,
    model_path,
    object_number,
    same_intrinsics,
    save_bop_images,
    save_scene_files,
)
from poseviewer.files.masks import pose_contents
from poseviewer.files.pose import PoseRecord, load_pose
from poseviewer.files.writing import make_folder, write_whole
from poseviewer.geometry.camera import Camera, Perspective
from poseviewer.scene.settings import FitSettings

STARTS = "starts"
"""Subfolder of the results for the start poses of a scene's rows."""


def load_scene_jobs(
    scene: Path, out: Path, settings: FitSettings, models: Path | None, objects: Sequence[int]
) -> tuple[Job, ...]:
    """Make the rows of a BOP scene, and save their start poses.

    Args:
        scene: folder of the scene.
        out: folder of the results, in which starts are saved.
        settings: settings of the fits.
        models: folder of the models.
        objects: numbers of the objects to fit; empty: all with poses.

    Raises:
        BatchError: the folder of models is missing, or no row is left.
    """
    for name in ("free_focal", "free_principal_point"):
        if getattr(settings, name):
            raise BatchError(f"{name} with a BOP scene, whose cameras are known; leave it out.")
    if not is_there(scene / POSES):
        raise BatchError(f"{scene}: no {POSES} in it; name the folder of a BOP scene.")
    if models is None:
        raise BatchError(
            f"{scene.name}: a BOP scene; name the folder of its models, of obj_000001.ply ..."
        )
    if not models.is_dir():
        raise BatchError(f"models {models}: no such folder; name that of obj_000001.ply ...")
    relative = Path(os.path.relpath(models.resolve(), scene))
    entries, jobs, instances = load_bop_entries(scene), list[Job](), Counter[tuple[int, int]]()
    make_folder(out / STARTS, BatchError)
    for entry in entries:
        number = entry.object_id
        if objects and number not in objects:
            continue
        instances[entry.image, number] += 1
        instance = instances[entry.image, number]
        more = f"-{instance}" if instance > 1 else ""
        path = out / STARTS / f"{entry.image:06d}-{number:06d}{more}.json"
        if entry.pose is not None:
            save_start(path, PoseRecord.of(entry.pose))
        model, problem = relative / MODEL_FILE.format(number), entry.problem
        try:
            model_path(models, number)
        except PoseViewerError as error:
            problem = problem or str(error)
        files = entry.photo, str(model), os.path.relpath(path, scene)
        said = {"problem": problem, "is_hidden": entry.visible == 0.0}
        jobs.append(Job(len(jobs) + 1, *files, str(scene), **said))
    if not jobs:
        raise BatchError(f"{scene}: no pose of the wanted objects in it; nothing to do.")
    return with_keys(jobs, settings)


def save_start(path: Path, *content: Any) -> None:
    """Save the files of ``pose_contents``; unchanged ones keep their times."""
    for file, data in pose_contents(path, *content).items():
        if not file.is_file() or file.read_bytes() != data:
            write_whole(file, data, BatchError, is_own=True)


def save_bop_poses(batch: Batch, rows: Sequence[Row]) -> None:
    """Write the poses of a BOP scene's rows, in mm, and the scene's cameras as a BOP scene.

    An audit changes accepted poses alone; the rest is the given scene as it is.
    """
    if batch.scene is None:
        return
    cameras = load_scene_file(Path(batch.scene) / CAMERAS)
    if batch.is_audit:
        given = load_scene_file(Path(batch.scene) / POSES)
        for row in rows:
            if row.result.is_accepted:
                _entry_of(given, row.job).update(_bop_object(batch, row).as_json())
        save_scene_files(batch.folder, cameras, given)
        return
    poses: dict[int, list[BopObject]] = defaultdict(list)
    for row in rows:
        if row.result.pose:
            poses[_number(PHOTO_NAME, row.job.photo)].append(_bop_object(batch, row))
    save_bop_images(batch.folder, cameras, dict(poses))


def _bop_object(batch: Batch, row: Row) -> BopObject:
    pose = load_pose(batch.folder / row.result.pose, 1, 1).pose
    return BopObject(_number(MODEL_NAME, row.job.model), pose.camera_from_model)


def _entry_of(poses: SceneFile, job: Job) -> dict[str, Any]:
    """Return the entry of ``scene_gt.json`` that a job starts from, by the name of its start."""
    image, number, *instance = map(int, Path(job.start).stem.split("-"))
    entries = next(own for name, own in poses.items() if int(name) == image)
    same = [entry for entry in entries if object_number(entry) == number]
    return same[instance[0] - 1 if instance else 0]


def require_scene_camera(batch: Batch, photo: str, camera: Camera) -> None:
    """Refuse a pose with another camera than the scene's: a BOP scene cannot hold it."""
    if batch.scene is None:
        return
    number = _number(PHOTO_NAME, photo)
    own = load_bop_camera(Path(batch.scene), number)
    if not isinstance(camera, Perspective) or not same_intrinsics(own, camera):
        raise BatchError(
            f"The camera is not the BOP scene's for image {number}; undo (Z) what changed it, the "
            "poses of a scene are by its own cameras."
        )


def _number(pattern: str, path: str) -> int:
    match = re.fullmatch(pattern, Path(path).name)
    if match is None:
        raise BatchError(f"{Path(path).name}: no BOP number in its name; run the batch again.")
    return int(match[1])
