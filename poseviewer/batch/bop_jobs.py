"""The images of a BOP scene as jobs: a row for each object in each image."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from poseviewer.batch.jobs import LAST, Job, with_keys
from poseviewer.errors import BatchError
from poseviewer.files.formats.bop_images import BopImage, BopObject, load_bop_images
from poseviewer.files.pose.file import PoseRecord, load_pose, save_pose
from poseviewer.fit.settings import FitSettings
from poseviewer.geometry.camera import Pose
from poseviewer.geometry.transform import RigidTransform
from poseviewer.starts.automatic import AUTOMATIC

STARTS = "starts"
"""In the folder of results: the start poses of a scene's rows."""
FROM_SCENE = "gt"
MODEL_FILE = "obj_{:06d}.ply"


@dataclass(frozen=True, slots=True)
class SceneRule:
    """What a scene's folder does not say."""

    models: Path | None = None
    """The folder of ``obj_000001.ply`` and so on, in mm."""
    start: str = FROM_SCENE
    """``gt``: the scene's own poses; ``last``: the pose that the image before ended in, the first
    image from the scene's own; else a pose file, for all images."""
    objects: tuple[int, ...] = ()
    """Which objects; all that have poses where it is empty."""


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """An object in an image, and where it starts."""

    image: BopImage
    found: BopObject
    instance: int = 0
    """Which of several of the object in the image."""
    follows: bool = False
    """Whether it starts where the row above it ended instead."""

    @property
    def name(self) -> str:
        more = f"-{self.instance + 1}" if self.instance else ""
        return f"{self.image.number:06d}-{self.found.object_id:06d}{more}"


def load_scene_jobs(
    scene: Path, out: Path, settings: FitSettings, rule: SceneRule
) -> tuple[Job, ...]:
    """The rows of a scene; their start poses are written into ``out``, where they changed.

    Raises:
        PoseViewerError: it is no scene, or the rule does not go with it.
    """
    if settings.free_focal:
        raise BatchError("--free-focal with a BOP scene, whose cameras are known; leave it out.")
    if rule.models is None:
        raise BatchError(f"{scene.name}: a BOP scene; add --models FOLDER, of obj_000001.ply ...")
    if not rule.models.is_dir():
        raise BatchError(f"--models {rule.models}: no such folder; name that of obj_000001.ply ...")
    rows = _rows(scene, rule)
    if not rows:
        raise BatchError(f"{scene}: no pose of the wanted objects in it; nothing to do.")
    models = Path(os.path.relpath(rule.models.resolve(), scene))
    try:
        (out / STARTS).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BatchError(
            f"{out}: cannot be made ({error.strerror}); name a folder of yours."
        ) from None
    jobs = [
        Job(
            number,
            row.image.photo,
            str(models / MODEL_FILE.format(row.found.object_id)),
            LAST if row.follows else os.path.relpath(_keep_start(out, row), scene),
            str(scene),
        )
        for number, row in enumerate(rows, 1)
    ]
    return with_keys(jobs, settings)


def _rows(scene: Path, rule: SceneRule) -> list[_Row]:
    read = load_bop_images(scene)
    if rule.start == AUTOMATIC:
        raise BatchError(
            "--start auto with a BOP scene: the start would not know the scene's cameras; give "
            "gt, last or a pose file."
        )
    if rule.start in (FROM_SCENE, LAST):
        if not read.posed:
            raise BatchError(
                f"{scene}: no scene_gt.json in it, so --start has to be a pose file, and "
                "--objects to say which objects."
            )
        rows = list(_posed_rows(read.images, rule.objects))
        return _in_series(rows) if rule.start == LAST else rows
    objects = rule.objects
    if not objects and not read.posed:
        raise BatchError(f"{scene}: no scene_gt.json in it; say --objects NUMBER,...")
    place = load_pose(rule.start, 1, 1).pose.camera_from_model
    if not objects:
        return [_moved(row, place) for row in _posed_rows(read.images, ())]
    return [_Row(image, BopObject(number, place)) for image in read.images for number in objects]


def _posed_rows(images: Sequence[BopImage], objects: Sequence[int]) -> Iterator[_Row]:
    for image in images:
        seen: Counter[int] = Counter()
        for found in image.objects:
            if not objects or found.object_id in objects:
                yield _Row(image, found, seen[found.object_id])
                seen[found.object_id] += 1


def _in_series(rows: Sequence[_Row]) -> list[_Row]:
    """The rows object by object, each from where it was before, the first from its own start."""
    series = sorted(rows, key=lambda row: (row.found.object_id, row.instance, row.image.number))
    result: list[_Row] = []
    for row in series:
        before = result[-1] if result else None
        same = before is not None and (before.found.object_id, before.instance) == (
            row.found.object_id,
            row.instance,
        )
        result.append(replace(row, follows=same))
    return result


def _moved(row: _Row, place: RigidTransform) -> _Row:
    return replace(row, found=BopObject(row.found.object_id, place))


def _keep_start(out: Path, row: _Row) -> Path:
    """The row's start pose as a file, which keeps its time where nothing changed."""
    path, camera = out / STARTS / f"{row.name}.json", row.image.camera
    new = out / STARTS / ".new.json"
    save_pose(new, PoseRecord(Pose(camera, row.found.place)))
    if path.is_file() and path.read_bytes() == new.read_bytes():
        new.unlink()
    else:
        new.replace(path)
    return path
